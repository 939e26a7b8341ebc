"""The arithmetic of the wire: how long frames take, and how many pixels a link carries."""

import re
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.maps.file import load_map_and_clouds
from pointit.schemas import Strip
from pointit.services.led_driver.output.expander import ExpanderFrame
from pointit.services.led_driver.output.expander_config import ExpanderConfig
from pointit.services.led_driver.output.wiring import frame_bytes, map_channels, too_slow, wire_time_s
from pointit.services.led_driver.outputs import ChannelConfig


def strips(counts: Sequence[int]) -> tuple[Strip, ...]:
    return tuple(
        Strip(id=str(number), line_m=((0, 0, 0), (1, 0, 0)), pixels=pixels)
        for number, pixels in enumerate(counts)
    )


def shown(counts: Sequence[int], **fields: object) -> str:
    config = ExpanderConfig.model_validate({"kind": "expander", "port": "x", "board": "v3", **fields})
    return too_slow(config, map_channels(config, strips(counts))[0])


def test_a_byte_takes_ten_bits_of_the_wire() -> None:
    assert wire_time_s(20_000, 2_000_000) == pytest.approx(0.1)


@given(st.lists(st.integers(1, 300), min_size=1, max_size=6), st.sampled_from(["GRB", "RGBW"]))
def test_frame_size_is_that_of_the_bytes_that_are_sent(counts: list[int], order: str) -> None:
    channels = {str(k): ChannelConfig(channel=k, order=order) for k in range(len(counts))}
    wirings, _ = map_channels(ExpanderConfig(channels=channels), strips(counts))
    picture = ExpanderFrame(tuple((each.channel, each.order, bytes(3 * each.pixels)) for each in wirings))
    assert frame_bytes(wirings) == len(picture.data())


@pytest.mark.parametrize(
    ("board", "order", "limit"),
    [("v1", "RGBW", 180), ("v2", "RGBW", 602), ("v3", "GRBW", 1202), ("v3", "GRB", 1600)],
)
def test_a_channel_lights_as_many_pixels_as_its_board_drives_with_its_colours(
    board: str, order: str, limit: int
) -> None:
    channels = {"0": {"channel": 0, "order": order}}
    config = ExpanderConfig.model_validate({"board": board, "channels": channels})
    (most,), problems = map_channels(config, strips([limit]))
    assert (most.pixels, problems) == (limit, [])
    (cut,), problems = map_channels(config, strips([limit + 1]))
    assert cut.pixels == limit
    assert len(problems) == 1
    assert f"strip 0 has {limit + 1} pixels, a channel of board {board} drives {limit}:" in problems[0]


def test_vr_belts_on_one_wire_is_told_its_rate_and_what_fits() -> None:
    environment, _ = load_map_and_clouds("vr_belts", 0)
    counts = [strip.pixels for strip in environment.strips]
    sentence = shown(counts)
    assert sum(counts) == 6540
    assert "6540 pixels at 2000000 baud: 99 ms a frame, 10.1 frames a second" in sentence
    assert "2626 pixels fit at 25 frames a second" in sentence


def test_conveyor_fits_on_one_wire() -> None:
    environment, _ = load_map_and_clouds("conveyor", 0)
    assert shown([strip.pixels for strip in environment.strips], board="v2") == ""


@given(
    st.integers(1, 20),
    st.integers(300, 1000),
    st.floats(10, 60),
    st.sampled_from([500_000, 1_000_000, 2_000_000]),
)
def test_the_number_that_is_said_to_fit_fits_and_no_more(
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


def test_a_channel_that_is_drawn_too_slowly_is_told() -> None:
    sentence = shown([1600])
    assert "a channel of 1600 pixels: 48 ms a frame" in sentence
    assert "1323 pixels a channel fit at 25 frames a second" in sentence
