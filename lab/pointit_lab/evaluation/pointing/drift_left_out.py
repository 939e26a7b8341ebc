"""Leave-one-person-out: each person is predicted with the drift settings that served the others best."""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product

import numpy as np

from pointit.services.localizer.drift.model import DriftSettings
from pointit_lab.evaluation.pointing.drift_solvers import Trial, YawEstimate, filtered

ANCHOR_SIGMA_DEG = (2.0, 2.5, 3.0, 3.5)
RATE_WALK_DEGPS = (0.005, 0.01, 0.02)
OUTLIER_SHARE = (0.005, 0.02)
"""Values that are tried; the rest of the settings is kept."""


def candidates() -> Iterator[DriftSettings]:
    """Yield the settings that are tried."""
    for anchor_deg, walk_degps, outlier in product(ANCHOR_SIGMA_DEG, RATE_WALK_DEGPS, OUTLIER_SHARE):
        yield DriftSettings(
            anchor_sigma_rad=math.radians(anchor_deg),
            rate_walk_radps=math.radians(walk_degps),
            outlier_share=outlier,
        )


def left_out(
    trials: Mapping[str, Sequence[Trial]],
) -> dict[str, list[tuple[Trial, YawEstimate]]]:
    """Return each trial's prediction with the settings that others chose, by condition.

    The settings are those of the least error: absolute, averaged over conditions of each person, then over
    people.

    Args:
        trials: by condition.
    """
    told = [
        {
            name: [(one, filtered(one.course, one.anchors, one.told, settings)) for one in some]
            for name, some in trials.items()
        }
        for settings in candidates()
    ]
    people = {one.course.subject for some in trials.values() for one in some}
    best = {
        person: min(told, key=lambda each: np.mean([_error_rad(each, other) for other in people - {person}]))
        for person in people
        if len(people) > 1
    }
    return {
        name: [
            best[one.course.subject][name][index]
            for index, one in enumerate(some)
            if one.course.subject in best
        ]
        for name, some in trials.items()
    }


def _error_rad(told: Mapping[str, Sequence[tuple[Trial, YawEstimate]]], person: str) -> float:
    """Return the person's mean absolute error, averaged over conditions."""
    errors = [
        [abs(one.error_rad(guess)) for one, guess in some if one.course.subject == person]
        for some in told.values()
    ]
    return float(np.mean([np.mean(some) for some in errors if some]))
