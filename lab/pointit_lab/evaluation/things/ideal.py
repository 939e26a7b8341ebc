"""The best that any judge can do for people who get no feedback: a bound for methods."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from pointit.geometry import vector
from pointit.services.user_sim.body import BENT_ARM_RAD, USUAL_REACH_RAD
from pointit.services.user_sim.config import AimConfig
from pointit_lab.evaluation.things.reach import POSE_RAD, angles
from pointit_lab.evaluation.things.things import EYES_M, ThingRow, begin

Array = NDArray[np.float64]

BENT_STEPS = 20
"""Number of errors of a bent arm by which their uniform distribution is replaced."""


def max_right(row: ThingRow, first: int, count: int, wrong: float) -> float:
    """Return the share of reaches without light that an ideal judge gets right, at most `wrong` wrong.

    The judge knows the distribution of people's errors, from where the arm came (errors grow with the way),
    and the azimuth at which it rests, by which alone the things of a row differ. The reaches are those of
    `count` seeds from `first` on.
    """
    things = row.environment().things
    sights = np.array([angles(vector.subtract(thing.center_m, EYES_M)) for thing in things])
    goals, likely = np.empty(count, dtype=np.intp), np.empty((count, len(things)))
    for index in range(count):
        goal, person = begin(row, np.random.default_rng([first + index, row.count]))
        goals[index] = goal
        ways = np.linalg.norm(sights - person.now, axis=1)
        likely[index] = _density(person.rest[0] - sights[:, 0], ways)
    sure = likely.max(axis=1) / likely.sum(axis=1)
    is_right = (likely.argmax(axis=1) == goals)[np.argsort(-sure)]
    fired = np.cumsum(~is_right) <= wrong * count
    return float(np.sum(is_right[fired])) / count


def _density(errors_rad: Array, ways_rad: Array) -> Array:
    aim = AimConfig()
    shares = np.minimum(ways_rad / USUAL_REACH_RAD, 1.0)
    sigmas = np.hypot(math.radians(aim.azimuth_error_reach_sd_deg) * shares, POSE_RAD[0])
    steps = np.linspace(*BENT_ARM_RAD, BENT_STEPS)
    bent = np.mean([norm.pdf(errors_rad, step, sigmas) for step in (*steps, *-steps)], axis=0)
    sideways = aim.bent_arm_share / 2.0  # the other half of bent arms is off in elevation
    return np.asarray((1.0 - sideways) * norm.pdf(errors_rad, 0.0, sigmas) + sideways * bent)
