"""A room for tests: one belt along x, packages on it, somebody who stands before it and points."""

from collections.abc import Callable, Sequence

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    NS_PER_S,
    Belt,
    Cursor,
    Environment,
    Feedback,
    Hover,
    Selection,
    SelectionEvent,
    TrackedObject,
    TrackedObjects,
)
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.selection_engine import SelectionEngine
from pointit.services.selector.selection_publisher import OutgoingMessage, Record

START_NS = 1_700_000_000 * NS_PER_S
EYES: Vec3 = (5.0, -3.0, 1.6)
MAP = Environment(stamp_ns=0, name="room", belts=(Belt(id="g", line_m=((0.0, 0.0, 0.9), (10.0, 0.0, 0.9))),))

UNHURRIED = {"full_s": 0.8, "sparse_full_s": 0.5, "steady_deg_per_s": 8.0}
"""The gauge of pointing.md §6, on which the times in these tests are reckoned."""


def at(time_s: float) -> int:
    return START_NS + round(time_s * NS_PER_S)


def package(object_id: str, x_m: float, *, speed_mps: float = 0.0, length_m: float = 0.3) -> TrackedObject:
    return TrackedObject(
        id=object_id,
        kind="red",
        position_m=(x_m, 0.0, 0.9),
        velocity_mps=(speed_mps, 0.0, 0.0),
        length_m=length_m,
        surface="belt",
        surface_id="g",
        surface_position_m=x_m,
        surface_speed_mps=speed_mps,
    )


def on_strip(
    object_id: str, position_m: float, *, speed_mps: float = 0.0, strip: str = "0", length_m: float = 0.3
) -> TrackedObject:
    moving = package(object_id, position_m, speed_mps=speed_mps, length_m=length_m)
    return moving.model_copy(update={"surface": "strip", "surface_id": strip})


def cursor_on_strip(stamp_ns: int, position_m: float, strip: str = "0") -> Cursor:
    """Return a cursor without a ray."""
    return Cursor(
        stamp_ns=stamp_ns, surface="strip", surface_id=strip, point_m=(position_m, 0.0, 0.9),
        position_m=position_m,
    )  # fmt: skip


def packages(time_s: float, *objects: TrackedObject) -> TrackedObjects:
    return TrackedObjects(stamp_ns=at(time_s), objects=objects)


def pointing(time_s: float, x_m: float, *, raised_rad: float = 0.0, eyes: Vec3 = EYES) -> Cursor:
    """Return the cursor of a ray to the belt's centre line at `x_m`, raised by an angle."""
    target = (x_m, 0.0, 0.9)
    reach = vector.subtract(target, eyes)
    direction = vector.direction(vector.azimuth(reach), vector.elevation(reach) + raised_rad)
    return Cursor(
        stamp_ns=at(time_s),
        surface="belt",
        surface_id="g",
        point_m=target,
        position_m=x_m,
        miss_rad=abs(raised_rad),
        range_m=vector.norm(reach),
        origin_m=eyes,
        direction=direction,
    )


class Room:
    """A selecting with its outputs by kind; objects are listed again before every cursor."""

    def __init__(self, *objects: TrackedObject, **config: object) -> None:
        self.records: list[Record] = []
        self.config = SelectorConfig.model_validate({"gauge": UNHURRIED, **config})
        self.selecting = SelectionEngine(self.config, self.records.append)
        self.objects: Sequence[TrackedObject] = objects
        self.time_s = 0.0
        self.events: list[SelectionEvent] = []
        self.selections: list[Selection] = []
        self.hovers: dict[str, list[Hover]] = {}
        self.cues: dict[str, list[Feedback]] = {}
        self.take(self.selecting.on_map(MAP))

    @property
    def now_ns(self) -> int:
        return at(self.time_s)

    @property
    def owners(self) -> dict[str, str]:
        return {one.id: one.user for one in self.selecting.selection(self.now_ns).objects}

    @property
    def told(self) -> list[tuple[str, str, str]]:
        return [(event.event, event.object_id, event.user) for event in self.events]

    def take(self, outputs: list[OutgoingMessage]) -> list[OutgoingMessage]:
        for output in outputs:
            message = output.message
            if isinstance(message, Hover):
                self.hovers.setdefault(output.user, []).append(message)
            elif isinstance(message, Feedback):
                self.cues.setdefault(output.user, []).append(message)
            elif isinstance(message, Selection):
                assert output.user == ""
                self.selections.append(message)
            else:
                assert isinstance(message, SelectionEvent)
                self.events.append(message)
        return outputs

    def list_objects(self) -> None:
        moved = [
            one.model_copy(update={"position_m": (x_m, 0.0, 0.9), "surface_position_m": x_m})
            for one in self.objects
            for x_m in (one.surface_position_m + one.surface_speed_mps * self.time_s,)
        ]
        self.take(self.selecting.on_objects("conveyor", packages(self.time_s, *moved)))

    def stay(
        self, duration_s: float, rate_hz: float = 50.0, **where: float | Callable[[float], float]
    ) -> None:
        """Have people point for some time, each (by name) at a place on the belt, m, or one of the time."""
        end_s = self.time_s + duration_s
        count = 0
        began_s = self.time_s
        while self.time_s < end_s - 1e-9:
            count += 1
            self.time_s = began_s + count / rate_hz
            self.list_objects()
            for user, place in where.items():
                x_m = place(self.time_s) if callable(place) else place
                self.take(self.selecting.on_cursor(user, pointing(self.time_s, x_m)))

    def wait(self, duration_s: float) -> None:
        """Let time pass, with objects listed, and nobody pointing."""
        self.stay(duration_s, 10.0)
        self.take(self.selecting.tick(self.now_ns))
