"""The 1 € filter on the sphere: properties that hold for every movement."""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import rotation, vector
from pointit.geometry.one_euro import OneEuro
from pointit.geometry.vector import Vec3

directions = st.builds(vector.direction, st.floats(-math.pi, math.pi), st.floats(-math.pi / 2, math.pi / 2))
steps_s = st.floats(1e-3, 0.4)
streams = st.lists(st.tuples(steps_s, directions), min_size=1, max_size=20)
rotations = st.builds(
    rotation.from_azimuth_elevation, st.floats(-math.pi, math.pi), st.floats(-1.5, 1.5),
    st.floats(-math.pi, math.pi),
)  # fmt: skip


def filtered(stream: list[tuple[float, Vec3]], one_euro: OneEuro | None = None) -> list[Vec3]:
    one_euro = one_euro or OneEuro()
    at_s = 1.7e9
    out: list[Vec3] = []
    for step_s, direction in stream:
        at_s += step_s
        out.append(one_euro.smooth(direction, at_s))
    return out


@given(directions, st.lists(steps_s, min_size=2, max_size=20))
def test_filter_returns_a_constant_direction_unchanged(direction: Vec3, steps: list[float]) -> None:
    assert set(filtered([(step_s, direction) for step_s in steps])) == {direction}


@given(streams, rotations)
def test_turning_all_turns_the_output(stream: list[tuple[float, Vec3]], turn: rotation.Quaternion) -> None:
    turned = [(step_s, rotation.rotate(turn, direction)) for step_s, direction in stream]
    ways = [vector.angle_between(a, b) for (_, a), (_, b) in pairwise(stream)]
    if any(way > math.pi - 1e-3 for way in ways):
        return  # between opposites any arc is as short
    for before, after in zip(filtered(stream), filtered(turned), strict=True):
        assert vector.angle_between(rotation.rotate(turn, before), after) < 1e-6


@given(streams)
def test_it_never_overshoots(stream: list[tuple[float, Vec3]]) -> None:
    """The output lies on the arc between the last output and the input."""
    out = filtered(stream)
    for before, (_, new), after in zip(out, stream[1:], out[1:], strict=False):
        way = vector.angle_between(before, after) + vector.angle_between(after, new)
        assert way == pytest.approx(vector.angle_between(before, new), abs=1e-6)


def run(
    rate_hz: float, movement: Callable[[float], tuple[float, float]], one_euro: OneEuro | None = None
) -> np.ndarray:
    one_euro = one_euro or OneEuro()
    out: list[tuple[float, float]] = []
    for index in range(int(3.0 * rate_hz)):
        azimuth, elevation = movement(index / rate_hz)
        given_ = vector.direction(math.radians(azimuth), math.radians(elevation))
        came = one_euro.smooth(given_, index / rate_hz)
        out.append((math.degrees(vector.azimuth(came)), math.degrees(vector.elevation(came))))
    return np.array(out)


@pytest.mark.parametrize("rate_hz", [50, 100, 400])
def test_one_euro_lags_a_steady_movement_equally_at_every_rate(rate_hz: int) -> None:
    """At 20 deg/s the cut-off is 0.7 + 0.05 * 20 = 1.7 Hz, so it is 20 deg/s / (2 pi 1.7 Hz) behind."""
    out = run(rate_hz, lambda at_s: (20.0 * at_s, 0.0))
    assert 20.0 * (3.0 - 1.0 / rate_hz) - out[-1, 0] == pytest.approx(20.0 / (math.tau * 1.7), rel=0.02)


def test_one_euro_restarts_after_a_gap_or_backward_time() -> None:
    one_euro = OneEuro()
    ahead = (1.0, 0.0, 0.0)
    left = (0.0, 1.0, 0.0)
    assert one_euro.smooth(ahead, 10.0) == ahead
    assert one_euro.smooth(left, 10.4) not in (ahead, left)
    assert (one_euro.smooth(ahead, 11.0), one_euro.smooth(left, 3.0)) == (ahead, left)
    assert one_euro.smooth(ahead, 3.1) not in (ahead, left)


def test_two_at_one_time_neither_stop_it_nor_count_twice() -> None:
    one_euro = OneEuro()
    one_euro.smooth((1.0, 0.0, 0.0), 1.0)
    assert one_euro.smooth((0.0, 1.0, 0.0), 1.0) == (1.0, 0.0, 0.0)
    after = one_euro.smooth((0.0, 1.0, 0.0), 1.02)
    assert 0.0 < vector.azimuth(after) < 0.2  # at rest since: no speed that would open the filter


def test_opposites_have_no_arc() -> None:
    one_euro = OneEuro()
    one_euro.smooth((1.0, 0.0, 0.0), 1.0)
    assert one_euro.smooth((-1.0, 0.0, 0.0), 1.02) == (-1.0, 0.0, 0.0)
