"""OSC as apps really pack it: text of any encoding, unknown arguments, several sensors at one port."""

import struct

import pytest
from pythonosc.osc_message_builder import build_msg

from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge.network.osc import OscConfig, OscDecoder
from pointit.services.imu_bridge.sources import Item, Press, Reading

WXYZ, XYZW = [0.5, -0.5, 0.5, -0.5], (-0.5, 0.5, -0.5, 0.5)
NOW = 1_800_000_000 * NS_PER_S


def items(decoder: OscDecoder, address: str, *arguments: float | str) -> list[Item]:
    return list(decoder.items(build_msg(address, list(arguments)).dgram, NOW))


def packed(address: str, types: str, *parts: bytes, encoding: str = "utf-8") -> bytes:
    """Return a message of any bytes, as python-osc cannot send it."""
    head = b"".join(each + bytes(4 - len(each) % 4) for each in (address.encode(encoding), types.encode()))
    return head + b"".join(parts)


def bundled(*messages: bytes) -> bytes:
    elements = b"".join(struct.pack(">i", len(each)) + each for each in messages)
    return b"#bundle\0" + struct.pack(">Q", 1) + elements


def string(text: str, encoding: str = "utf-8") -> bytes:
    data = text.encode(encoding)
    return data + bytes(4 - len(data) % 4)


FLOATS = struct.pack(">4f", *XYZW)
ROTATION = packed("/ZIGSIM/hand/quaternion", ",ffff", FLOATS)


@pytest.mark.parametrize(
    "beside",
    [
        packed("/ZIGSIM/hand/deviceinfo", ",sf", string("Joséphine 电话"), struct.pack(">f", 1.0)),
        packed("/ZIGSIM/hand/deviceinfo", ",sf", string("José", "latin-1"), struct.pack(">f", 1.0)),
        packed("/ZIGSIM/hänsel/touch", ",f", struct.pack(">f", 1.0)),
        packed(
            "/hand/all", ",TFNIhdtcrm[i]b", *map(bytes, (8, 8, 8, 4, 4, 4, 4)), struct.pack(">i", 3), b"abc\0"
        ),
        packed("/hand/new", ",Q", bytes(8)),  # a type that nobody knows
        packed("/hand/cut", ",f"),
        packed("/hand/blob", ",b", struct.pack(">i", 400), b"abcd"),
        b"#bundle\0" + bytes(8) + struct.pack(">i", 9000),
        b"hand",
    ],
)
def test_messages_beside_an_orientation_never_drop_it(beside: bytes) -> None:
    for data in (bundled(beside, ROTATION), bundled(ROTATION, beside), bundled(bundled(ROTATION), beside)):
        assert OscDecoder(OscConfig()).items(data, NOW) == [Reading(NOW, XYZW)]


def test_message_that_cannot_be_read_is_named_while_the_others_are_used() -> None:
    decoder = OscDecoder(OscConfig())
    assert decoder.items(bundled(packed("/hand/new", ",Q", bytes(8)), ROTATION), NOW) == [Reading(NOW, XYZW)]
    assert decoder.problem == "is not OSC: /hand/new has an argument of the unknown type 'Q'"
    decoder = OscDecoder(OscConfig())
    wrong = packed("/ZIGSIM/head/quaternion", ",ffff", struct.pack(">4f", 1, 1, 0, 0))
    assert decoder.items(bundled(ROTATION, wrong), NOW) == [Reading(NOW, XYZW)]
    assert decoder.problem.startswith("/ZIGSIM/head/quaternion has a quaternion of norm 1.414214, not 1")


@pytest.mark.parametrize(
    "data",
    [
        packed("/ZIGSIM/Zoë/quaternion", ",ffff", FLOATS),
        packed("/ZIGSIM/Zoë/quaternion", ",ffff", FLOATS, encoding="latin-1"),
        packed("/ZIGSIM/hand/quaternion", ",dddd", struct.pack(">4d", *XYZW)),
        packed("/ZIGSIM/hand/quaternion", ",ssss", *(string(f"{value}") for value in XYZW)),
        packed("/ZIGSIM/hand/quaternion", ",[ffff]", FLOATS),
        packed("/ZIGSIM/hand/quaternion", ",ffffs", FLOATS, string("Zoë")),
        packed("/ZIGSIM/hand/quaternion", ",ffffQ", FLOATS, bytes(8)),
        string("/ZIGSIM/hand/quaternion") + FLOATS,  # without types
        packed("/ZIGSIM/hand/quaternion", ",ffff", struct.pack(">4f", *(1.03 * value for value in XYZW))),
    ],
)
def test_orientations_as_senders_pack_them(data: bytes) -> None:
    (reading,) = OscDecoder(OscConfig()).items(data, NOW)
    assert isinstance(reading, Reading)
    assert reading.world_from_sensor == pytest.approx(XYZW)


OTHER = (0.0, 0.0, 0.6, 0.8)


@pytest.mark.parametrize(
    ("mine", "others", "wanted"),
    [
        (("/ZIGSIM/hand/quaternion", *XYZW), ("/ZIGSIM/elbow/quaternion", *OTHER), "/ZIGSIM/hand/quaternion"),
        (("/rotationvector", *XYZW), ("/gamerotationvector", *OTHER), "/rotationvector"),
        (("/quaternion", "Zoë", *WXYZ), ("/quaternion", "Bo", 0.8, 0.0, 0.0, 0.6), "zoë"),
    ],
)
def test_stream_of_two_sensors_is_refused_until_one_is_named(
    mine: tuple[str | float, ...], others: tuple[str | float, ...], wanted: str
) -> None:
    for sensor, count in (("", 2), (wanted, 6)):  # two, before the second sensor is proven
        decoder = OscDecoder(OscConfig(sensor=sensor))
        found = [
            item
            for _ in range(6)
            for address, *arguments in (mine, others)
            for item in decoder.items(build_msg(str(address), arguments).dgram, NOW)
        ]
        assert found == [Reading(NOW, XYZW)] * count
        assert ("--set imu-bridge.osc.sensor" in decoder.sensors.warning) is not bool(sensor)


def test_orientations_of_one_address_and_time_are_those_of_several_sensors() -> None:
    head = packed("/quaternion", ",ffff", struct.pack(">4f", *WXYZ))
    other = packed("/quaternion", ",ffff", struct.pack(">4f", 0.8, 0.0, 0.0, 0.6))
    for sensor, expected in (("/quaternion", XYZW), ("/quaternion 2", OTHER)):
        decoder = OscDecoder(OscConfig(sensor=sensor))
        (reading,) = decoder.items(bundled(head, other), NOW)
        assert isinstance(reading, Reading)
        assert reading.world_from_sensor == pytest.approx(expected)
    decoder = OscDecoder(OscConfig())
    assert len([item for _ in range(9) for item in decoder.items(bundled(head, other), NOW)]) <= 2
    assert (
        "(/quaternion, /quaternion 2), and none is used: name the wrist's by --set" in decoder.sensors.warning
    )


def test_button_beside_the_orientation_of_another_sensor_is_not_the_arms() -> None:
    decoder = OscDecoder(OscConfig(sensor="/ZIGSIM/hand/quaternion"))
    items(decoder, "/ZIGSIM/hand/quaternion", *XYZW)
    items(decoder, "/ZIGSIM/elbow/quaternion", *OTHER)
    assert items(decoder, "/ZIGSIM/elbow/button", 1.0) == []
    assert items(decoder, "/ZIGSIM/hand/button", 1.0) == [Press(NOW)]
    assert items(decoder, "/button", 1.0) == [Press(NOW)]


def test_addresses_without_an_orientation_are_named() -> None:
    decoder = OscDecoder(OscConfig())
    items(decoder, "/accxyz", 0.0, 0.0, 9.8)
    items(decoder, "/1/fader1", 0.5)
    assert decoder.unused.startswith(
        "gets messages (/accxyz, /1/fader1), but none with a documented orientation: switch it"
    )
    items(decoder, "/quaternion", *WXYZ)
    assert decoder.unused == ""
