"""The pose of one robot, from a topic or from tf, in the frame of its driver."""

from collections.abc import Callable
from typing import Any

from pointit.bridges.ros2.config import TF, PoseSource
from pointit.bridges.ros2.graph.backend import SENSOR, Backend, BackendHandle, Qos
from pointit.bridges.ros2.routing.names import frame_name
from pointit.bridges.ros2.sightings import AT_ORIGIN, READERS, Sighting, TransformBuffer, compose, yaw
from pointit.bridges.ros2.trackers import FrameLookup, Motion, captured, stated_velocity
from pointit.bridges.ros2.types.types import Types
from pointit.plugins import NS_PER_S, RobotReport

TF_TYPE = "tf2_msgs/msg/TFMessage"
SOONEST_NS = NS_PER_S // 50
"""Minimum interval of reports."""


class PoseReader:
    """Converts messages to reports; pure."""

    def __init__(self, source: PoseSource, frame: str) -> None:
        self._source = source
        self._known = {frame_name(frame): AT_ORIGIN}
        self._buffer = TransformBuffer()
        self._motion = Motion()
        self._last_ns = 0
        self._yaw_rad: float | None = None
        """That of the last report, for a message without a heading."""
        self.problem = ""
        """Parts of the newest message that cannot be used, with the reasons, or `""`."""
        if source.type == TF:
            self._buffer.want(source.frame)

    def is_wanted(self, cdr: bytes) -> bool:
        """Return True if a message of /tf may matter; decoding it takes longer."""
        return bool(self._buffer.wanted_in(cdr))

    def transforms(self, value: Any, now_ns: int, *, is_static: bool) -> RobotReport | str:
        """Return the report, or a sentence why there is none, or `""`, after a tf2_msgs/TFMessage."""
        problems = list(self._buffer.take(value, is_static=is_static, now_ns=now_ns))
        source = self._source
        if source.type != TF or is_static:
            return problems[0] if problems else ""
        placed = self._buffer.placed(source.frame, self._known, now_ns, source.stale_s)
        if isinstance(placed, str):
            return placed
        stamp_ns = now_ns if placed.stamp_ns is None else placed.stamp_ns
        return self._report(Sighting("", placed.pose), stamp_ns, now_ns)

    def message(self, value: Any, now_ns: int) -> RobotReport | str:
        """Return the report of a message of the topic, or a sentence why there is none, or `""`."""
        source = self._source
        stamp, (sighting,) = READERS[source.type](value)
        stamp_ns = captured(stamp, now_ns, f"what {source.topic} tells", source.stale_s)
        if isinstance(stamp_ns, str):
            return stamp_ns
        if isinstance(sighting, str):
            return sighting
        return self._report(sighting, stamp_ns, now_ns)

    def _report(self, sighting: Sighting, stamp_ns: int, now_ns: int) -> RobotReport | str:
        """Return the report of a pose, or a sentence why there is none, or `""`."""
        source = self._source
        own_frame = "" if source.type == TF else source.frame
        lookup = FrameLookup(self._buffer, self._known, now_ns, source.stale_s)
        frame = lookup.pose(sighting.frame or own_frame)
        if isinstance(frame, str):
            return frame
        if not sighting.has_heading and self._yaw_rad is None:
            return sighting.notes[0]

        # Time of measurement, later than that of the last report
        stamp_ns = max(stamp_ns - round(source.latency_s * NS_PER_S), 0)
        is_overtaken = 0 <= self._last_ns - stamp_ns < NS_PER_S
        if is_overtaken or 0 < stamp_ns - self._last_ns < SOONEST_NS:
            return ""  # overtaken, sent twice, or too soon

        # Velocity by the message, or otherwise by the previous positions
        pose = compose(frame, sighting.pose)
        velocity_mps = stated_velocity(sighting, own_frame, pose, lookup)
        problems = sighting.notes
        if isinstance(velocity_mps, str):
            problems = (*problems, velocity_mps)
        if velocity_mps is None or isinstance(velocity_mps, str):
            velocity_mps = self._motion.velocity_mps("", pose.position_m, stamp_ns)

        self._last_ns = stamp_ns
        self.problem = "; ".join(problems)
        if sighting.has_heading or self._yaw_rad is None:
            self._yaw_rad = yaw(pose.orientation)
        return RobotReport(
            stamp_ns=stamp_ns,
            position_m=pose.position_m,
            yaw_rad=self._yaw_rad,
            velocity_mps=velocity_mps,
            position_sigma_m=sighting.sigma_m,
        )


class PoseInput:
    """Subscriptions that feed a `PoseReader`."""

    def __init__(
        self,
        backend: Backend,
        types: Types,
        reader: PoseReader,
        source: PoseSource,
        *,
        now_ns: Callable[[], int],
        on_report: Callable[[RobotReport], None],
        on_problem: Callable[[str], None],
    ) -> None:
        """Subscribe; `on_problem` gets a sentence, or `""` when a message is valid."""
        self._types = types
        self._reader = reader
        self._now_ns = now_ns
        self._on_report = on_report
        self._on_problem = on_problem

        # Transforms in any case: the pose of a topic may be in a frame of tf, too
        types.prepare(TF_TYPE)
        tf = types.kind(TF_TYPE)
        latched = Qos(depth=100, latched=True)
        static_end = backend.subscribe("/tf_static", tf, latched, self._on_static)
        moving_end = backend.subscribe("/tf", tf, Qos(depth=100), self._on_moving)
        self._ends: list[BackendHandle] = [static_end, moving_end]
        self._name = source.type.replace("/", "/msg/")
        if source.type != TF:
            types.prepare(self._name)
            kind = types.kind(self._name)
            self._ends.append(backend.subscribe(source.topic, kind, SENSOR, self._on_message))

    def close(self) -> None:
        """Unsubscribe."""
        for end in self._ends:
            end.close()

    def _on_static(self, cdr: bytes) -> None:
        self._process(TF_TYPE, cdr, lambda value: self._transforms(value, is_static=True))

    def _on_moving(self, cdr: bytes) -> None:
        if self._reader.is_wanted(cdr):
            self._process(TF_TYPE, cdr, lambda value: self._transforms(value, is_static=False))

    def _transforms(self, value: Any, *, is_static: bool) -> RobotReport | str:
        return self._reader.transforms(value, self._now_ns(), is_static=is_static)

    def _on_message(self, cdr: bytes) -> None:
        self._process(self._name, cdr, self._message)

    def _message(self, value: Any) -> RobotReport | str:
        return self._reader.message(value, self._now_ns())

    def _process(self, name: str, cdr: bytes, read: Callable[[Any], RobotReport | str]) -> None:
        try:
            report = read(self._types.decode(name, cdr))
        except ValueError as error:
            report = f"a {name} was dropped: {error}"
        if isinstance(report, str):
            if report:
                self._on_problem(report)
            return
        self._on_problem(self._reader.problem)
        self._on_report(report)
