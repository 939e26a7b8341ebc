"""Open Sound Control, by its specification's examples and by python-osc, an independent implementation."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pythonosc.osc_bundle_builder import OscBundleBuilder
from pythonosc.osc_message_builder import OscMessageBuilder

from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge.network.contents import DatagramError
from pointit.services.imu_bridge.network.osc_message import MOST_MESSAGES, OscMessage, parse

OSCILLATOR = bytes.fromhex("2f6f7363696c6c61746f722f342f6672657175656e637900 2c660000 43dc0000")
"""`/oscillator/4/frequency` with 440.0, of the specification."""


def by_python_osc(address: str, *arguments: str | bytes | float | None) -> bytes:
    builder = OscMessageBuilder(address)
    for argument in arguments:
        builder.add_arg(argument)
    return bytes(builder.build().dgram)


def test_example_of_the_specification() -> None:
    assert parse(OSCILLATOR) == [OscMessage("/oscillator/4/frequency", (440.0,), None)]


def test_arguments_of_every_type() -> None:
    data = by_python_osc("/a", 1, "text", 0.5, b"blob!", True, False, None, 2.5)
    assert parse(data) == [OscMessage("/a", (1.0, 0.5, 1.0, 0.0, 2.5), None)]
    assert parse(by_python_osc("/button")) == [OscMessage("/button", (), None)]
    assert parse(b"/button\0") == [OscMessage("/button", (), None)]


def test_bundles_in_bundles_have_the_time_of_the_sender() -> None:
    inner = OscBundleBuilder(1_700_000_000)
    inner.add_content(OscMessageBuilder("/inner").build())
    outer = OscBundleBuilder(1)  # immediately
    outer.add_content(OscMessageBuilder("/outer").build())
    outer.add_content(inner.build())
    found = parse(outer.build().dgram)
    assert [each.address for each in found] == ["/outer", "/inner"]
    assert found[1].time_ns == 1_700_000_000 * NS_PER_S


def test_clock_that_was_never_set_counts_from_its_start() -> None:
    data = b"#bundle\0" + struct.pack(">Qi", 5 << 32 | 1 << 31, len(OSCILLATOR)) + OSCILLATOR
    assert parse(data)[0].time_ns == 5.5 * NS_PER_S


def test_time_of_a_bundle_without_one_is_none() -> None:
    data = b"#bundle\0" + struct.pack(">Qi", 1, len(OSCILLATOR)) + OSCILLATOR
    assert parse(data) == [OscMessage("/oscillator/4/frequency", (440.0,), None)]


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"/a",
        b"a\0\0\0,f\0\0",
        b"/a\0\0f\0\0\0",
        b"/a\0\0,f\0\0\0",
        b"/a\0\0,b\0\0\xff\xff\xff\xff",
        b"/a\0\0,?\0\0",
        b"/\xff\0\0,\0\0\0",
        b"#bundle\0",
        b"#bundle\0" + bytes(8) + struct.pack(">i", -4),
        b"#bundle\0" + bytes(8) + struct.pack(">i", 400) + b"/a",
        b"x" * 10_000,
    ],
)
def test_what_is_not_osc_is_refused(data: bytes) -> None:
    with pytest.raises(DatagramError):
        parse(data)


def test_bundles_that_are_too_deep_or_too_full_are_bounded() -> None:
    data = OSCILLATOR
    for _ in range(5):
        data = b"#bundle\0" + struct.pack(">Qi", 1, len(data)) + data
    with pytest.raises(DatagramError, match="too many bundles"):
        parse(data)
    element = struct.pack(">i", 8) + b"/a\0\0,\0\0\0"
    assert len(parse(b"#bundle\0" + struct.pack(">Q", 1) + 600 * element)) == MOST_MESSAGES


@given(
    st.sampled_from([b"", b"#bundle\0" + bytes(8), b"/quaternion\0,ffff\0\0\0", b"/a\0\0,"]),
    st.binary(max_size=120),
)
def test_any_bytes_are_parsed_or_refused(head: bytes, rest: bytes) -> None:
    try:
        found = parse(head + rest)
    except DatagramError:
        return
    assert len(found) <= MOST_MESSAGES
