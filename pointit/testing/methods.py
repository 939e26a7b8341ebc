"""The contract of selection methods."""

import math
import random
import statistics
import time
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.plugins import NS_PER_S, Cursor, PointingSample, SelectionProgress, Surroundings, View
from pointit.schemas import TrackedObject
from pointit.services.selector.seen_objects import VisibleObject
from pointit.testing.bench import START_NS
from pointit.testing.contract import (
    Contract,
    called,
    promise,
    require,
    require_bounded_memory,
    require_parameters,
)

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
PATIENT_DWELLS = 4.0
"""Number of dwell times after which a stay must select."""
SLOWEST_S = 2.0
PASSING_SHARE = 0.15
"""Share of the dwell time that a passing cursor spends on each object."""
GAP_S = 30.0
STEP_S = 0.002
"""Median time of `step` above which it is too slow for many people, s."""
MANY = 4000


class Person:
    """A person who points at numbered objects about them, `object 0` to `object 23`."""

    def __init__(self, contract: "SelectionMethodContract", name: str = "anna") -> None:
        """Create the method.

        Raises:
            CheckFailedError: If it cannot be created.
        """
        plugin = contract.plugin
        self._by_angle = plugin.by_angle
        config: Any = plugin.config.model_validate(dict(contract.parameters))
        self.dwell_s: float = config.dwell_s
        with called("make"):
            self.method = plugin.make(config, Surroundings.detached(name))
        self.now_ns = START_NS
        self.results: list[SelectionProgress] = []
        """Results so far."""
        self.unprovoked = ""
        """First selection of an object that was not pointed at in the last `RECENT_NS`, in words, or `""`."""
        self._pointed_ns: dict[str, int] = {}

    def stay(self, target: str, duration_s: float, prefix: str = "object ") -> list[str]:
        """Point at `target`, an object or `BESIDE`, for `duration_s`. Return the objects that fired.

        Raises:
            CheckFailedError: If the method raises.
        """
        count = len(self.results)
        for _ in range(max(1, round(duration_s * RATE_HZ))):
            self.now_ns += NS_PER_S // RATE_HZ
            self.step(target, prefix)
        new_results = self.results[count:]
        return [result.fired for result in new_results if result.fired is not None]

    def step(self, target: str, prefix: str = "object ", *, has_ray: bool = True) -> SelectionProgress:
        """Process one cursor now. Return the method's result.

        Raises:
            CheckFailedError: If the method raises.
        """
        # A cursor on the belt or beside all objects, with or without its ray
        number = 0.5
        surface = "none"
        surface_id = ""
        if target != BESIDE:
            number = float(target.rpartition(" ")[2])
            surface = "belt"
            surface_id = "1"
        direction = vector.direction(number * APART_RAD, 0.0)
        point_m = None if target == BESIDE else vector.scale(direction, RANGE_M)
        cursor = Cursor(
            stamp_ns=self.now_ns,
            seq=len(self.results),
            surface=surface,
            surface_id=surface_id,
            point_m=point_m,
            range_m=RANGE_M,
            origin_m=(0.0, 0.0, 0.0) if has_ray else None,
            direction=direction if has_ray else None,
        )

        # A method by angle sees all objects near the ray, another one only the object under the cursor
        view = None
        if self._by_angle and has_ray:
            view = _view(direction, prefix)
        under = None
        if target != BESIDE and view is None:
            under = f"{prefix}{number:g}"
        with called("step"):
            result = self.method.step(PointingSample(cursor, under, view, _acts))
        self.results.append(result)

        # An object may only fire while it is pointed at, or shortly after
        self._pointed_ns[target] = self.now_ns
        fired = result.fired
        if fired is not None:
            passed_ns = self.now_ns - self._pointed_ns.get(fired, 0)
            if abs(passed_ns) > RECENT_NS:
                problem = f"the person pointed at {target!r}, and {fired!r} fired"
                self.unprovoked = self.unprovoked or problem
        return result

    def select(self, target: str) -> list[str]:
        """Stay on `target` for long enough to select it. Return the objects that fired."""
        return self.stay(target, PATIENT_DWELLS * self.dwell_s + SLOWEST_S)

    def wander(self, seed: int) -> None:
        """Point at random objects for random times."""
        chance = random.Random(seed)  # noqa: S311 - the same path in each run
        for _ in range(40):
            is_beside = chance.random() < 0.3
            target = BESIDE if is_beside else f"object {chance.randrange(4)}"
            self.stay(target, chance.uniform(0.02, 3.0 * self.dwell_s))


def _acts(_object_id: str) -> bool:
    return True


def _view(direction: Vec3, prefix: str) -> View:
    visible: list[VisibleObject] = []
    for number, center_m in enumerate(CENTERS_M):
        if vector.dot(direction, center_m) > RANGE_M * math.cos(NEAR_RAD):
            angle_rad = vector.angle_between(direction, center_m)
            still = (0.0, 0.0, 0.0)
            half_rad = math.atan(HALF_M / RANGE_M)
            tracked = TrackedObject(id=f"{prefix}{number}", kind="", position_m=center_m, length_m=2 * HALF_M)
            geometry = (center_m, still, still, HALF_M, RANGE_M, None, tracked)
            visible.append(VisibleObject(tracked.id, angle_rad, half_rad, *geometry))
    return View(direction, visible)


class SelectionMethodContract(Contract):
    """Promises of a selection method. It has no device: the tests point by themselves."""

    parameters: Mapping[str, object] = MappingProxyType({})
    """Parameters with which it is tested."""

    @promise()
    async def test_parameters(self) -> None:
        """Describes itself and its parameters, has a dwell time, and refuses what cannot work."""
        config = self.plugin.config.model_validate(dict(self.parameters))
        dwell_s = getattr(config, "dwell_s", None)
        require(
            isinstance(dwell_s, float) and 0.0 < dwell_s <= 10.0,
            f"`dwell_s` is {dwell_s!r}, expected seconds, above 0 and up to 10",
            "Derive the parameters from pointit.plugins.MethodConfig",
        )
        require_parameters(self, lambda config: self.plugin.make(config, Surroundings.detached()))

    @promise()
    async def test_selects(self) -> None:
        """Selects the object that a person stays on, once until it was left; tells progress from 0 to 1."""
        # Staying fires once, and nothing else does
        person = Person(self)
        person.stay(BESIDE, 1.0)
        fired = person.select("object 3")
        require(
            fired == ["object 3"],
            f"the person stayed on 'object 3', and there fired {fired or 'nothing'}",
            "Return `SelectionProgress(id, fired=id)` once, after the dwell time by the cursors' stamps",
        )
        latch = "Keep what fired or was latched in `latched` until the person points elsewhere"
        require("object 3" in person.method.latched, "'object 3' fired, and is not in `latched`", latch)
        person.wander(1)
        values = [result.progress for result in person.results]
        odd = [value for value in values if not 0.0 <= value <= 1.0]  # NaN, too
        require(not odd, f"a progress was {odd[:1]}", "Return the share of the dwell time, at most 1.0")
        require(any(0.0 < value < 1.0 for value in values), "no progress between 0 and 1 was reported")
        # A latch of others counts like one's own, until the person has left the object
        person = Person(self)
        person.stay("object 3", 0.1)
        person.method.latch("object 3")
        require(not person.select("object 3"), "'object 3' was latched, and fired all the same", latch)
        person.stay(BESIDE, SLOWEST_S)
        latched = set(person.method.latched)
        require(not latched, f"the person left 'object 3', and {latched} stayed latched", latch)
        require(
            person.select("object 3") == ["object 3"],
            "the person left 'object 3' and came back, and it did not fire",
            latch,
        )

    @promise()
    async def test_selects_nothing_else(self) -> None:
        """Selects nothing that is not pointed at, that is passed, or at which cursors only begin and end."""
        # Nothing but the object under the cursor
        for seed in range(5):
            person = Person(self)
            person.wander(seed)
            require(not person.unprovoked, person.unprovoked, "Fire only the object that is hovered")
        person = Person(self)
        fired = person.stay(BESIDE, 10 * person.dwell_s)
        require(not fired, f"the person pointed at nothing, and {fired} fired", "Fire only what is hovered")
        # Many objects, each for less than the dwell time
        person = Person(self)
        for number in range(4 * COUNT):
            duration_s = PASSING_SHARE * person.dwell_s
            fired = person.stay(f"object {number % COUNT}", duration_s)
            require(
                not fired,
                f"the person spent {PASSING_SHARE:.0%} of the dwell time on each of many: {fired} fired",
                "Count only time that is spent on the same object, and forget it when the object is left",
            )
        # Two cursors that are far apart in time: nobody knows where the person pointed in between
        person = Person(self)
        for _ in range(5):
            fired = person.stay("object 3", 1 / RATE_HZ)
            require(
                not fired,
                f"two cursors {GAP_S:g} s apart were on 'object 3', and it fired",
                "Begin again from zero when two stamps are further apart than some tenths of a second",
            )
            person.now_ns += round(GAP_S * NS_PER_S)

    @promise()
    async def test_deterministic(self) -> None:
        """Gives the same results for the same cursors, beside other people, too."""
        # The same path twice, the second time in turns with another person
        alone = Person(self)
        alone.wander(7)
        alone.select("object 1")
        together = Person(self)
        other = Person(self, "ben")
        other.wander(8)
        together.wander(7)
        other.stay("object 1", other.dwell_s / 2)
        together.select("object 1")
        require(
            together.results == alone.results,
            "the same cursors gave other results while another person pointed, too",
            "Keep all state in the object that `make` returns; use no clock and no chance",
        )

    @promise()
    async def test_odd_cursors(self) -> None:
        """Survives stamps that go back or stand still, and cursors without a ray."""
        person = Person(self)
        person.stay("object 3", person.dwell_s / 2)
        for back_ns in (0, 1, NS_PER_S, 100 * NS_PER_S):
            person.now_ns -= back_ns
            for target, has_ray in (("object 3", True), ("object 3", False), (BESIDE, False)):
                fired = person.step(target, has_ray=has_ray).fired
                require(fired in {None, "object 3"}, f"the person pointed at 'object 3', and {fired} fired")

    @promise()
    async def test_many_objects(self) -> None:
        """Stays quick and small, however many objects pass."""
        person = Person(self)
        took_s: list[float] = []

        async def pass_by() -> None:
            for number in range(MANY):
                began_s = time.perf_counter()
                person.stay("object 3", 1 / RATE_HZ, prefix=f"package {number} of a long day, ")
                took_s.append(time.perf_counter() - began_s)
                person.results.clear()

        remedy = "Keep only what concerns objects that are near or were just left"
        await require_bounded_memory(pass_by, f"{MANY} objects", remedy)
        median_s = statistics.median(took_s)
        median_ms = median_s * 1e3
        require(median_s <= STEP_S, f"a `step` took {median_ms:.1f} ms", remedy)
