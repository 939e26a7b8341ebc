"""Each reader counts what it passes over, with input of which it knows nothing, and says what arrives.

The inputs are written after the makers' documents and source, or by their libraries, not by code of PointIt.
"""

import json
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from mcap.writer import Writer
from pythonosc.osc_message_builder import build_msg

from pointit.maps.light_files.wled import read_segments
from pointit.recording.head import METADATA, make_head
from pointit.recording.reader import Recording
from pointit.services.imu_bridge.network.datagram_source import Decoder
from pointit.services.imu_bridge.network.osc import OscConfig, OscDecoder
from pointit.services.imu_bridge.network.udp import UdpConfig, UdpDecoder
from pointit.services.imu_bridge.network.ximu3 import Ximu3Decoder
from pointit.services.imu_bridge.serial.bno085 import Bno085Framer
from pointit.services.imu_bridge.serial.framers import SerialFramer
from pointit.services.imu_bridge.serial.text_line import TextFramer
from pointit.services.imu_bridge.serial.witmotion import WitMotionFramer
from pointit.services.imu_bridge.serial.ximu3 import Ximu3Framer

MAGNETIC = {"type": "android.sensor.magnetic_field", "timestamp": 5, "values": [21.0, 3.0, -40.0]}
"""Message of SensaGram about a sensor that has no orientation."""
TEMPERATURE = b"T,1000000,25.5\r\n"
"""Message of an x-IMU3, firmware 1.1."""
PORT_STATUS = b"\x55\x55" + bytes(8)
"""Packet of WitMotion, its kind 0x55, before its checksum."""


def osc(address: str) -> bytes:
    return build_msg(address, [1.0, 2.0]).dgram


DECODERS: dict[type[Decoder], tuple[Callable[[], Decoder], bytes, str]] = {
    UdpDecoder: (lambda: UdpDecoder(UdpConfig()), json.dumps(MAGNETIC).encode(), "magnetic_field"),
    OscDecoder: (lambda: OscDecoder(OscConfig()), osc("/1/fader1"), "/1/fader1"),
    Ximu3Decoder: (Ximu3Decoder, TEMPERATURE, "T"),
}
FRAMERS: dict[type[SerialFramer], tuple[Callable[[], SerialFramer], bytes]] = {
    TextFramer: (TextFramer, b"\n# gyro offsets 1 2 3\n"),
    WitMotionFramer: (
        lambda: WitMotionFramer(configure=False, baud=9600),
        PORT_STATUS + bytes([sum(PORT_STATUS) & 0xFF]),
    ),
    Ximu3Framer: (Ximu3Framer, TEMPERATURE),
}
ONE_FORMAT = {Bno085Framer}
"""Framers of devices with one kind of packet. All else is unreadable, and counted as that."""


def subclasses(kind: type[Decoder | SerialFramer]) -> set[type[Decoder | SerialFramer]]:
    return {each for each in kind.__subclasses__() if each.__module__.startswith("pointit.")}


def test_each_reader_of_wrists_has_an_input_here() -> None:
    assert subclasses(Decoder) == {*DECODERS}
    assert subclasses(SerialFramer) == {*FRAMERS} | ONE_FORMAT


@pytest.mark.parametrize("kind", DECODERS)
def test_decoder_counts_and_names_what_it_passes_over(kind: type[Decoder]) -> None:
    make, data, name = DECODERS[kind]
    decoder = make()
    for _ in range(3):
        assert list(decoder.items(data, 0)) == []
    assert decoder.passed_over.counts == {name: 3}
    assert name in decoder.unused


@pytest.mark.parametrize("kind", FRAMERS)
def test_framer_counts_what_it_passes_over(kind: type[SerialFramer]) -> None:
    make, data = FRAMERS[kind]
    framer = make()
    assert framer.feed(data, 0) == []
    assert framer.passed_over.count == 1
    assert framer.bad == 0


def test_recording_counts_messages_of_unknown_channels(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start()
        writer.add_metadata(METADATA, {"head": make_head("lab", 1).model_dump_json()})
        channel = writer.register_channel("/diagnostics", "cdr", 0)
        for number in range(4):
            writer.add_message(channel, number, struct.pack("<I", number), number)
        writer.finish()
    with Recording.open(path) as recording:
        assert recording.unknown == {"/diagnostics": 4}


def panels() -> Iterator[dict[str, int]]:
    for number in range(3):
        yield {"x": 16 * number, "y": 0, "w": 16, "h": 16}


def test_panels_of_a_wled_are_counted_by_output() -> None:
    outputs = [{"start": 0, "len": 512}, {"start": 512, "len": 256}, {"start": 768, "len": 30}]
    led = {"matrix": {"mpc": 3, "panels": [*panels()]}, "ins": outputs}
    segments = read_segments(json.dumps({"hw": {"led": led}}))
    assert [each.panels for each in segments] == [2, 1, 0]
