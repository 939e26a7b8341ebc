"""Checks of selection methods, and the harness that their author gives."""

import math
import random
import statistics
import time
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
from pointit.runtime.clock import START_NS
from pointit.schemas import TrackedObject
from pointit.services.selector.seen_objects import VisibleObject
from pointit.testing.requirements import require_bounded_memory, require_parameters, require_refusals
from pointit.testing.trial import CheckFailedError, Harness, Suite, called

__all__ = [
    "APART_RAD",
    "BESIDE",
    "CENTERS_M",
    "COUNT",
    "GAP_S",
    "HALF_M",
    "MANY",
    "METHOD_SUITE",
    "NEAR_RAD",
    "PASSING_SHARE",
    "PATIENT_DWELLS",
    "RANGE_M",
    "RATE_HZ",
    "RECENT_NS",
    "SLOWEST_S",
    "STEP_S",
    "MethodHarness",
    "Person",
    "config_errors",
    "deterministic",
    "gaps",
    "latches",
    "many_objects",
    "odd_cursors",
    "parameters",
    "passes",
    "progress",
    "selects",
    "selects_only_hovered",
]


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


PATIENT_DWELLS = 4.0
"""Number of dwell times after which a stay must select."""
SLOWEST_S = 2.0
PASSING_SHARE = 0.15
"""Share of the dwell time that a passing cursor spends on each object."""
GAP_S = 30.0
STEP_S = 0.002
"""Median time of `step` above which it is too slow for many people, s."""
MANY = 4000
METHOD_SUITE: Suite[MethodHarness] = Suite()


def _selects(person: Person, target: str) -> list[str]:
    return person.stay(target, PATIENT_DWELLS * person.dwell_s + SLOWEST_S)


def _wander(person: Person, seed: int) -> None:
    """Point at random objects for random times."""
    chance = random.Random(seed)  # noqa: S311 - the same path in each run
    for _ in range(40):
        target = BESIDE if chance.random() < 0.3 else f"object {chance.randrange(4)}"
        person.stay(target, chance.uniform(0.02, 3.0 * person.dwell_s))


@METHOD_SUITE.check("Derive the parameters from pointit.plugins.MethodConfig, or give them a `dwell_s`")
async def parameters(harness: MethodHarness) -> None:
    """Has a summary of one line, a description for each parameter, and a dwell time."""
    require_parameters(harness.plugin)
    config: object = harness.plugin.config.model_validate(dict(harness.parameters))
    dwell_s = getattr(config, "dwell_s", None)
    if not isinstance(dwell_s, float) or not 0.0 < dwell_s <= 10.0:
        raise CheckFailedError(f"`dwell_s` is {dwell_s!r}, expected seconds, above 0 and up to 10")


@METHOD_SUITE.check(
    "Limit parameters by `Field(gt=…, le=…)`, or raise pointit.plugins.ConfigError from `make`"
)
async def config_errors(harness: MethodHarness) -> None:
    """Refuses parameters that cannot work, with ConfigError and nothing else."""
    require_refusals(harness, lambda config: harness.plugin.make(config, Surroundings.detached()))


@METHOD_SUITE.check(
    "Return `SelectionProgress(object_id, fired=object_id)` when the person has stayed for the dwell time by "
    "the cursors' stamps"
)
async def selects(harness: MethodHarness) -> None:
    """Selects the object that a person stays on, once."""
    person = Person(harness)
    person.stay(BESIDE, 1.0)
    fired = _selects(person, "object 3")
    if fired != ["object 3"]:
        raise CheckFailedError(f"the person stayed on 'object 3', and there fired {fired or 'nothing'}")
    if "object 3" not in person.latched():
        raise CheckFailedError("'object 3' fired, and is not in `latched`")


@METHOD_SUITE.check("Keep an object that fired or was latched in `latched` until the person points elsewhere")
async def latches(harness: MethodHarness) -> None:
    """Selects again only after the object was left."""
    person = Person(harness)
    person.stay(BESIDE, 1.0)
    person.stay("object 3", 0.1)
    person.method.latch("object 3")
    if "object 3" not in person.latched() or _selects(person, "object 3"):
        raise CheckFailedError("'object 3' was latched, and fired all the same")
    person.stay(BESIDE, SLOWEST_S)
    if person.latched():
        raise CheckFailedError(f"the person left 'object 3', and {person.latched()} stayed latched")
    if _selects(person, "object 3") != ["object 3"]:
        raise CheckFailedError("the person left 'object 3' and came back, and it did not fire")


@METHOD_SUITE.check("Return as `fired` only an object that is hovered, and None while nothing is")
async def selects_only_hovered(harness: MethodHarness) -> None:
    """Selects nothing that is not pointed at."""
    for seed in range(5):
        person = Person(harness)
        _wander(person, seed)
        if person.unprovoked:
            raise CheckFailedError(person.unprovoked)
    person = Person(harness)
    if person.stay(BESIDE, 10 * person.dwell_s):
        raise CheckFailedError("the person pointed at nothing, and something fired")


@METHOD_SUITE.check("Count only time that is spent on the same object, and forget it when the object is left")
async def passes(harness: MethodHarness) -> None:
    """Selects nothing that the person passes."""
    person = Person(harness)
    for number in range(4 * COUNT):
        fired = person.stay(f"object {number % COUNT}", PASSING_SHARE * person.dwell_s)
        if fired:
            raise CheckFailedError(
                f"the person spent {PASSING_SHARE:.0%} of the dwell time on each of many objects, and "
                f"{fired[0]!r} fired"
            )


@METHOD_SUITE.check("Return the share of the dwell time that has passed as `progress`, at most 1.0")
async def progress(harness: MethodHarness) -> None:
    """Reports a progress of 0 to 1 that grows while a person stays."""
    person = Person(harness)
    person.stay(BESIDE, 1.0)
    _selects(person, "object 3")
    _wander(person, 1)
    for result in person.results:
        if not (math.isfinite(result.progress) and 0.0 <= result.progress <= 1.0):
            raise CheckFailedError(f"a progress was {result.progress!r}")
    if not any(0.0 < result.progress < 1.0 for result in person.results):
        raise CheckFailedError("no progress between 0 and 1 was reported")


@METHOD_SUITE.check(
    "Keep all state in the object that `make` returns; use no clock, no chance and no variable of the class"
)
async def deterministic(harness: MethodHarness) -> None:
    """Gives the same results for the same cursors, beside other people, too."""
    alone = Person(harness)
    _wander(alone, 7)
    _selects(alone, "object 1")
    together, other = Person(harness), Person(harness, "ben")
    _wander(other, 8)
    _wander(together, 7)
    other.stay("object 1", other.dwell_s / 2)
    _selects(together, "object 1")
    if together.results != alone.results:
        raise CheckFailedError("the same cursors gave other results while another person pointed, too")


@METHOD_SUITE.check("Begin again from zero when two stamps are further apart than some tenths of a second")
async def gaps(harness: MethodHarness) -> None:
    """Takes a gap between cursors for no stay."""
    person = Person(harness)
    person.stay(BESIDE, 1.0)
    for _ in range(5):
        person.stay("object 3", 1 / RATE_HZ)
        person.now_ns += round(GAP_S * NS_PER_S)
    if person.fired:
        raise CheckFailedError(f"two cursors {GAP_S:g} s apart were on 'object 3', and it fired")


@METHOD_SUITE.check(
    "Use differences of stamps only if they are above 0, and `pointing.under` if `pointing.view` is None"
)
async def odd_cursors(harness: MethodHarness) -> None:
    """Survives stamps that go back or stand still, and cursors without a ray."""
    person = Person(harness)
    person.stay("object 3", person.dwell_s / 2)
    for back_ns in (0, 1, NS_PER_S, 100 * NS_PER_S):
        person.now_ns -= back_ns
        person.step("object 3")
        person.step("object 3", has_ray=False)
        person.step(BESIDE, has_ray=False)
    if set(person.fired) - {"object 3"}:
        raise CheckFailedError(f"the person pointed at 'object 3', and {person.fired} fired")
    person = Person(harness)
    if _selects(person, "object 5") != ["object 5"]:
        raise CheckFailedError("afterwards a new person stayed on 'object 5', and it did not fire")


@METHOD_SUITE.check("Keep only what concerns objects that are near or were just left", alone=True)
async def many_objects(harness: MethodHarness) -> None:
    """Stays quick and small, however many objects pass."""
    person = Person(harness)
    took_s: list[float] = []

    async def pass_by() -> None:
        for number in range(MANY):
            began_s = time.perf_counter()
            person.stay("object 3", 1 / RATE_HZ, prefix=f"package {number} of a long day, ")
            took_s.append(time.perf_counter() - began_s)
            person.results.clear()

    await require_bounded_memory(pass_by, f"{MANY} objects")
    if statistics.median(took_s) > STEP_S:
        raise CheckFailedError(f"a `step` took {statistics.median(took_s) * 1e3:.1f} ms")
