"""Rows of the route table: a name in ROS, our topic or request, the converter, its stamp, frame and rate."""

import math
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from typing import Any, NamedTuple

from pointit.bridges.ros2.graph.backend import SERVICE, Qos
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.names import WORLD
from pointit.schemas import Message, Query, Reply
from pointit.schemas.topics import Request, Topic

Converted = tuple[Any, ...]
"""ROS values in the order of sending, or `()` to send nothing."""

MAX_BYTES = 16 * 1024
"""Default maximum size of messages from ROS; decoding blocks the loop."""


class ConversionContext(NamedTuple):
    """Context of a conversion."""

    state: ConversionState
    name: str
    """Name for the placeholder: a user or lamp; `""` if there is none."""
    stamp_ns: int
    """Outward: goes into `header.stamp`. Inward: the site's time now."""
    frame: str = ""
    """Outward: goes into `header.frame_id`. Inward: the frame in which positions are expected."""
    wall_ns: int = 0
    """Inward: the operating system's time now."""
    is_again: bool = False
    """Outward: this message is a repetition."""


class BusOutput(NamedTuple):
    """Something for our bus: a message to publish, or a query to ask."""

    at: Topic[Any] | Request[Any, Any]
    name: str
    """Name for its placeholder."""
    what: Message | Query


class ConversionWarning(NamedTuple):
    """A rejected or corrected value: the reason and the remedy."""

    sentence: str


Taken = tuple[BusOutput | ConversionWarning, ...]


@dataclass(frozen=True)
class _Route:
    name: str
    """Name in the configuration."""
    ros: str
    """The name in ROS, `{user}` or `{led}` for the placeholder of what it stands for."""
    type: str
    _: KW_ONLY
    enabled: bool = True
    yields: bool = False
    """Used only while no other node does the same with the same name."""
    yields_to: str = ""
    """Name in ROS whose other publishers it yields to, or `""` for its own."""
    frame: str = WORLD
    """`WORLD`, `PERSON`, or a name with `{user}`."""
    context: str
    reader: str = ""
    """Appended to the subject of warnings, where several routes read one topic."""

    def ros_name(self, state: ConversionState, name: str) -> str:
        """Return the name in ROS for `name`, which is a user, a lamp, or empty."""
        head, opening, rest = self.ros.partition("{")
        if not opening:
            return head
        _, _, tail = rest.partition("}")
        return head + state.names.of(name) + tail


@dataclass(frozen=True)
class OutboundRoute(_Route):
    """A topic of ours, published in ROS."""

    qos: Qos
    reads: tuple[Topic[Any], ...]
    """Topics whose messages are converted, once the scene has them."""
    by: Callable[[Any, ConversionContext], Converted]
    _: KW_ONLY
    rate_hz: float | None = None
    """Maximum rate; earlier messages are delayed, and the newest wins."""
    is_each: bool = False
    """Each message is about one name, and rate and delay apply per name."""
    repeat_hz: float | None = None
    """The last message of each name is converted again at this rate, with the current time."""
    repeat_for_s: float = math.inf
    """Duration of repetitions."""
    on_change: bool = False
    """Identical values of a name are not sent again."""
    is_ros4hri: bool = False
    """Only with the parameter `ros4hri`."""
    has_user_publisher: bool = False
    """Published by a ROS-only user's own nodes, and then not by us."""
    begins: Callable[[], None] | None = None
    """Called when the first subscriber appears."""
    forgets: Callable[[str], None] | None = None
    """Called with people who leave, or services that have gone, if messages are about them."""
    has_end: bool = False
    """An empty value is sent before its name is closed: a person or the bridge leaves."""
    apart_s: float = 0.0
    """Delay between the values of one message: a button is down for this time."""

    def convert(
        self, message: Message, name: str, state: ConversionState, *, again_ns: int | None = None
    ) -> Converted:
        """Return the ROS values of `message`; `again_ns`: it is repeated at this time."""
        is_again = again_ns is not None
        stamp_ns = message.stamp_ns if again_ns is None else again_ns
        frame = state.frames.resolve(self.frame, name)
        context = ConversionContext(state, name, stamp_ns, frame, is_again=is_again)
        return self.by(message, context)


@dataclass(frozen=True)
class InboundRoute(_Route):
    """A topic of ROS, forwarded to our bus."""

    qos: Qos
    into: tuple[Topic[Any] | Request[Any, Any], ...]
    """Topics and requests that it writes to."""
    by: Callable[[Any, ConversionContext], Taken]
    _: KW_ONLY
    rate_hz: float | None = None
    """Maximum rate; earlier messages are delayed, and the newest wins."""
    bytes_hz: float | None = None
    """Maximum rate of bytes read; of messages above it the newest waits."""
    people: Callable[[bytes, ConversionState], tuple[str, ...]] | None = None
    """People whom a message is about, from its bytes. The newest per person waits, others are not read."""
    max_bytes: int = MAX_BYTES
    """Longer messages are dropped unread."""
    on_presence: Callable[[ConversionContext], Taken] | None = None
    """Returns persistent values published before a person joined."""
    forgets: Callable[[str], None] | None = None
    """Called with people who leave."""
    of_ros_users: bool = False
    """For ROS-only users only, present or not: it makes them present."""

    def convert(self, value: Any, name: str, state: ConversionState, *, now_ns: int, wall_ns: int) -> Taken:
        """Return messages, queries and warnings; never raises."""
        frame = state.frames.resolve(self.frame, name)
        context = ConversionContext(state, name, now_ns, frame, wall_ns)
        return self.by(value, context)


@dataclass(frozen=True)
class ServiceRoute(_Route):
    """A service of ROS that one of our services answers."""

    request: Request[Any, Any]
    asks: Callable[[Any, ConversionContext], BusOutput | ConversionWarning]
    """Converts a ROS request. A warning refuses it."""
    _: KW_ONLY
    qos: Qos = SERVICE
    yields: bool = True
    answers: Callable[[Any, Reply | None, ConversionContext], Any] | None = None
    """Converts the ROS request and our reply, None if refused, to the ROS response (default: empty)."""
    max_bytes: int = MAX_BYTES
    """Longer requests are refused unread."""
    has_result: bool = False
    """The response says whether it was done. Without, a refused request gets an error."""

    def response(self, request: Any, reply: Reply | None, context: ConversionContext) -> Any:
        """Return the ROS response to a request, from our reply or None if it was refused."""
        if self.answers is not None:
            return self.answers(request, reply, context)
        types = context.state.types
        return types.make(types.response_of(self.type))
