"""Rays that leap away from their neighbours."""

import numpy as np
import pytest

from pointit.services.localizer.verification.holds import NEIGHBOURS, without_spikes
from tests.unit.localizer.person import Person, pointings

SPIKE = np.array([-1.0, 0.2, 0.1]) / np.linalg.norm([-1.0, 0.2, 0.1])


@pytest.mark.parametrize("at", [0, 1, 20, 38, 39])
def test_one_ray_that_leaps_is_left_out_and_no_other(at: int) -> None:
    steady = pointings(Person(), [(3.0, 1.0, 1.0)], each=40, noise_rad=0.01)
    assert len(without_spikes(steady)) == 40
    steady.directions[at] = SPIKE
    left = without_spikes(steady)
    assert list(left.stamps_s) == [stamp for index, stamp in enumerate(steady.stamps_s) if index != at]


def test_too_few_rays_have_no_neighbours_to_leap_from() -> None:
    few = pointings(Person(), [(3.0, 1.0, 1.0)], each=2 * NEIGHBOURS)
    few.directions[3] = SPIKE
    assert len(without_spikes(few)) == 2 * NEIGHBOURS
