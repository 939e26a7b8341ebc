"""Each pixel where it should be: directions, ends, states, several cursors, brightness."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas import Strip
from pointit.schemas.base import FARTHEST_ALONG
from pointit.services.led_driver.config import StyleConfig
from pointit.services.led_driver.render import CursorMark, ObjectMark, Renderer

WHITE, RED, GREEN, BLACK = (255, 255, 255), (200, 0, 0), (0, 100, 0), (0, 0, 0)
DIM = (50, 0, 0)  # a quarter of RED
STYLE = StyleConfig(kind_colors={"red": RED}, default_color=(8, 8, 8), idle_level=0.25, edge_m=0.1)

# 10 pixels a metre: pixel k of the line has its centre at 0.05 + 0.1 k
FORTH = Strip(id="forth", line_m=((0, 0, 0), (1, 0, 0), (1, 1, 0)), pixels=20)
BACK = Strip(id="back", line_m=((0, 0, 0), (2, 0, 0)), pixels=20, direction=-1)


def colors(data: bytes) -> list[tuple[int, int, int]]:
    return [(data[k], data[k + 1], data[k + 2]) for k in range(0, len(data), 3)]


def lit(data: bytes) -> list[int]:
    return [k for k, color in enumerate(colors(data)) if color != BLACK]


def cursor(
    strip_id: str, position_m: float, width_m: float = 0.3, color: tuple[int, int, int] = WHITE
) -> CursorMark:
    return CursorMark(strip_id=strip_id, position_m=position_m, width_m=width_m, color=color)


def package(
    position_m: float,
    length_m: float = 0.6,
    *,
    strip_id: str = "forth",
    kind: str = "red",
    selected: bool = False,
    progress: float = 0.0,
    hover_color: tuple[int, int, int] | None = None,
) -> ObjectMark:
    return ObjectMark(
        strip_id=strip_id,
        position_m=position_m,
        length_m=length_m,
        kind=kind,
        selected=selected,
        progress=progress,
        hover_color=hover_color,
    )


def drawn(*marks: ObjectMark) -> list[tuple[int, int, int]]:
    return colors(Renderer([FORTH, BACK], STYLE).render(marks, [])["forth"])


def test_a_cursor_lights_the_pixels_around_its_position() -> None:
    frame = Renderer([FORTH, BACK], STYLE).render([], [cursor("forth", 0.55)])
    assert lit(frame["forth"]) == [4, 5, 6]
    assert lit(frame["back"]) == []


def test_on_a_reversed_strip_pixel_0_is_at_the_end_of_the_line() -> None:
    frame = Renderer([FORTH, BACK], STYLE).render([], [cursor("back", 0.25, 0.2)])
    # line pixels 2 (centre 0.25) and by rounding none other: wire pixel 19 - 2
    assert 17 in lit(frame["back"])
    ends = Renderer([BACK], STYLE).render([], [cursor("back", 0.0, 0.1), cursor("back", 1.99, 0.1)])
    assert lit(ends["back"]) == [0, 19]


@given(st.floats(-0.5, 2.5), st.floats(0.001, 1.0), st.sampled_from(["forth", "back"]), st.integers(1, 300))
def test_exactly_the_pixels_with_their_centres_under_the_cursor_are_lit(
    position_m: float, width_m: float, strip_id: str, pixels: int
) -> None:
    strip = (FORTH if strip_id == "forth" else BACK).model_copy(update={"pixels": pixels})
    frame = Renderer([strip], STYLE).render([], [cursor(strip_id, position_m, width_m)])
    pitch_m = 2.0 / pixels
    centres = (np.arange(pixels) + 0.5) * pitch_m
    if strip_id == "back":
        centres = centres[::-1]
    distance = np.abs(centres - position_m)
    got = np.zeros(pixels, dtype=bool)
    got[lit(frame[strip_id])] = True
    rounding = 1e-9
    if (distance < width_m / 2 - rounding).any() or width_m >= pitch_m:
        assert got[distance < width_m / 2 - rounding].all()
        assert not got[distance > width_m / 2 + rounding].any()
    else:  # narrower than a pixel and between two centres: the nearest, if it is on the strip
        assert got.sum() <= 1
        beyond_m = max(-position_m, position_m - 2.0)
        if abs(beyond_m) > 1e-5:
            assert (got.sum() == 1) == (beyond_m < 0)
        assert not got[distance > pitch_m / 2 + 1e-5].any()


def test_an_object_is_dim_and_a_selected_one_bright_with_white_ends() -> None:
    assert drawn(package(0.6))[2:10] == [BLACK, *[DIM] * 6, BLACK]
    assert drawn(package(0.6, selected=True))[2:10] == [BLACK, WHITE, *[RED] * 4, WHITE, BLACK]


def test_a_hovered_object_has_ends_in_the_persons_colour_and_fills_with_the_progress() -> None:
    assert drawn(package(0.6, hover_color=GREEN))[3:9] == [GREEN, *[DIM] * 4, GREEN]
    assert drawn(package(0.6, hover_color=GREEN, progress=0.7))[3:9] == [GREEN, RED, DIM, DIM, RED, GREEN]
    assert drawn(package(0.6, hover_color=GREEN, progress=1.0))[3:9] == [GREEN, *[RED] * 4, GREEN]
    selected = package(0.6, hover_color=GREEN, progress=0.7, selected=True)
    assert drawn(selected)[3:9] == [GREEN, DIM, RED, RED, DIM, GREEN]


def test_an_object_partly_beyond_the_strip_keeps_its_shape() -> None:
    at_start = drawn(package(0.1, selected=True))
    assert at_start[:5] == [*[RED] * 3, WHITE, BLACK]
    at_end = drawn(package(1.9, selected=True))
    assert at_end[15:] == [BLACK, WHITE, *[RED] * 3]
    assert drawn(package(-0.5)) == drawn(package(2.5)) == [BLACK] * 20


def test_a_short_object_is_still_a_pixel_and_keeps_its_colour() -> None:
    assert drawn(package(0.51, 0.0, selected=True))[4:7] == [BLACK, RED, BLACK]


@pytest.mark.parametrize(("position_m", "pixel"), [(0.0, 0), (2.0, 19), (-0.01, None), (2.01, None)])
def test_the_very_ends_belong_to_the_strip(position_m: float, pixel: int | None) -> None:
    frame = Renderer([FORTH], STYLE).render([], [cursor("forth", position_m, 0.001)])
    assert lit(frame["forth"]) == ([] if pixel is None else [pixel])


def test_an_unknown_kind_has_the_default_colour() -> None:
    assert drawn(package(0.6, kind="?", selected=True))[5] == (8, 8, 8)


def test_an_unknown_strip_draws_nothing() -> None:
    frame = Renderer([FORTH], STYLE).render([package(0.5, strip_id="x")], [cursor("x", 0.5)])
    assert lit(frame["forth"]) == []


def test_cursors_lie_on_top_of_objects() -> None:
    frame = Renderer([FORTH], STYLE).render(
        [package(0.6, selected=True)], [cursor("forth", 0.55, color=GREEN)]
    )
    assert colors(frame["forth"])[3:9] == [WHITE, GREEN, GREEN, GREEN, RED, WHITE]


def test_overlapping_cursors_alternate_and_lone_parts_stay_whole() -> None:
    frame = Renderer([FORTH, BACK], STYLE).render(
        [], [cursor("forth", 0.5, 0.6), cursor("forth", 0.8, 0.6, GREEN), cursor("back", 1.0)]
    )
    got = colors(frame["forth"])
    assert got[2:5] == [WHITE] * 3
    assert got[5:8] == [GREEN, WHITE, GREEN]
    assert got[8:11] == [GREEN] * 3
    assert lit(frame["forth"]) == list(range(2, 11))
    assert len(lit(frame["back"])) in (3, 4)


@pytest.mark.parametrize("count", [2, 3, 5])
def test_where_many_cursors_meet_everybody_is_seen(count: int) -> None:
    marks = [cursor("forth", 1.0, 1.2, (k + 1, 0, 0)) for k in range(count)]
    got = colors(Renderer([FORTH], STYLE).render([], marks)["forth"])
    window = [color[0] for color in got[5:15]]
    for start in range(len(window) - count):
        assert set(window[start : start + count]) == set(range(1, count + 1))


def test_brightness_scales_everything() -> None:
    renderer = Renderer([FORTH], STYLE)
    full = renderer.render([package(0.6)], [cursor("forth", 1.5)])["forth"]
    renderer.set_brightness(0.5)
    half = renderer.render([package(0.6)], [cursor("forth", 1.5)])["forth"]
    assert list(half) == [round(value / 2) for value in full]
    renderer.set_brightness(0.0)
    assert not any(renderer.render([package(0.6)], [cursor("forth", 1.5)])["forth"])


def test_a_frame_keeps_nothing_of_the_one_before() -> None:
    renderer = Renderer([FORTH, BACK], STYLE)
    renderer.render([package(0.6)], [cursor("back", 1.0)])
    assert not any(b"".join(renderer.render([], []).values()))


def test_a_line_without_length_is_refused() -> None:
    with pytest.raises(ValueError, match="two different vertices"):
        Renderer([FORTH.model_copy(update={"line_m": ((0, 0, 0), (0, 0, 0))})])


def test_more_pixels_than_a_frame_holds_are_refused() -> None:
    line = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    strips = [Strip(id=f"strip_{n}", line_m=line, pixels=4096) for n in range(65)]
    assert len(Renderer(strips[:64]).render([], [])) == 64
    with pytest.raises(ValueError, match="266240 pixels together, a frame holds 262144"):
        Renderer(strips)


@pytest.mark.parametrize("end_m", [1e-8, 2.0])
@pytest.mark.parametrize("position_m", [-FARTHEST_ALONG, FARTHEST_ALONG])
def test_cursors_beyond_the_world_light_nothing_however_many(end_m: float, position_m: float) -> None:
    strip = Strip(id="a", line_m=((0.0, 0.0, 0.0), (end_m, 0.0, 0.0)), pixels=20)
    marks = [CursorMark(strip_id="a", position_m=position_m, width_m=1.0, color=(9, 9, 9))] * 3
    assert Renderer([strip]).render([], marks) == {"a": bytes(60)}
