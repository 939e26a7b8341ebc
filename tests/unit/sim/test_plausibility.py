"""Figures of messages that compare a value with a limit."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.sim.track_faults import round_figures_beyond

FINITE = st.floats(-1e12, 1e12)


@pytest.mark.parametrize(
    ("value", "limit", "text"),
    [(3.20004, 3.2, "3.20004"), (3.2, 3.2, "3.2"), (1700.0, 3.2, "1700"), (3.19999, 3.2, "3.19999")],
)
def test_a_value_has_as_many_figures_as_show_its_side_of_the_limit(
    value: float, limit: float, text: str
) -> None:
    assert round_figures_beyond(value, limit) == text


@given(FINITE, FINITE)
def test_shown_figures_are_on_the_side_of_the_value(value: float, limit: float) -> None:
    shown = float(round_figures_beyond(value, limit))
    assert math.copysign(1.0, shown - limit) == math.copysign(1.0, value - limit) or value == limit
