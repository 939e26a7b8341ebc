"""The arithmetic of the wire: how long frames take, and how many pixels a link carries."""

import re
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from pointit.maps.file import load_map_and_clouds
from pointit.runtime.service.plugin_guard import Surroundings
from pointit.schemas import Strip, StripFrame, StripsFrame
from pointit.services.led_driver.output import expander
from pointit.services.led_driver.output.expander import (
    ExpanderConfig,
    ExpanderOutput,
    frame_bytes,
    map_channels,
    too_slow,
)


def strip(name: str, pixels: int) -> Strip:
    return Strip(id=name, line_m=((0, 0, 0), (1, 0, 0)), pixels=pixels)


def strips(counts: Sequence[int]) -> tuple[Strip, ...]:
    return tuple(strip(str(number), pixels) for number, pixels in enumerate(counts))


def shown(counts: Sequence[int], **fields: object) -> str:
    config = ExpanderConfig.model_validate({"kind": "expander", "port": "x", "board": "v3", **fields})
    return too_slow(config, map_channels(config, strips(counts))[0].channels)


@given(st.lists(st.integers(1, 300), min_size=1, max_size=6), st.sampled_from(["GRB", "RGBW"]))
def test_frame_size_is_that_of_the_bytes_that_are_sent(counts: list[int], order: str) -> None:
    segments = [{"strip": str(k), "universe": k, "order": order} for k in range(len(counts))]
    wiring, _ = map_channels(ExpanderConfig.model_validate({"segments": segments}), strips(counts))
    assert frame_bytes(wiring.channels) == len(wiring.encode(bytes(wiring.pixel_map.size)))


@pytest.mark.parametrize(
    ("board", "order", "limit"),
    [
        ("v1", "GRB", 240),
        ("v1", "RGBW", 180),
        ("v2", "RGB", 800),
        ("v2", "RGBW", 602),
        ("v3", "GRBW", 1202),
        ("v3", "GRB", 1600),
    ],
)
def test_channel_lights_as_many_pixels_as_its_board_drives(board: str, order: str, limit: int) -> None:
    segments = [{"strip": "0", "universe": 0, "order": order}]
    config = ExpanderConfig.model_validate({"board": board, "segments": segments})
    wiring, problems = map_channels(config, strips([limit]))
    assert ([each.pixels for each in wiring.channels], problems) == ([limit], [])
    wiring, problems = map_channels(config, strips([limit + 1]))
    assert [each.pixels for each in wiring.channels] == [limit]
    assert len(problems) == 1
    assert f"channel 0 with strip 0 has {limit + 1} pixels, board {board} drives {limit}:" in problems[0]


def test_warning_for_vr_belts_states_rate_and_fitting_pixels() -> None:
    environment, _ = load_map_and_clouds("vr_belts", 0)
    counts = [strip.pixels for strip in environment.strips]
    sentence = shown(counts)
    assert sum(counts) == 6540
    assert "6540 pixels at 2000000 baud: 99 ms a frame, 10.1 frames a second" in sentence
    assert "2626 pixels fit at 25 frames a second" in sentence


@given(
    st.integers(1, 20),
    st.integers(300, 1000),
    st.floats(10, 60),
    st.sampled_from([500_000, 1_000_000, 2_000_000]),
)
def test_number_of_pixels_reported_as_fitting_is_exact(
    count: int, pixels: int, rate_hz: float, baud: int
) -> None:
    sentence = shown([pixels] * count, wanted_rate_hz=rate_hz, baud=baud)
    if not sentence:
        return
    told = re.search(r"(\d+) pixels( a channel)? fit", sentence)
    assert told is not None
    fitting = int(told[1])
    if told[2]:
        even = [fitting]
        more = [fitting + 1]
    else:
        even = [fitting // count + (k < fitting % count) for k in range(count)]
        more = [even[0] + 1, *even[1:]]

    if min(even) > 0:
        assert shown(even, wanted_rate_hz=rate_hz, baud=baud) == ""
        assert shown(more, wanted_rate_hz=rate_hz, baud=baud) != ""


def test_channel_that_is_drawn_too_slowly_is_reported() -> None:
    sentence = shown([1600])
    assert "a channel of 1600 pixels: 48 ms a frame" in sentence
    assert "1323 pixels a channel fit at 25 frames a second" in sentence


def test_segments_put_parts_of_strips_on_channels() -> None:
    segments = [
        {"strip": "0", "first": 2, "universe": 5, "order": "GRBW", "reversed": True},
        {"strip": "1", "pixels": 1, "universe": 5, "offset": 3, "order": "GRBW"},
        {"strip": "1", "first": 1, "universe": 2, "order": "RGB"},
    ]
    wiring, problems = map_channels(ExpanderConfig.model_validate({"segments": segments}), strips([4, 2]))
    assert problems == []
    assert [(each.number, each.order, each.pixels) for each in wiring.channels] == [
        (2, "RGB", 1),
        (5, "GRBW", 4),
    ]

    frame = StripsFrame(
        stamp_ns=1,
        strips=(StripFrame(id="0", rgb=bytes(range(12))), StripFrame(id="1", rgb=bytes(range(20, 26)))),
    )
    first, second = wiring.channels
    parts = bytes((23, 24, 25)), bytes((9, 10, 11, 6, 7, 8, 0, 0, 0, 20, 21, 22))

    assert wiring.encode(wiring.pixel_map.output_bytes(frame)) == (
        expander.set_channel(first.number, first.order, parts[0])
        + expander.set_channel(second.number, second.order, parts[1])
        + expander.draw_all()
    )


def test_channel_with_several_colour_orders_is_reported() -> None:
    segments = [{"strip": "0", "universe": 0}, {"strip": "1", "universe": 0, "offset": 4, "order": "GRB"}]
    _, problems = map_channels(ExpanderConfig.model_validate({"segments": segments}), strips([4, 2]))
    assert problems == ["channel 0 has segments of several orders: use one for a channel"]


@pytest.mark.parametrize(
    "fields", [{"segments": [{"strip": "a"}]}, {"segments": [{"strip": "a", "universe": 64}]}]
)
def test_segments_without_a_channel_of_their_own_are_refused(fields: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        ExpanderConfig.model_validate(fields)


def test_set_channel_frame_matches_the_golden_bytes() -> None:
    golden = bytes.fromhex("55 50 58 4c 00 01 03 21 02 00 11 22 33 aa bb cc fb 69 48 ce")
    assert expander.set_channel(0, "GRB", bytes.fromhex("112233aabbcc")) == golden


def test_draw_all_frame_matches_the_golden_bytes() -> None:
    assert expander.draw_all() == bytes.fromhex("55 50 58 4c ff 02 9b 38 81 df")


def test_white_leds_get_a_dark_fourth_byte() -> None:
    frame = expander.set_channel(9, "GRBW", bytes((1, 2, 3, 4, 5, 6)))
    assert frame[4:18] == bytes((9, 1, 4, 0xE1, 2, 0, 1, 2, 3, 0, 4, 5, 6, 0))


def test_drawing_takes_as_long_as_the_longest_channel() -> None:
    output = ExpanderOutput(ExpanderConfig(), Surroundings.detached())
    output.set_strips([strip("a", 240), strip("b", 10)])
    assert 1 / output.draw_time_s() == pytest.approx(133, abs=1)


def test_strips_go_in_the_maps_order_without_segments() -> None:
    wiring, problems = map_channels(ExpanderConfig(port="x"), [strip("b", 10), strip("a", 20)])
    assert [(w.number, w.order, w.pixels) for w in wiring.channels] == [(0, "GRB", 10), (1, "GRB", 20)]
    assert not problems


def test_too_many_strips_are_said() -> None:
    wiring, problems = map_channels(ExpanderConfig(), [strip(str(k), 1) for k in range(65)])
    assert len(wiring.channels) == 64
    assert "65 strips" in problems[0]


def test_plugged_in_board_shows_the_picture_from_its_first_frame() -> None:
    output = ExpanderOutput(ExpanderConfig(), Surroundings.detached())
    output.set_strips([strip("a", 2)])
    assert output.encode_opening(b"\1\2\3\4\5\6") == output.encode(b"\1\2\3\4\5\6")


def test_map_without_strips_draws_what_the_board_has() -> None:
    output = ExpanderOutput(ExpanderConfig(), Surroundings.detached())
    output.set_strips([])
    assert output.encode(b"") == expander.draw_all()
    assert output.draw_time_s() == pytest.approx(expander.LATCH_TIME_S)
