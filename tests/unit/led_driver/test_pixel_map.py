"""Pixels of strips on an output: parts, offsets, order, direction, gaps, universes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from pointit.schemas import Strip, StripFrame, StripsFrame
from pointit.services.led_driver.output.pixel_map import Power, map_pixels
from pointit.services.led_driver.outputs import OutputConfig, Segment

STRIPS = tuple(
    Strip(id=name, line_m=((0, 0, 0), (1, 0, 0)), pixels=pixels) for name, pixels in (("a", 3), ("b", 2))
)
FRAME = StripsFrame(
    stamp_ns=1,
    strips=(
        StripFrame(id="a", rgb=bytes((1, 2, 3, 4, 5, 6, 7, 8, 9))),
        StripFrame(id="b", rgb=bytes((10, 20, 30, 40, 50, 60))),
    ),
)


def shown(*segments: Segment, block_pixels: int = 1000) -> tuple[list[int], list[str]]:
    pixel_map, problems = map_pixels(segments, STRIPS, block_pixels=block_pixels)
    return list(pixel_map.output_bytes(FRAME)), problems


def test_segments_have_parts_orders_and_directions_and_gaps_stay_dark() -> None:
    assert shown(
        Segment(strip="b", order="GRB", reversed=True),
        Segment(strip="a", first=1, pixels=1, offset=3),
        Segment(strip="a", first=2, order="BGR"),
    ) == ([50, 40, 60, 20, 10, 30, 0, 0, 0, 4, 5, 6, 9, 8, 7], [])


def test_pixels_continue_in_the_next_universe_and_skip_unused_ones() -> None:
    segments = [Segment(strip="a", universe=2), Segment(strip="b", universe=7, offset=1)]
    pixel_map, problems = map_pixels(segments, STRIPS, block_pixels=2, first_block=1)
    assert problems == []
    blocks = [(block.number, block.start, block.size) for block in pixel_map.blocks]
    assert blocks == [(2, 0, 6), (3, 6, 3), (7, 9, 6), (8, 15, 3)]
    assert list(pixel_map.output_bytes(FRAME)) == [*range(1, 10), 0, 0, 0, 10, 20, 30, 40, 50, 60]


@pytest.mark.parametrize(
    ("segments", "problem"),
    [
        ([Segment(strip="c")], "the map has no strip c"),
        ([Segment(strip="a", first=2, pixels=4)], "strip a has 3 pixels, a segment wants 2 to 5"),
        ([Segment(strip="a", first=3)], "strip a has 3 pixels, a segment wants 3 to 3"),
        ([Segment(strip="a"), Segment(strip="b", offset=2)], "two segments share pixels"),
        ([Segment(strip="a", universe=0)], "universe 0 lies before the output's first, 1"),
    ],
)
def test_pixel_map_reports_segments_that_cannot_be_shown(segments: list[Segment], problem: str) -> None:
    _, problems = map_pixels(segments, STRIPS, block_pixels=170, first_block=1)
    assert [said for said in problems if said.startswith(problem)] == problems
    assert problems


@pytest.mark.parametrize("orders", [("RGB", "RGBW"), ("RGX",), ("RRGB",)])
def test_impossible_orders_are_refused(orders: tuple[str, ...]) -> None:
    with pytest.raises(ValidationError):
        OutputConfig.model_validate({"segments": [{"strip": "a", "order": order} for order in orders]})


def simple(segments: list[Segment]) -> dict[int, list[int]]:
    pixels: dict[int, list[int]] = {}
    end = 0
    for segment in segments:
        source = next(each.rgb for each in FRAME.strips if each.id == segment.strip)
        numbers = list(range(len(source) // 3))[segment.first :][: segment.pixels]
        start = end if segment.offset is None else segment.offset
        for place, number in enumerate(reversed(numbers) if segment.reversed else numbers):
            color = dict[str, int](zip("RGB", source[3 * number :], strict=False)) | {"W": 0}
            pixels[start + place] = [color[each] for each in segment.order]
        end = start + len(numbers)
    return pixels


@given(
    st.lists(
        st.builds(
            Segment,
            strip=st.sampled_from("ab"),
            first=st.integers(0, 1),
            pixels=st.none() | st.just(1),
            offset=st.none() | st.integers(0, 40),
            order=st.permutations("RGBW").map("".join),
            reversed=st.booleans(),
        ),
        min_size=1,
        max_size=6,
    ),
    st.integers(1, 9),
)
def test_each_byte_is_that_of_its_pixel(segments: list[Segment], block_pixels: int) -> None:
    pixel_map, _ = map_pixels(segments, STRIPS, block_pixels=block_pixels)
    data = pixel_map.output_bytes(FRAME)
    sent = {
        block.number * block_pixels + place: list(data[block.start + 4 * place :][:4])
        for block in pixel_map.blocks
        for place in range(block.size // 4)
    }
    wanted = simple(segments)
    assert {number: pixel for number, pixel in sent.items() if number in wanted} == wanted
    assert not any(any(pixel) for number, pixel in sent.items() if number not in wanted)


@given(st.dictionaries(st.sampled_from("abc"), st.binary(max_size=20)))
def test_frames_that_do_not_fit_are_cut_and_filled(pixels: dict[str, bytes]) -> None:
    pixel_map, _ = map_pixels((), STRIPS)
    frame = StripsFrame(
        stamp_ns=1, strips=tuple(StripFrame(id=name, rgb=rgb) for name, rgb in pixels.items())
    )
    wanted = pixels.get("a", b"")[:9].ljust(9, b"\0") + pixels.get("b", b"")[:6].ljust(6, b"\0")
    assert pixel_map.output_bytes(frame) == wanted


def test_pixels_and_universes_of_the_previous_map_alone_are_dark() -> None:
    before, _ = map_pixels((), STRIPS, block_pixels=2, first_block=3)
    pixel_map, _ = map_pixels((), STRIPS[1:], block_pixels=2, first_block=4)
    covering = pixel_map.covering(before)
    assert [(block.number, block.start, block.size) for block in covering.blocks] == [
        (3, 0, 6),
        (4, 6, 6),
        (5, 12, 3),
    ]
    assert covering.output_bytes(FRAME) == bytes((*[0] * 6, 10, 20, 30, 40, 50, 60, 0, 0, 0))
    assert covering.covering(before).output_bytes(FRAME) == covering.output_bytes(FRAME)


def test_universe_of_an_output_without_universes_is_named() -> None:
    pixel_map, problems = map_pixels([Segment(strip="b", universe=7, offset=1)], STRIPS)
    assert problems == ["the output has no universes: remove `universe: 7`"]
    assert pixel_map.output_bytes(FRAME) == bytes((0, 0, 0, 10, 20, 30, 40, 50, 60))


def test_gamma_makes_the_middle_darker_and_keeps_both_ends() -> None:
    sent, _ = Power(OutputConfig()).send(bytes((0, 128, 255)))
    assert list(sent) == [0, 56, 255]  # 255 · (128 / 255)^2.2 = 55.98


@given(st.binary(max_size=360), st.floats(0.01, 2.0), st.floats(1.0, 3.0))
def test_no_frame_ever_draws_more_than_the_limit(pixels: bytes, limit_a: float, gamma: float) -> None:
    power = Power(OutputConfig(max_current_a=limit_a, gamma=gamma))
    sent, load = power.send(pixels)
    drawn_a = sum(sent) / 765 * 0.06
    assert drawn_a <= limit_a + 1e-9
    assert load.drawn_a == pytest.approx(drawn_a)

    free, unlimited = Power(OutputConfig(gamma=gamma)).send(pixels)
    assert load.wanted_a == pytest.approx(unlimited.drawn_a)
    if unlimited.drawn_a <= limit_a:
        assert sent == free
        assert not load.limited
    else:  # all is scaled alike, rounded down
        scale = limit_a / unlimited.drawn_a
        for ours, theirs in zip(sent, free, strict=True):
            assert ours <= theirs * scale + 1e-6
            assert ours > theirs * scale - 1 - 1e-6
