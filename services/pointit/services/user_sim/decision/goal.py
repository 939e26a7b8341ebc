"""A goal of pointing, and its motion."""

from dataclasses import dataclass

from pointit.geometry import vector
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.user_sim.decision.press import Gesture
from pointit.services.user_sim.sight.pixels import Kind
from pointit.services.user_sim.sight.sight import SeenObject, Sight

PURSUIT_S = 1.5
"""Time for which a thing is extrapolated after it was lost from view, s."""
IN_AIR_M = 0.3
"""Height from which a spot is a place for the robot itself. Lower ones are on the floor below it, m."""


@dataclass(frozen=True, slots=True)
class PersonGoal:
    """A goal that moves at constant speed. Without a point the arm rests."""

    key: str
    """Identity: two goals with the same key are the same thing seen at different times."""
    point_m: Vec3 | None = None
    velocity_mps: Vec3 = (0.0, 0.0, 0.0)
    stamp_ns: int = 0
    closed_loop: bool = False
    """True if the system shows a cursor by which the person can correct."""
    kind: Kind = "strip"
    """Kind of line along which the cursor is expected."""
    curve: Polyline | None = None
    """Line with bends that it follows."""
    along_m: float = 0.0
    speed_mps: float = 0.0
    object_id: str = ""
    on_line: bool = True
    """False for an object at which no strip or belt shows the cursor: its own light does, or nothing."""
    lit: bool = False
    """True if the object's own light shows that the person points at it."""
    robot: str = ""
    """Robot that follows the hand and so shows the cursor, or `""`: light does."""
    presses: int = 0
    """Number of presses of the button that the person has decided on so far."""
    gesture: Gesture = "press"
    """The last of them."""

    def point_at(self, now_ns: int) -> Vec3 | None:
        """Return its expected position at `now_ns`, or None."""
        if self.point_m is None:
            return None
        passed_s = min((now_ns - self.stamp_ns) / NS_PER_S, PURSUIT_S)
        if self.curve is not None:
            return self.curve.point_at(self.along_m + self.speed_mps * passed_s)
        return vector.add(self.point_m, vector.scale(self.velocity_mps, passed_s))


REST = PersonGoal("rest")


def on_object(seen: SeenObject, sight: Sight, *, closed_loop: bool) -> PersonGoal:
    """Return the goal at the middle of an object."""
    thing = seen.thing
    line = sight.lines.get(seen.key) if seen.key is not None else None
    is_bent = line is not None and len(line.tangents) > 1 and thing.surface_speed_mps != 0.0
    return PersonGoal(
        key=f"object {thing.id}",
        point_m=thing.position_m,
        velocity_mps=thing.velocity_mps,
        stamp_ns=seen.stamp_ns,
        closed_loop=closed_loop,
        kind="belt" if thing.surface == "belt" else "strip",
        curve=line if is_bent else None,
        along_m=thing.surface_position_m,
        speed_mps=thing.surface_speed_mps,
        object_id=thing.id,
        on_line=seen.key is not None and not thing.lit,
        lit=thing.lit,
    )
