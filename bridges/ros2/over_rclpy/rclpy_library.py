"""rclpy and the types built with it, imported on demand."""

import importlib
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pointit.bridges.ros2.graph.backend import Qos
from pointit.runtime.errors import ConfigError
from pointit.schemas.text import system_reason

NamesAndTypes = Sequence[tuple[str, Sequence[str]]]
MessageInfo = Mapping[str, Any]
"""Metadata of a message; `source_timestamp` is its time of publication, ns since 1970."""

# Objects of rclpy, which has no stubs.
EndInfo = Any
"""A publisher or subscription in the graph."""
Executor = Any
Node = Any
Profile = Any
"""Quality of service of an endpoint."""
Reply = Any
"""Future of a response; its callbacks are called on the executor's thread."""
RosContext = Any
ServiceClass = Any
"""Python class of a service type, `std_srvs.srv.Empty`."""

MAX_CHARACTERS = 200
"""Limit of the reason for which rclpy does not load."""
ACTION_PARTS = {
    "SendGoal": "SendGoalService",
    "GetResult": "GetResultService",
    "FeedbackMessage": "FeedbackMessage",
}
"""Attributes of an action's class that are its services and topic."""


@dataclass(frozen=True, kw_only=True)
class Rclpy:
    """The library, loaded."""

    new_context: Callable[[], RosContext]
    new_node: Callable[..., Node]
    new_executor: Callable[..., Executor]
    new_profile: Callable[..., Profile]
    new_duration: Callable[..., object]
    reliability: Any
    """Enumeration of policies."""
    durability: Any
    serialize: Callable[[object], bytes]
    deserialize: Callable[[bytes, type[object]], object]

    def profile(self, qos: Qos) -> Profile:
        """Return `qos` as an rclpy profile."""
        limits: dict[str, object] = {}
        if qos.lifespan_ns is not None:
            limits["lifespan"] = self.new_duration(nanoseconds=qos.lifespan_ns)
        reliability = self.reliability.RELIABLE if qos.reliable else self.reliability.BEST_EFFORT
        durability = self.durability.TRANSIENT_LOCAL if qos.latched else self.durability.VOLATILE
        return self.new_profile(**limits, depth=qos.depth, reliability=reliability, durability=durability)

    def qos(self, profile: Profile) -> Qos:
        """Return the `Qos` of `profile`. DDS does not show the depth of others, and lifespan is not used."""
        is_reliable = profile.reliability == self.reliability.RELIABLE
        is_latched = profile.durability == self.durability.TRANSIENT_LOCAL
        return Qos(depth=profile.depth, reliable=is_reliable, latched=is_latched)


def loaded() -> Rclpy:
    """Return rclpy.

    Raises:
        ConfigError: If it is not there, not for this Python, or older than Iron.
    """
    load = importlib.import_module
    try:
        _ = load("rclpy.subscription").Subscription.CallbackType  # since Iron
        qos = load("rclpy.qos")
        serialization = load("rclpy.serialization")
        return Rclpy(
            new_context=load("rclpy.context").Context,
            new_node=load("rclpy.node").Node,
            new_executor=load("rclpy.executors").SingleThreadedExecutor,
            new_profile=qos.QoSProfile,
            new_duration=load("rclpy.duration").Duration,
            reliability=qos.ReliabilityPolicy,
            durability=qos.DurabilityPolicy,
            serialize=serialization.serialize_message,
            deserialize=serialization.deserialize_message,
        )
    except (ImportError, AttributeError, OSError) as error:
        # Absent, or there but built for another Python or incomplete
        python = f"{sys.version_info.major}.{sys.version_info.minor}"
        if isinstance(error, ModuleNotFoundError) and error.name == "rclpy":
            problem = f"there is no rclpy for this Python {python}"
        else:
            problem = f"rclpy does not load in this Python {python} ({system_reason(error, MAX_CHARACTERS)})"
        distro = os.environ.get("ROS_DISTRO") or "jazzy"
        raise ConfigError(
            f"backend.kind dds: {problem}; run `source /opt/ros/{distro}/setup.bash` and start PointIt with "
            "the Python that this ROS is built for; or use kind rmw_zenoh"
        ) from error


def class_of(name: str) -> Any:
    """Return the installed Python class of `std_msgs/msg/Bool`, `std_srvs/srv/Empty`, or a part of an action.

    Raises:
        LookupError: If it is not built here.
    """
    package, kind, short = name.split("/")
    try:
        module = importlib.import_module(f"{package}.{kind}")
        action, _, part = short.rpartition("_")
        if kind == "action" and part in ACTION_PARTS:
            return getattr(getattr(module, action).Impl, ACTION_PARTS[part])
        return getattr(module, short)
    except (ImportError, AttributeError) as error:
        raise LookupError(name) from error
