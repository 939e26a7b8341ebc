"""Pixels of belts: those of every strip beside, at the nearest arc length, and no others."""

import math
import time

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas import Belt, Strip
from pointit.schemas.environment import BESIDE_BELT_M
from pointit.services.led_driver.render import Layout
from tests.support.pace import within
from tests.unit.led_driver.stage import BLACK, RED, WHITE, Stage, item

WIDTH_M = 0.5
PER_M = 30
STRAIGHT = Belt(id="belt", line_m=((0.0, 0.0, 1.0), (3.0, 0.0, 1.0)), width_m=WIDTH_M)


def arc(radius_m: float, degrees: float = 90.0, steps: int = 90) -> tuple[tuple[float, float, float], ...]:
    """Return a quarter turn to the left about the origin, from the x axis on."""
    angles = [math.radians(degrees) * step / steps for step in range(steps + 1)]
    return tuple((radius_m * math.cos(a), radius_m * math.sin(a), 1.0) for a in angles)


def beside(
    offset_m: float, start_m: float, end_m: float, *, name: str = "s", direction: int = 1, turn: bool = False
) -> Strip:
    """Return a strip along the straight belt, from `start_m` to `end_m`, its line turned round or not."""
    line = ((start_m, offset_m, 1.0), (end_m, offset_m, 1.0))
    return Strip(
        id=name,
        line_m=line[::-1] if turn else line,
        pixels=max(round((end_m - start_m) * PER_M), 1),
        direction=1 if direction == 1 else -1,
    )


def places(strip: Strip) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return x of every pixel in the order of the wire, by the paper's words alone."""
    (begin, _, _), (end, _, _) = strip.line_m[0], strip.line_m[-1]
    x = begin + (np.arange(strip.pixels) + 0.5) / strip.pixels * (end - begin)
    return x[::-1] if strip.direction == -1 else x


offsets = st.floats(-WIDTH_M / 2 - BESIDE_BELT_M + 1e-6, WIDTH_M / 2 + BESIDE_BELT_M - 1e-6)
spans = st.tuples(st.floats(-1.0, 3.5), st.floats(0.2, 2.0))


@given(st.data(), st.floats(-0.5, 3.5), st.floats(0.1, 1.0))
def test_package_lights_the_adjacent_pixels_in_any_direction_with_clipping(
    data: st.DataObject, at_m: float, length_m: float
) -> None:
    offset_m, (start_m, span_m) = data.draw(offsets), data.draw(spans)
    direction = data.draw(st.sampled_from([1, -1]))
    turn = data.draw(st.booleans())
    strip = beside(offset_m, start_m, start_m + span_m, direction=direction, turn=turn)
    stage = Stage(strip, belts=(STRAIGHT,))
    stage.put(item(at_m, length_m, surface="belt", surface_id="belt"))
    x = places(strip)
    inside = (np.abs(x - at_m) <= length_m / 2) & (x >= 0.0) & (x <= 3.0)
    doubtful = np.abs(np.abs(x - at_m) - length_m / 2) < 1e-9
    doubtful |= (x < 0.0) & (x > -2e-3) | (x > 3.0) & (x < 3.0 + 2e-3)
    got = np.zeros(strip.pixels, dtype=bool)
    got[stage.lit("s")] = True
    assert (got == inside)[~doubtful].all()


@given(st.floats(0.3, 2.8), st.floats(0.15, 0.6))
def test_both_strips_of_a_curve_show_the_same_stretch(at_m: float, length_m: float) -> None:
    belt = Belt(id="belt", line_m=arc(2.0), width_m=WIDTH_M)
    length = 2.0 * math.pi / 2
    strips = [
        Strip(id=name, line_m=arc(radius), pixels=round(radius * math.pi / 2 * PER_M))
        for name, radius in (("in", 1.75), ("out", 2.25))
    ]
    stage = Stage(*strips, belts=(belt,)).put(item(at_m, length_m, surface="belt", surface_id="belt"))
    for strip in strips:
        at = (np.arange(strip.pixels) + 0.5) / strip.pixels * length  # of their radii: the same angle
        sure = np.flatnonzero(np.abs(at - at_m) < length_m / 2 - 0.01)
        possible = np.flatnonzero(np.abs(at - at_m) < length_m / 2 + 0.01)
        assert set(sure) <= set(stage.lit(strip.id)) <= set(possible)


def test_margins_are_as_long_on_the_inner_strip_of_curves() -> None:
    belt = Belt(id="belt", line_m=arc(1.0), width_m=WIDTH_M)
    inner = Strip(id="s", line_m=arc(0.7), pixels=round(0.7 * math.pi / 2 * PER_M))
    stage = Stage(inner, belts=(belt,), margin_m=0.1).put(item(0.8, 0.6, surface="belt", surface_id="belt"))
    shown = [color for color in stage.select("anna").shown("s") if color != BLACK]
    # a pixel of it is 0.048 m of the belt: two of them are a margin, three would be too much
    assert shown == [WHITE] * 2 + [RED] * (len(shown) - 4) + [WHITE] * 2
    assert len(shown) in (12, 13)


def test_gaps_between_strips_stay_gaps_and_strips_elsewhere_stay_dark() -> None:
    strips = (
        beside(0.25, 0.0, 1.0, name="a"),
        beside(0.25, 1.5, 3.0, name="b"),
        beside(0.36, 0.0, 3.0, name="far"),
        beside(0.25, 3.1, 4.0, name="beyond"),
    )

    stage = Stage(*strips, belts=(STRAIGHT,))
    stage.put(item(1.25, 0.3, surface="belt", surface_id="belt"))
    assert not any(stage.lit(name) for name in "ab")

    stage.put(item(1.25, 0.98, surface="belt", surface_id="belt"))
    assert stage.lit("a") == list(range(23, 30))
    assert len(stage.lit("b")) == 7

    stage.put(item(3.0, 6.0, surface="belt", surface_id="belt"))
    assert len(stage.lit("a")) == 30
    assert not stage.lit("far")
    assert not stage.lit("beyond")


def test_cursor_lights_both_sides_of_a_belt_or_one_strip() -> None:
    left = beside(0.25, 0.0, 3.0, name="l")
    right = beside(-0.25, 0.0, 3.0, name="r")
    stage = Stage(left, right, belts=(STRAIGHT,)).profile("anna", (0, 9, 0), 0.09)
    on_belt = stage.point("anna", 1.5, "belt", surface="belt")
    assert on_belt.lit("l") == on_belt.lit("r") == [44, 45]
    on_strip = stage.point("anna", 1.5, "l")
    assert on_strip.lit("l")
    assert not on_strip.lit("r")


@given(st.floats(0.0, 3.0))
def test_cursor_below_a_pixel_lights_one_pixel_of_each_strip(at_m: float) -> None:
    left = beside(0.25, 0.0, 3.0, name="l")
    right = beside(-0.25, 0.5, 2.5, name="r")
    stage = Stage(left, right, belts=(STRAIGHT,)).profile("anna", (0, 9, 0), 1e-3)
    stage.point("anna", at_m, "belt", surface="belt")
    assert len(stage.lit("l")) == 1
    assert abs(places(left)[stage.lit("l")[0]] - at_m) <= 0.5 / PER_M + 1e-3
    if abs(at_m - 0.5) > 1e-3 and abs(at_m - 2.5) > 1e-3:
        assert len(stage.lit("r")) == (0.5 < at_m < 2.5)


def test_lookup_of_two_thousand_points_takes_less_than_a_frame() -> None:
    strips = [beside(2.0 * index, 0.0, 3.0, name=str(index)) for index in range(22)]
    layout = Layout(strips)
    lines = np.arange(2000) % 22
    at_m = np.linspace(0.0, 3.0, 2000)
    assert layout.lit(lines, at_m, at_m)[0].tolist() == list(range(2000))
    took_s: list[float] = []
    for _ in range(20):
        began_s = time.perf_counter()
        layout.lit(lines, at_m, at_m)
        took_s.append(time.perf_counter() - began_s)
    assert within(min(took_s), 0.005)  # it takes 0.4 ms


def test_pixel_may_lie_beside_two_belts_and_shows_both() -> None:
    other = Belt(id="other", line_m=((0.0, 0.5, 1.0), (3.0, 0.5, 1.0)), width_m=WIDTH_M)
    stage = Stage(beside(0.25, 0.0, 3.0), belts=(STRAIGHT, other))
    for belt in ("belt", "other"):
        assert stage.put(item(1.5, 0.2, surface="belt", surface_id=belt)).lit("s") == list(range(42, 48))
