"""Lines that are none."""

import math

import pytest

from pointit.geometry.polyline import Polyline


@pytest.mark.parametrize("far_m", [1.1e6, 1e308, -1e308, math.inf, math.nan])
def test_a_line_beyond_the_world_is_refused(far_m: float) -> None:
    with pytest.raises(ValueError, match="within 1e\\+06 m"):
        Polyline(((0.0, 0.0, 0.0), (far_m, 0.0, 0.0)))


@pytest.mark.parametrize("step_m", [0.0, 5e-324, 1e-200, 1e-10])
def test_a_line_without_length_is_refused(step_m: float) -> None:
    with pytest.raises(ValueError, match="two different vertices"):
        Polyline(((1.0, 0.0, 0.0), (1.0 + step_m, step_m, 0.0)))


def test_repeated_vertices_are_dropped() -> None:
    line = Polyline(((0.0, 0.0, 0.0), (0.0, 5e-324, 0.0), (2.0, 0.0, 0.0), (2.0, 0.0, 0.0)))
    assert line.length_m == 2.0
    assert line.tangent_at(1.0) == (1.0, 0.0, 0.0)
