"""Simulated participants: any study, whole, in virtual time."""

import math
from collections.abc import Callable

import numpy as np

import pointit
from pointit.study.data import StudyFolder
from pointit.study.model import Study, Value
from pointit.study.questionnaires import Scale
from pointit.study.session import Session
from pointit.study.site.study_site import SiteOptions
from pointit.study.step import Step
from pointit.study.view import Command, Status

LIGHT: dict[str, Value] = {"user-sim.rate_hz": 25.0, "led-driver.max_rate_hz": 25.0}
"""Lowest rates of a real wrist and of light that moves, for half of the computing."""


def person_of(study: Study, participant: str) -> dict[str, Value]:
    """Return the parameters of a simulated participant: people differ in speed, steadiness and errors.

    Medians, and the elevation error, are those of user-sim, which were measured. Spreads of times between
    people (log-normal, 0.15 to 0.25) are assumed.
    """
    rng = np.random.default_rng([study.seed, study.people.index(participant), 1])

    def about(median: float, spread: float, most: float) -> float:
        return min(most, median * math.exp(spread * float(rng.standard_normal())))

    return {
        **LIGHT,
        "user-sim.aim.reaction_s": round(max(0.2, about(0.35, 0.15, 1.0)), 4),
        "user-sim.aim.elevation_bias_deg": round(float(rng.normal(-2.8, 2.8)), 3),
        "user-sim.aim.correction_period_s": round(about(0.35, 0.15, 1.0), 4),
        "user-sim.arm.reach_per_bit_s": round(about(0.156, 0.2, 0.6), 4),
        "user-sim.arm.hold_yaw_sd_deg": round(about(0.25, 0.25, 2.0), 4),
        "user-sim.arm.hold_pitch_sd_deg": round(about(0.16, 0.25, 2.0), 4),
        "user-sim.mind.lapse_share": round(about(0.005, 0.5, 0.05), 5),
    }


class SimulatedView:
    """Agrees at once and answers at random, somewhat better than the middle."""

    def __init__(self, seed: int, on_status: Callable[[Status], None]) -> None:
        """Create with the seed of its answers."""
        self._rng = np.random.default_rng(seed)
        self.status = on_status

    async def tell(self, *steps: Step, go: str) -> bool:
        """Go on."""
        del steps, go
        return True

    async def ask(self, scale: Scale) -> list[int]:
        """Return random answers."""
        low, high = scale.points
        steps = (high - low) // scale.step
        return [low + scale.step * int(n) for n in self._rng.binomial(steps, 0.55, len(scale.items))]

    def command(self) -> Command | None:
        """Return None: nobody interferes."""
        return None


def simulate(
    study: Study,
    folder: StudyFolder,
    participant: str,
    on_status: Callable[[Status], None],
    *,
    record: bool = False,
) -> None:
    """Run what is left for `participant`, simulated; the same study gives the same data.

    Raises: ConfigError: If they have finished. PointItError: If a service fails, or data cannot be written.
    """
    view = SimulatedView(study.seed + study.people.index(participant), on_status)
    setup = SiteOptions(record=record, person=person_of(study, participant))
    pointit.run_virtually(Session(study, folder, participant, view, setup).run())
