"""Harness of a selection method, given by its author, and a person who points by it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.plugins import (
    NS_PER_S,
    Cursor,
    PointingSample,
    SelectionMethod,
    SelectionProgress,
    Surroundings,
    View,
)
from pointit.runtime.virtual_time import START_NS
from pointit.schemas import TrackedObject
from pointit.services.selector.objects.view import VisibleObject
from pointit.testing.check import Harness, called

RATE_HZ = 50
APART_RAD = math.radians(15)
"""Angle between neighbouring objects at the eyes."""
RANGE_M = 3.0
HALF_M = 0.15
NEAR_RAD = math.radians(25)
"""Angle from the ray up to which objects are near."""
COUNT = 24
"""Number of objects about the person: a full circle."""
CENTERS_M = tuple(vector.scale(vector.direction(number * APART_RAD, 0.0), RANGE_M) for number in range(COUNT))
RECENT_NS = NS_PER_S // 5
"""Time for which an object counts as pointed at: a method may sample the cursor."""
BESIDE = "nothing"
"""Aim between two objects."""


@dataclass(frozen=True, kw_only=True)
class MethodHarness(Harness[SelectionMethod]):
    """A selection method. It has no device: the checks point by themselves."""

    parameters: Mapping[str, object] = field(default_factory=dict[str, object])
    """Parameters with which it is checked."""


class Person:
    """A person who points at numbered objects about them, `object 0` to `object 23`."""

    def __init__(self, harness: MethodHarness, name: str = "anna") -> None:
        """Create the method.

        Raises:
            CheckFailedError: If it cannot be created.
        """
        plugin = harness.plugin
        self._by_angle = plugin.by_angle
        config: Any = plugin.config.model_validate(dict(harness.parameters))
        self.dwell_s: float = config.dwell_s
        with called("make"):
            self.method = plugin.make(config, Surroundings.detached(name))
        self.now_ns = START_NS
        self.results: list[SelectionProgress] = []
        """Results so far."""
        self.unprovoked = ""
        """First selection of an object that was not pointed at in the last `RECENT_NS`, in words, or `""`."""
        self._pointed_ns: dict[str, int] = {}

    @property
    def fired(self) -> list[str]:
        """Return the objects that fired so far."""
        return [result.fired for result in self.results if result.fired is not None]

    def latched(self) -> set[str]:
        """Return the objects that fired and were not left since."""
        return set(self.method.latched)

    def stay(self, target: str, duration_s: float, prefix: str = "object ") -> list[str]:
        """Point at `target`, an object or `BESIDE`, for `duration_s`. Return the objects that fired.

        Raises:
            CheckFailedError: If the method raises.
        """
        before = len(self.results)
        for _ in range(max(1, round(duration_s * RATE_HZ))):
            self.now_ns += NS_PER_S // RATE_HZ
            self.step(target, prefix)
        return [result.fired for result in self.results[before:] if result.fired is not None]

    def step(self, target: str, prefix: str = "object ", *, has_ray: bool = True) -> SelectionProgress:
        """Process one cursor now. Return the method's result.

        Raises:
            CheckFailedError: If the method raises.
        """
        number = 0.5 if target == BESIDE else float(target.rpartition(" ")[2])
        direction = vector.direction(number * APART_RAD, 0.0)
        cursor = Cursor(
            stamp_ns=self.now_ns,
            seq=len(self.results),
            surface="none" if target == BESIDE else "belt",
            surface_id="" if target == BESIDE else "1",
            point_m=None if target == BESIDE else vector.scale(direction, RANGE_M),
            range_m=RANGE_M,
            origin_m=(0.0, 0.0, 0.0) if has_ray else None,
            direction=direction if has_ray else None,
        )
        view = _view(direction, prefix) if self._by_angle and has_ray else None
        under = None if target == BESIDE or view is not None else f"{prefix}{number:g}"
        with called("step"):
            result = self.method.step(PointingSample(cursor, under, view, _acts))
        self.results.append(result)
        self._pointed_ns[target] = self.now_ns
        fired = result.fired
        if fired is not None and abs(self.now_ns - self._pointed_ns.get(fired, 0)) > RECENT_NS:
            self.unprovoked = self.unprovoked or f"the person pointed at {target!r}, and {fired!r} fired"
        return result


def _acts(_object_id: str) -> bool:
    return True


def _view(direction: Vec3, prefix: str) -> View:
    seen: list[VisibleObject] = []
    for number, center_m in enumerate(CENTERS_M):
        if vector.dot(direction, center_m) > RANGE_M * math.cos(NEAR_RAD):
            angle_rad = vector.angle_between(direction, center_m)
            still = (0.0, 0.0, 0.0)
            half_rad = math.atan(HALF_M / RANGE_M)
            tracked = TrackedObject(id=f"{prefix}{number}", kind="", position_m=center_m, length_m=2 * HALF_M)
            around = (center_m, still, still, HALF_M, RANGE_M, None, tracked)
            seen.append(VisibleObject(tracked.id, angle_rad, half_rad, *around))
    return View(direction, seen)
