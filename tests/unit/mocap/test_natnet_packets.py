"""Packets of NatNet that others recorded and wrote, also changed and damaged."""

import contextlib
import json
import math
import random
import struct
from pathlib import Path

import pytest

from pointit.bridges.mocap.natnet_packets import (
    MalformedPacketError,
    connect_packet,
    read_frame,
    read_models,
    read_server_info,
    split_packet,
)

FILE = json.loads((Path(__file__).parent / "packets.json").read_text(encoding="utf-8"))
PACKETS = {
    name: bytes.fromhex(text)
    for group in ("recorded", "encoded")
    for name, text in FILE[group]["packets"].items()
}
RECORDED = {
    "2.5": (92881, 1, (-0.2631579, 0.0391267, 1.1235183), 6.563962e-06, None),
    "2.7": (411213, 1, (0.0060196, 0.0958076, -1.4075972), 2.163400e-05, None),
    "2.9": (11823217, 2, (0.2453393, 0.0169602, 0.2201603), 1.156181e-04, 3),
}


def version_of(name: str) -> tuple[int, int]:
    major, _, minor = name.rsplit(maxsplit=1)[-1].partition(".")
    return int(major), int(minor)


@pytest.mark.parametrize("version", RECORDED)
def test_frames_that_were_recorded_from_motive_are_read(version: str) -> None:
    number, body_id, position_m, error_m, measured = RECORDED[version]
    name = f"frame {version}"
    frame = read_frame(split_packet(PACKETS[name])[1], version_of(name))
    (body,) = frame.bodies
    assert (frame.number, frame.flags, body.id, body.is_tracked) == (number, 0, body_id, True)
    assert body.position_m == pytest.approx(position_m, abs=1e-6)
    assert body.error_m == pytest.approx(error_m, rel=1e-5)
    assert math.hypot(*body.orientation_xyzw) == pytest.approx(1.0)
    assert body.measured == measured


@pytest.mark.parametrize("version", ["3.0", "3.1", "4.0", "4.1"])
def test_frames_that_another_program_wrote_are_read_past_skeletons_assets_and_plates(version: str) -> None:
    frame = read_frame(split_packet(PACKETS[f"frame {version}"])[1], version_of(version))
    cup, occluded, ghost = frame.bodies
    assert (frame.number, frame.flags, frame.exposure_ticks) == (1234, 2, 125_000_000)
    assert (cup.id, cup.position_m, cup.is_tracked, cup.measured) == (7, (1.0, 1.25, -2.5), True, 3)
    assert cup.orientation_xyzw == pytest.approx((0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)))
    assert (occluded.id, occluded.is_tracked) == (8, False)
    assert (ghost.id, ghost.is_tracked, ghost.measured) == (3, True, 0)


@pytest.mark.parametrize("version", ["3.0", "3.1", "4.0", "4.1"])
def test_names_that_another_program_wrote_are_read_past_other_models(version: str) -> None:
    payload = split_packet(PACKETS[f"models {version}"])[1]
    assert read_models(payload, version_of(version)) == {7: ("cup",), 8: ("Größe 8",), 3: ("ghost",)}


@pytest.mark.parametrize("name", [name for name in PACKETS if name.startswith("info")])
def test_servers_that_others_recorded_and_wrote_are_read(name: str) -> None:
    info = read_server_info(split_packet(PACKETS[name])[1])
    is_new = version_of(name) >= (3, 0)
    assert info.version[0] == version_of(name)[0]
    assert info.application == ("Motive" if is_new else "NatNetLib")
    assert (info.clock_hz, info.data_port, info.group) == (10_000_000 if is_new else 0, 1511, "239.255.42.99")


def test_bodies_of_later_versions_may_be_longer() -> None:
    body = struct.pack("<i3f4ffH", 5, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0, 0.001, 1) + b"later"
    sections = struct.pack("<8i", 9, 0, 0, 0, 0, 2, 2 * len(body), 0)[:28] + 2 * body
    rest = struct.pack("<10i", *[0] * 10) + bytes(8) + struct.pack("<IId3QII", 0, 0, 0.0, 4, 5, 6, 0, 0)
    frame = read_frame(sections + rest + struct.pack("<Hi", 0, 0), (4, 4))
    assert [each.position_m for each in frame.bodies] == [(1.0, 2.0, 3.0)] * 2
    assert (frame.exposure_ticks, frame.sent_ticks) == (4, 6)


@pytest.mark.parametrize("number", [math.nan, math.inf, 1e20])
def test_a_body_without_a_position_or_orientation_is_not_tracked(number: float) -> None:
    payload = split_packet(PACKETS["frame 3.1"])[1]
    cup = struct.pack("<i3f", 7, 1.0, 1.25, -2.5)
    assert payload.count(cup) == 1
    at = payload.index(cup)
    for begin, values in ((at + 8, (number,)), (at + 16, (0.0, 0.0, 0.0, 0.0))):
        changed = bytearray(payload)
        struct.pack_into(f"<{len(values)}f", changed, begin, *values)
        assert not read_frame(bytes(changed), (3, 1)).bodies[0].is_tracked


def test_names_may_be_empty_repeat_and_be_in_the_code_page_of_windows() -> None:
    payload = split_packet(PACKETS["models 3.1"])[1]
    body = struct.pack("<i", 1)  # the kind of a model, before its name
    changed = payload.replace(body + b"cup\0", body + b"\0").replace(body + b"ghost\0", body + b"cup\0")
    changed = changed.replace("Größe 8".encode(), "Größe 8".encode("cp1252"))
    assert read_models(changed, (3, 1)) == {7: ("",), 8: ("Größe 8",), 3: ("cup",)}


def test_a_request_to_connect_asks_for_version_4_1() -> None:
    message, payload = split_packet(connect_packet())
    assert (message, len(payload), payload[-4:]) == (0, 269, bytes((4, 1, 0, 0)))


def test_thousands_of_damaged_packets_are_refused_or_read_and_raise_nothing_else() -> None:
    dice = random.Random(1)
    names = sorted(PACKETS)
    for _ in range(2000):
        name = dice.choice(names)
        damaged = bytearray(PACKETS[name])
        for _ in range(dice.choice((0, 1, 1, 2, 8))):
            damaged[dice.randrange(len(damaged))] = dice.choice((0, 1, 127, 128, 255, dice.randrange(256)))
        cut = dice.choice((len(damaged), len(damaged), dice.randrange(len(damaged))))
        read_all(bytes(damaged[:cut]), version_of(name))


def read_all(data: bytes, version: tuple[int, int]) -> None:
    """Read in every way. Anything but a `MalformedPacketError` is an error."""
    for read in (
        lambda: read_frame(split_packet(data)[1], version),
        lambda: read_models(split_packet(data)[1], version),
        lambda: read_server_info(split_packet(data)[1]),
    ):
        with contextlib.suppress(MalformedPacketError):
            read()


def test_an_independent_decoder_reads_the_same() -> None:
    data_frame = pytest.importorskip("natnet.data_frame", reason="natnet 0.3.0 is not installed")
    buffers = pytest.importorskip("natnet.packet_buffer")
    versions = pytest.importorskip("natnet.version")
    frames = {name: data for name, data in PACKETS.items() if name.startswith("frame")}
    for name, data in frames.items():
        payload, version = split_packet(data)[1], version_of(name)
        theirs = data_frame.DataFrame.read_from_buffer(
            buffers.PacketBuffer(payload), versions.Version(*version)
        )
        ours = read_frame(payload, version)
        assert ours.number == theirs.prefix.frame_number, name
        assert [body.id for body in ours.bodies] == [body.id_num for body in theirs.rigid_bodies]
        for body, other in zip(ours.bodies, theirs.rigid_bodies, strict=True):
            assert body.is_tracked == other.tracking_valid or version < (2, 6)
            assert body.position_m == other.pos
            assert body.orientation_xyzw == pytest.approx(other.rot, abs=1e-6)
            assert body.error_m == other.marker_error
        if version >= (3, 0):
            assert ours.exposure_ticks == theirs.suffix.stamp_camera_mid_exposure
