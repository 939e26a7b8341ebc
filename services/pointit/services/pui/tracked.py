"""Positions of tracked objects at a given time."""

from pointit.geometry import vector
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Environment, TrackedObject, TrackedObjects
from pointit.services.pui.workspace import WorkspaceError

STALE_NS = 2 * NS_PER_S
"""Age at which an object's position is unknown, ns."""


class Tracked:
    """The newest objects of every tracker, moved from their stamp to any other time."""

    def __init__(self, environment: Environment) -> None:
        """Set the map, along whose lines objects move."""
        self._lines: dict[tuple[str, str], tuple[Vec3, ...]] = {
            **{("strip", strip.id): strip.line_m for strip in environment.strips},
            **{("belt", belt.id): belt.line_m for belt in environment.belts},
        }
        self._newest: dict[str, TrackedObjects] = {}

    def on_objects(self, tracker: str, message: TrackedObjects) -> None:
        """Set the objects of `tracker`."""
        self._newest[tracker] = message

    def where(self, object_id: str, stamp_ns: int) -> Vec3:
        """Return the centre of an object at `stamp_ns`, {W}.

        Raises:
            WorkspaceError: If it is not tracked, or has not been for a while.
        """
        known = [
            (message.stamp_ns, tracked)
            for message in self._newest.values()
            for tracked in message.objects
            if tracked.id == object_id
        ]
        if not known:
            raise WorkspaceError(f"no object {object_id!r} is known: use the id of one that is tracked now")
        seen_ns, tracked = min(known, key=lambda pair: abs(stamp_ns - pair[0]))
        late_ns = stamp_ns - seen_ns
        if late_ns < -STALE_NS:
            raise WorkspaceError(
                f"object {object_id!r} is tracked by a clock {-late_ns / NS_PER_S:.1f} s ahead of the "
                "person's rays: set the clocks alike, or point first"
            )
        if late_ns > STALE_NS:
            raise WorkspaceError(
                f"object {object_id!r} was last seen {late_ns / NS_PER_S:.1f} s ago: look for it"
            )
        return self._moved(tracked, late_ns / NS_PER_S)

    def _moved(self, tracked: TrackedObject, late_s: float) -> Vec3:
        line = self._lines.get((tracked.surface, tracked.surface_id))
        if line is not None:  # along its bends, at the same offset from the line
            path = Polyline(line)
            there = path.point_at(tracked.surface_position_m + tracked.surface_speed_mps * late_s)
            shift = vector.subtract(there, path.point_at(tracked.surface_position_m))
        else:
            shift = vector.scale(tracked.velocity_mps, late_s)
        return vector.add(tracked.position_m, shift)
