"""Simulated participants: any study, whole, in virtual time."""

import math
from collections.abc import Callable

import numpy as np

import pointit
from pointit.study.model import Study, Value
from pointit.study.plan import Progress, plan_of
from pointit.study.questionnaire import Scale
from pointit.study.session import Session, check_simulated
from pointit.study.study_folder import TRIALS, StudyFolder, read_trials
from pointit.study.study_site import SiteOptions
from pointit.study.study_step import StudyStep
from pointit.study.view import StudyCommand, StudyStatus

LIGHT: dict[str, Value] = {"user-sim.rate_hz": 25.0, "led-driver.max_rate_hz": 25.0}
"""Lowest rates of a real wrist and of light that moves, for half of the computing."""


def person_of(study: Study, participant: str) -> dict[str, Value]:
    """Return the parameters of a simulated participant: people differ in speed, steadiness and errors.

    Medians, and the elevation error, are those of user-sim, which were measured. Spreads of times between
    people (log-normal, 0.15 to 0.25) are assumed.
    """
    rng = np.random.default_rng([study.seed, study.people.index(participant), 1])

    def about(median: float, spread: float, maximum: float) -> float:
        factor = math.exp(spread * float(rng.standard_normal()))
        return min(maximum, median * factor)

    # Drawn in this order: another one would make other people of the same seed.
    reaction_s = max(0.2, about(0.35, 0.15, 1.0))
    elevation_bias_deg = float(rng.normal(-2.8, 2.8))
    correction_period_s = about(0.35, 0.15, 1.0)
    reach_per_bit_s = about(0.156, 0.2, 0.6)
    hold_yaw_sd_deg = about(0.25, 0.25, 2.0)
    hold_pitch_sd_deg = about(0.16, 0.25, 2.0)
    lapse_share = about(0.005, 0.5, 0.05)
    return {
        **LIGHT,
        "user-sim.aim.reaction_s": round(reaction_s, 4),
        "user-sim.aim.elevation_bias_deg": round(elevation_bias_deg, 3),
        "user-sim.aim.correction_period_s": round(correction_period_s, 4),
        "user-sim.arm.reach_per_bit_s": round(reach_per_bit_s, 4),
        "user-sim.arm.hold_yaw_sd_deg": round(hold_yaw_sd_deg, 4),
        "user-sim.arm.hold_pitch_sd_deg": round(hold_pitch_sd_deg, 4),
        "user-sim.mind.lapse_share": round(lapse_share, 5),
    }


class SimulatedView:
    """Agrees at once and answers at random, somewhat better than the middle."""

    def __init__(self, seed: int, on_status: Callable[[StudyStatus], None]) -> None:
        """Create with the seed of its answers."""
        self._rng = np.random.default_rng(seed)
        self.status = on_status

    async def tell(self, *steps: StudyStep, go: str) -> bool:
        """Go on."""
        del steps, go
        return True

    async def ask(self, scale: Scale, block: str = "") -> list[int]:
        """Return random answers."""
        del block
        low, high = scale.points
        steps = (high - low) // scale.step
        numbers: list[int] = self._rng.binomial(steps, 0.55, len(scale.items)).tolist()
        return [low + scale.step * number for number in numbers]

    def command(self) -> StudyCommand | None:
        """Return None: nobody interferes."""
        return None


def simulate(
    study: Study,
    folder: StudyFolder,
    participant: str,
    on_status: Callable[[StudyStatus], None],
    *,
    record: bool = False,
) -> None:
    """Run all trials of `participant`, simulated, and write what is not there yet.

    The same study gives the same data, also if it was interrupted: a simulated person who began in the middle
    of a block would have another arm, another time and other answers.

    Raises: ConfigError: If they have finished, or may have been begun by a person. PointItError: If a service
        fails, or data cannot be written.
    """
    about = folder.about(participant)
    data = folder.path / participant
    rows = read_trials(study, data) if (data / TRIALS).exists() else []
    check_simulated(data, about, rows, simulated=True)
    options = SiteOptions(record=record, person=person_of(study, participant))

    def run(data: StudyFolder) -> None:
        view = SimulatedView(study.seed + study.people.index(participant), on_status)
        pointit.run_virtually(Session(study, data, participant, view, options).run())

    is_finished = bool(about.get("ended"))
    run(folder if is_finished else folder.replayed())
    plan = plan_of(study, participant)
    if not is_finished and Progress(plan, read_trials(study, folder.path / participant)).left:
        run(folder)  # what an experimenter had stopped or skipped
