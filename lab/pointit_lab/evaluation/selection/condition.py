"""Evaluated conditions: those of the paper's group, and a sweep on the paper's conveyor."""

from collections.abc import Sequence
from dataclasses import dataclass

LAB = "belts_lab"
CONVEYOR = "conveyor"

LAB_SPEEDS_MPS = (0.2, 0.5, 0.9)
"""Speeds of the levels 1, 2, 3 with moving packages."""

RING_M = 10.0
"""Total length of the two strips of the laboratory."""


@dataclass(frozen=True, kw_only=True)
class Condition:
    """Parameters of one condition, evaluated for each method."""

    bench: str
    name: str
    speed_mps: float
    packages: int
    targets: int
    spacing_m: float
    """Mean distance from centre to centre."""
    users: int = 1

    @property
    def per_package(self) -> bool:
        """Return True if packages pass by, so that times count per package and not per run."""
        return self.bench != LAB


def lab_condition(motion: str, level: int, speed_mps: float) -> str:
    """Return the name of a condition of the laboratory."""
    if motion == "moving":
        return f"moving, {speed_mps:g} m/s"
    return f"static, {level} of {3 * level}"


def conditions(benches: Sequence[str] = ()) -> list[Condition]:
    """Return the conditions of `benches` (empty: of all)."""
    selected: list[Condition] = []
    for bench, own_conditions in ((LAB, _lab()), (CONVEYOR, _conveyor())):
        if not benches or bench in benches:
            selected += own_conditions
    return selected


def _lab() -> list[Condition]:
    """Return the conditions of the recordings: standing packages by number, moving ones by speed."""
    conditions: list[Condition] = []
    for level in (1, 2, 3):
        static = _lab_condition("static", level, speed_mps=0.0, packages=3 * level, targets=level)
        conditions.append(static)
    for level, speed_mps in enumerate(LAB_SPEEDS_MPS, start=1):
        moving = _lab_condition("moving", level, speed_mps=speed_mps, packages=9, targets=3)
        conditions.append(moving)
    return conditions


def _lab_condition(motion: str, level: int, *, speed_mps: float, packages: int, targets: int) -> Condition:
    return Condition(
        bench=LAB,
        name=lab_condition(motion, level, speed_mps),
        speed_mps=speed_mps,
        packages=packages,
        targets=targets,
        spacing_m=RING_M / packages,
    )


def _conveyor() -> list[Condition]:
    """Return conditions with one parameter varied at a time, after the default one."""

    def condition(
        name: str, *, speed_mps: float = 0.5, packages: int = 12, spacing_m: float = 2.0, users: int = 1
    ) -> Condition:
        return Condition(
            bench=CONVEYOR,
            name=name,
            speed_mps=speed_mps,
            packages=packages,
            targets=packages // 3,
            spacing_m=spacing_m,
            users=users,
        )

    # a third of the packages are targets in all of them
    return [
        condition("0.5 m/s, 12 packages 2 m apart"),
        condition("1 m/s", speed_mps=1.0),
        condition("2 m/s", speed_mps=2.0),
        condition("0.6 m apart", spacing_m=0.6),
        condition("1 m apart", spacing_m=1.0),
        condition("6 packages", packages=6),
        condition("24 packages", packages=24),
        condition("2 users", users=2),
        condition("4 users", users=4),
    ]
