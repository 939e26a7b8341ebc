"""What a row of the route table is: a name in ROS, what of ours it stands for, and who converts."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from pointit.bridges.ros2.graph.backend import Qos
from pointit.bridges.ros2.routing.frames import WORLD
from pointit.bridges.ros2.routing.scene import Scene
from pointit.schemas import Message, Query, Reply
from pointit.schemas.topics import Request, Topic

MAX_BYTES = 16 * 1024
"""Of what comes from ROS, unless its route says otherwise; decoding holds up the loop."""


class ConversionContext(NamedTuple):
    """What a converter is told besides the message or value itself."""

    scene: Scene
    name: str
    """What stands for the placeholder: a user, a lamp; empty: there is none."""
    stamp_ns: int
    """Outward: goes into `header.stamp`. Inward: the site's time now."""
    frame: str = ""
    """Outward: goes into `header.frame_id`. Inward: the frame in which places are expected."""
    wall_ns: int = 0
    """Inward: the operating system's time now."""
    is_again: bool = False
    """Outward: this message was converted before, and is repeated."""


class BusOutput(NamedTuple):
    """Something for our bus: a message to publish, or a query to ask."""

    at: Topic[Any] | Request[Any, Any]
    name: str
    """For its placeholder."""
    what: Message | Query


class ConversionWarning(NamedTuple):
    """What could not be taken, or not as it was; one sentence that says why and what to do."""

    sentence: str


Converted = tuple[Any, ...]
"""ROS values in the order in which they are to be sent; empty: there is nothing to tell."""

Taken = tuple[BusOutput | ConversionWarning, ...]


@dataclass(frozen=True, kw_only=True)
class _Route:
    name: str
    """By which configuration means it."""
    ros: str
    """The name in ROS, `{user}` or `{led}` for the placeholder of what it stands for."""
    type: str
    qos: Qos
    enabled: bool = True
    yields: bool = False
    """Only as long as nobody else in the graph does the same with the same name."""
    frame: str = WORLD
    """`WORLD`, `PERSON`, or a name with `{user}`."""
    about: str

    def ros_name(self, scene: Scene, name: str) -> str:
        """Return the name in ROS for `name`, which is a user, a lamp, or empty."""
        head, opening, rest = self.ros.partition("{")
        return head + scene.names.of(name) + rest.partition("}")[2] if opening else head


@dataclass(frozen=True, kw_only=True)
class OutboundRoute(_Route):
    """Ours, published in ROS."""

    reads: tuple[Topic[Any], ...]
    """Each of their messages, once the scene has taken it, is converted."""
    by: Callable[[Any, ConversionContext], Converted]
    rate_hz: float | None = None
    """No more often; of what comes sooner the newest waits."""
    is_each: bool = False
    """A message tells of one name only: each has the rate, and what waits displaces nobody else's."""
    repeat_hz: float | None = None
    """The last message of each name is converted again so often, stamped with the time it is then."""
    repeat_for_s: float = math.inf
    """For no longer than this."""
    on_change: bool = False
    """Of a name, not sent again while it stays byte by byte the same."""
    is_theirs: bool = False
    """Said in ROS by a guest's own nodes, and then not by us."""
    begins: Callable[[], None] | None = None
    """Told when somebody reads where nobody did."""
    forgets: Callable[[str], None] | None = None
    """Told who leaves, or which service has gone, of those whom its messages are about."""
    apart_s: float = 0.0
    """Between the values of one message: a button is down for so long."""

    def convert(self, message: Message, name: str, scene: Scene, *, again_ns: int | None = None) -> Converted:
        """Return the ROS values of `message`; `again_ns`: it is repeated at this time."""
        is_again = again_ns is not None
        stamp_ns = message.stamp_ns if again_ns is None else again_ns
        frame = scene.frames.resolve(self.frame, name)
        return self.by(message, ConversionContext(scene, name, stamp_ns, frame, is_again=is_again))


@dataclass(frozen=True, kw_only=True)
class InboundRoute(_Route):
    """ROS', taken to our bus."""

    into: tuple[Topic[Any] | Request[Any, Any], ...]
    """What of ours it can write or ask."""
    by: Callable[[Any, ConversionContext], Taken]
    rate_hz: float | None = None
    """No more often; of what comes sooner the newest waits."""
    bytes_hz: float | None = None
    """No more bytes are read in a second; of what is beyond them the newest waits."""
    people: Callable[[bytes, Scene], tuple[str, ...]] | None = None
    """Whom a message tells of, by its bytes: the newest of each waits; what tells of nobody is not read."""
    max_bytes: int = MAX_BYTES
    """What is longer is dropped unread."""
    meets: Callable[[ConversionContext], Taken] | None = None
    """What was said, once for all, before somebody came whom it is about."""
    forgets: Callable[[str], None] | None = None
    """Told who leaves."""
    of_guests: bool = False
    """Taken of guests only, be they present or not: by this they are."""

    def convert(self, value: Any, name: str, scene: Scene, *, now_ns: int, wall_ns: int) -> Taken:
        """Return what to publish or ask, and what could not be taken; never raises."""
        return self.by(
            value, ConversionContext(scene, name, now_ns, scene.frames.resolve(self.frame, name), wall_ns)
        )


@dataclass(frozen=True, kw_only=True)
class ServiceRoute(_Route):
    """A service of ROS that one of our services answers."""

    request: Request[Any, Any]
    asks: Callable[[Any, ConversionContext], BusOutput | ConversionWarning]
    """From a ROS request; a warning answers it without asking."""
    answers: Callable[[Any, Reply | None, ConversionContext], Any]
    """From the ROS request and our reply, none where it was refused; returns the ROS response."""
    max_bytes: int = MAX_BYTES
    """A request that is longer is refused unread."""
    has_result: bool = False
    """The response says whether it was done. Without, a request that was not done gets an error."""
