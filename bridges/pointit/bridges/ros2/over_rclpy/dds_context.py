"""Context shared by the endpoints of the backend on rclpy, and the types built in this ROS."""

import collections
import math
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backend import RosType
from pointit.bridges.ros2.graph.node_backend import NodeContext
from pointit.bridges.ros2.over_rclpy.graph import full_name, hash_of
from pointit.bridges.ros2.over_rclpy.rclpy_library import Rclpy, class_of
from pointit.bridges.ros2.over_rclpy.rclpy_types import EndInfo, Node
from pointit.bridges.ros2.types.definitions import INTERFACES
from pointit.runtime.bus.dispatcher import Dispatcher
from pointit.runtime.service.surroundings import WarningSink

End = TypeVar("End")

REMEMBERED = 256
"""Maximum number of remembered messages of a topic; they come back within milliseconds."""

MAX_PADDING = 3
"""Maximum number of bytes that middlewares append on delivery."""

COARSE_NS = 1000
"""Resolution of times, which a middleware may cut down to microseconds."""


class DdsContext(NodeContext):
    """Our node, and the loop of its endpoints."""

    def __init__(self, rclpy: Rclpy, node: Node, config: BackendConfig, warnings: WarningSink) -> None:
        super().__init__(config, warnings, Dispatcher())
        self.rclpy = rclpy
        self.node = node
        self.echoes: dict[str, LoopbackFilter] = collections.defaultdict(LoopbackFilter)
        """By topic."""
        self._config = config

    def class_of(self, kind: RosType) -> Any:
        """Return the Python class of a type, or None, with a warning, if it is not built in this ROS."""
        try:
            return class_of(kind.name)
        except LookupError:
            package = kind.name.partition("/")[0]
            if (INTERFACES / package).is_dir():
                remedy = (
                    f"build them with `colcon build --base-paths {INTERFACES}`, source install/setup.bash"
                )
            else:
                remedy = f"install ros-{self._config.distro}-{package.replace('_', '-')}"
            self.warnings.show(
                f"package {package}",
                f"this ROS has no types of {package}, whose topics and services are left out; {remedy} and "
                "start again",
            )
            return None

    def declared(self, kind: RosType, name: str, declare: Callable[[], End]) -> End | None:
        """Return the endpoint made by `declare`, or None, with a warning, if rclpy rejects its type."""
        try:
            return declare()
        except Exception as error:  # noqa: BLE001 - rclpy raises what comes out of the type's libraries
            why = str(error).partition("\n")[0][:200] or type(error).__name__
            self.warnings.show(
                f"refusal of {kind.name}",
                f"rclpy refuses {kind.name}, so {name} is left out: {why}; rebuild its package for this ROS",
            )
            return None

    def is_other(self, kind: RosType, name: str, infos: Callable[[str], Sequence[EndInfo]]) -> bool:
        """Return True, with a warning, if this ROS has been built with another definition of `kind`.

        Nodes would misread our bytes and cannot reject them.

        Args:
            kind: ours.
            name: of a topic with an endpoint of ours.
            infos: returns the endpoints of that kind.
        """
        installed = {
            hash_of(info)
            for info in infos(name)
            if full_name(info.node_name, info.node_namespace) == self._config.node
            and info.topic_type == kind.name
        } - {""}
        if not installed or kind.hash in installed or not kind.hash.startswith("RIHS01_"):
            return False
        self.warnings.show(
            f"definition of {kind.name}",
            f"this ROS has another definition of {kind.name} than PointIt (hash {min(installed)[:20]}, not "
            f"{kind.hash[:20]}), so {name} is left out; set distro to this ROS's, or rebuild the package "
            f"from {INTERFACES}",
        )
        return True


class NullEndpoint:
    """Stands for an endpoint that could not be declared, of which a warning tells."""

    is_read = False

    def put(self, cdr: bytes) -> None:
        """Send nothing."""

    def close(self) -> None:
        """Do nothing."""


class LoopbackFilter:
    """Messages recently sent to one topic: rclpy delivers our own like any other.

    Only rclpy from Kilted on names a message's publisher; every one since Iron gives the time of publication.
    It is taken inside `publish`, by the same clock as ours: a message with the bytes of one of ours,
    published while we published, is ours.
    """

    def __init__(self) -> None:
        self._sent: collections.deque[_Sent] = collections.deque(maxlen=REMEMBERED)

    def begin(self, cdr: bytes, now_ns: int) -> "_Sent":
        """Record a message before it is sent, at `now_ns` of the operating system's clock."""
        sent = _Sent(len(cdr), hash(cdr), now_ns)
        self._sent.append(sent)
        return sent

    def is_ours(self, cdr: bytes, source_ns: int) -> bool:
        """Return True if we published `cdr` at `source_ns`.

        If the time is unknown (0, before Iron), every message of ours matches once.
        """
        for sent in self._sent.copy():  # the loop appends meanwhile
            if source_ns:
                is_match = sent.began_ns - COARSE_NS <= source_ns < sent.ended_ns
            else:
                is_match = not sent.is_back
            if is_match and sent.is_in(cdr):
                sent.is_back = True
                return True
        return False


class _Sent:
    """One message of ours."""

    __slots__ = ("began_ns", "ended_ns", "is_back", "length", "mark")

    def __init__(self, length: int, mark: int, began_ns: int) -> None:
        self.length = length
        self.mark = mark
        self.began_ns = began_ns
        self.ended_ns = math.inf
        """Infinite until it is known: the message may be back before `publish` returns."""
        self.is_back = False

    def is_in(self, cdr: bytes) -> bool:
        """Return True if `cdr` is this message, with or without padding."""
        return 0 <= len(cdr) - self.length <= MAX_PADDING and hash(cdr[: self.length]) == self.mark
