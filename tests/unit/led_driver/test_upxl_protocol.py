"""UPXL bytes against the published golden frames, and the wiring's limits."""

import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from pointit.schemas import Strip
from pointit.services.led_driver.output.serial_port import upxl_protocol
from pointit.services.led_driver.output.serial_port.expander import ExpanderFrame
from pointit.services.led_driver.output.serial_port.expander_config import ChannelConfig, ExpanderConfig
from pointit.services.led_driver.output.serial_port.wiring import map_channels


def strip(name: str, pixels: int) -> Strip:
    return Strip(id=name, line_m=((0, 0, 0), (1, 0, 0)), pixels=pixels)


def test_set_channel_frame_matches_the_golden_bytes() -> None:
    golden = bytes.fromhex("55 50 58 4c 00 01 03 21 02 00 11 22 33 aa bb cc fb 69 48 ce")
    assert upxl_protocol.set_channel(0, "GRB", bytes.fromhex("112233aabbcc")) == golden


def test_draw_all_frame_matches_the_golden_bytes() -> None:
    assert upxl_protocol.draw_all() == bytes.fromhex("55 50 58 4c ff 02 9b 38 81 df")


@pytest.mark.parametrize(("order", "byte"), [("GRB", 0x21), ("RGB", 0x24), ("GRBW", 0xE1)])
def test_colour_order_is_encoded_in_one_byte(order: str, byte: int) -> None:
    assert upxl_protocol.set_channel(5, order, bytes(3))[7] == byte


def test_white_leds_get_a_dark_fourth_byte() -> None:
    frame = upxl_protocol.set_channel(9, "GRBW", bytes((1, 2, 3, 4, 5, 6)))
    assert frame[4:18] == bytes((9, 1, 4, 0xE1, 2, 0, 1, 2, 3, 0, 4, 5, 6, 0))


@given(st.integers(0, 63), st.binary(max_size=4800).map(lambda data: data[: len(data) // 3 * 3]))
def test_every_frame_says_its_size_and_ends_with_its_crc(channel: int, rgb: bytes) -> None:
    frame = upxl_protocol.set_channel(channel, "GRB", rgb)
    assert int.from_bytes(frame[8:10], "little") == len(rgb) // 3
    assert frame[10:-4] == rgb
    assert int.from_bytes(frame[-4:], "little") == zlib.crc32(frame[:-4])


def test_drawing_takes_as_long_as_the_longest_channel() -> None:
    picture = ExpanderFrame(((0, "GRB", bytes(3 * 240)), (1, "GRB", bytes(3 * 10))))
    assert 1 / picture.draw_time_s() == pytest.approx(133, abs=1)


def test_without_channels_strips_go_in_the_maps_order() -> None:
    wiring, problems = map_channels(ExpanderConfig(port="x"), [strip("b", 10), strip("a", 20)])
    assert [(w.number, w.order, w.pixels) for w in wiring.channels] == [(0, "GRB", 10), (1, "GRB", 20)]
    assert not problems


@pytest.mark.parametrize(
    ("board", "order", "limit"),
    [("v1", "GRB", 240), ("v1", "GRBW", 180), ("v2", "RGB", 800), ("v3", "GRB", 1600)],
)
def test_a_strip_beyond_the_boards_limit_is_cut_and_said(board: str, order: str, limit: int) -> None:
    config = ExpanderConfig.model_validate(
        {"kind": "expander", "port": "x", "board": board, "channels": {"s": {"channel": 3, "order": order}}}
    )
    wiring, problems = map_channels(config, [strip("s", limit)])
    assert (wiring.channels[0].pixels, problems) == (limit, [])
    wiring, problems = map_channels(config, [strip("s", limit + 1)])
    assert wiring.channels[0].pixels == limit
    assert "strip s" in problems[0]
    assert str(limit) in problems[0]
    assert board in problems[0]


def test_a_channel_for_a_strip_that_is_not_there_is_said() -> None:
    config = ExpanderConfig(port="x", channels={"no": ChannelConfig(channel=0)})
    wiring, problems = map_channels(config, [strip("s", 10)])
    assert wiring.channels == ()
    assert "no strip no" in problems[0]


def test_too_many_strips_are_said() -> None:
    wiring, problems = map_channels(ExpanderConfig(), [strip(str(k), 1) for k in range(65)])
    assert len(wiring.channels) == 64
    assert "65 strips" in problems[0]


@pytest.mark.parametrize(
    "channels",
    [
        {"a": {"channel": 1}, "b": {"channel": 1}},
        {"a": {"channel": 64}},
        {"a": {"channel": 0, "order": "GGB"}},
        {"a": {"channel": 0, "order": "GRBX"}},
    ],
)
def test_impossible_channels_are_refused(channels: dict[str, dict[str, object]]) -> None:
    with pytest.raises(ValidationError):
        ExpanderConfig.model_validate({"channels": channels})
