"""A floor, a table and a ceiling, and a person in the origin who points at them."""

from collections.abc import Callable
from typing import Any

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    NS_PER_S,
    ButtonEvent,
    Cursor,
    Environment,
    Feedback,
    Goal,
    Interaction,
    Plane,
    UserPose,
)
from pointit.services.goal.config import GoalConfig
from pointit.services.goal.goal_confirmation import GoalConfirmation, Output

START_NS = 1_700_000_000 * NS_PER_S
EYES: Vec3 = (0.0, 0.0, 1.64)
STEP_S = 0.02
UP: Vec3 = (0.0, 0.0, 1.0)

ROOM = Environment(
    stamp_ns=0,
    name="room",
    planes=(
        Plane(id="floor", center_m=(0.0, 0.0, 0.0), normal=UP),
        Plane(id="ceiling", center_m=(0.0, 0.0, 3.0), normal=(0.0, 0.0, -1.0)),
        Plane(id="wall", center_m=(5.0, 0.0, 0.0), normal=(1.0, 0.0, 0.0)),
    ),
)
POINTING = Interaction(stamp_ns=START_NS, state="pointing")


def cursor(stamp_ns: int, point: Vec3 | None, surface_id: str = "floor", **fields: Any) -> Cursor:
    """The cursor of a ray from the eyes to `point`, or of a ray that hits nothing if None."""
    if point is None:
        return Cursor(stamp_ns=stamp_ns)
    reach = vector.subtract(point, EYES)
    about: dict[str, Any] = {
        "surface_id": surface_id,
        "solid": "plane",
        "point_m": point,
        "origin_m": EYES,
        "direction": vector.normalized(reach),
        "range_m": vector.norm(reach),
    }
    return Cursor(stamp_ns=stamp_ns, **(about | fields))


class Anna:
    """She points, time passes; what comes of it is kept."""

    def __init__(self, *, confirm: str = "again", place: Vec3 | None = (0, 0, 0), **settings: Any) -> None:
        self.steps = GoalConfirmation(GoalConfig.model_validate({"confirm": confirm} | settings), "anna")
        self.now_ns = START_NS
        self.lag_s = 0.0
        self.outputs: list[Output] = []
        self.steps.on_map(ROOM)
        if place is not None:
            self.steps.on_pose("anna", UserPose(stamp_ns=START_NS, position_m=place, yaw_rad=0.0))
        self.steps.on_interaction(POINTING, self.now_ns)

    def stay(self, point: Vec3 | None, lasting_s: float = 1.1, surface_id: str = "floor") -> "Anna":
        for _ in range(round(lasting_s / STEP_S)):
            self.now_ns += round(STEP_S * NS_PER_S)
            stamp_ns = self.now_ns - round(self.lag_s * NS_PER_S)
            self.outputs += self.steps.on_cursor(cursor(stamp_ns, point, surface_id), self.now_ns)
        return self

    def wait(self, lasting_s: float) -> "Anna":
        self.now_ns += round(lasting_s * NS_PER_S)
        self.outputs += self.steps.tick(self.now_ns)
        return self

    def press(self, gesture: Any = "press", ago_s: float = 0.0, source: str = "device") -> "Anna":
        stamp_ns = self.now_ns - round(ago_s * NS_PER_S)
        event = ButtonEvent(stamp_ns=stamp_ns, gesture=gesture, source=source)
        self.outputs += self.steps.on_button(event, self.now_ns)
        return self

    def change(self, what: Callable[[GoalConfirmation], object]) -> "Anna":
        what(self.steps)
        return self

    @property
    def goals(self) -> list[Goal]:
        return [each for each in self.outputs if isinstance(each, Goal)]

    @property
    def cues(self) -> list[str]:
        return [each.cue for each in self.outputs if isinstance(each, Feedback)]

    @property
    def last_text(self) -> str:
        return [each.text for each in self.outputs if isinstance(each, Feedback)][-1]
