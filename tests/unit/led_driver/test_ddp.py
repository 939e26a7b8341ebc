"""DDP: the bytes, the order of packets as WLED accepts it, the search for controllers."""

import struct
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.errors import ConfigError
from pointit.runtime.service.surroundings import Surroundings
from pointit.services.led_driver.output.ddp import DDP, DdpConfig, described
from pointit.services.led_driver.output.ddp_protocol import encode_frame


def test_frame_of_a_thousand_pixels_matches_the_golden_bytes() -> None:
    pixels = bytes(k % 256 for k in range(3000))
    packets = encode_frame(pixels, 3, 1)
    assert [packet[:10].hex() for packet in packets] == [
        "40010b010000000005a0",
        "40020b01000005a005a0",
        "41030b0100000b400078",
    ]
    assert b"".join(packet[10:] for packet in packets) == pixels


def test_white_is_told_and_packets_hold_whole_pixels() -> None:
    first, last = encode_frame(bytes(4 * 400), 4, 1)
    assert (first[2], len(first) - 10) == (0x1B, 4 * 360)
    assert struct.unpack(">I", last[4:8]) == (4 * 360,)


def shown_by_wled(packets: Sequence[bytes], last_push: int) -> tuple[bool, int]:
    """Return True if WLED takes all packets after a frame that ended with `last_push`, and their own end.

    The rule is that of the description of WLED 0.15, with its default to skip packets out of sequence.
    """
    for packet in packets:
        sequence = packet[1]
        if sequence and last_push:
            if last_push > 5:
                if last_push - 5 < sequence < last_push:
                    return False, last_push
            elif sequence > 10 + last_push or sequence < last_push:
                return False, last_push
    return True, packets[-1][1] or last_push


@given(st.integers(1, 20_000), st.sampled_from([3, 4]))
def test_wled_takes_no_packet_for_a_late_one_and_shows_each_frame_once(pixels: int, colors: int) -> None:
    data, last = bytes(pixels * colors), 0
    for number in range(1, 18):
        packets = encode_frame(data, colors, number)
        taken, last = shown_by_wled(packets, last)
        assert taken
        assert [packet[0] & 1 for packet in packets] == [0] * (len(packets) - 1) + [1]
        assert all(packet[1] <= 15 for packet in packets)
        assert sum(len(packet) - 10 for packet in packets) == len(data)


def test_output_without_pixels_sends_nothing() -> None:
    assert encode_frame(b"", 3, 1) == []


def test_output_without_a_host_is_refused() -> None:
    with pytest.raises(ConfigError, match="host: is missing"):
        DDP.make(DdpConfig(), Surroundings.detached())


def test_controller_is_described_by_its_name_pixels_and_version() -> None:
    info = {"leds": {"count": 120}, "ver": "0.15.1", "name": "Kitchen"}
    found = described("wled-kitchen.local", "wled-kitchen", info)
    assert (found.address, found.label) == ("wled-kitchen.local", "Kitchen, 120 pixels, WLED 0.15.1")
    assert found.details == {"pixels": 120, "version": "0.15.1"}


@given(st.recursive(st.none() | st.integers() | st.text(), lambda some: st.dictionaries(st.text(), some)))
def test_controller_that_describes_itself_oddly_is_listed_all_the_same(info: object) -> None:
    assert described("10.0.0.9", "wled-1", info).address == "10.0.0.9"
    assert described("10.0.0.9", "wled-1", {"leds": info}).label.startswith("wled-1")
