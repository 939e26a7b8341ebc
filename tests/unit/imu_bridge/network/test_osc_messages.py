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
        (("/hand/quaternion", *XYZW), ("/elbow/quaternion", *OTHER), "hand"),
        (("/rotationvector", *XYZW), ("/gamerotationvector", *OTHER), "/rotationvector"),
        (("/quaternion", 0, *WXYZ), ("/quaternion", 1, 0.8, 0.0, 0.0, 0.6), "0"),
        (("/quaternion", 7.0, *WXYZ), ("/quaternion", 8.0, 0.8, 0.0, 0.0, 0.6), "7"),
        (("/quaternion", "Zoë", *WXYZ), ("/quaternion", "Bo", 0.8, 0.0, 0.0, 0.6), "zoë"),
    ],
)
def test_second_sensor_is_reported_and_not_read(
    mine: tuple[str | float, ...], others: tuple[str | float, ...], wanted: str
) -> None:
    for sensor in ("", wanted):
        decoder = OscDecoder(OscConfig(sensor=sensor))
        found = [
            item
            for _ in range(6)
            for address, *arguments in (mine, others)
            for item in decoder.items(build_msg(str(address), arguments).dgram, NOW)
        ]
        assert found[1:] == [Reading(NOW, XYZW)] * (len(found) - 1)
        assert len(found) >= 5
        assert ("set osc.sensor" in decoder.sensors.warning) is not bool(sensor)


@pytest.mark.parametrize(
    ("numbers", "second"),
    [
        ((*WXYZ, 0.8, 0.0, 0.0, 0.6), "2"),
        ((*WXYZ, 0.8, 0.0, 0.0, 0.6, 1.0, 0.0, 0.0, 0.0), "2"),
        ((12.5, *WXYZ, 0.8, 0.0, 0.0, 0.6), "2"),  # behind a time
        ((4, *WXYZ, 9, 0.8, 0.0, 0.0, 0.6), "9"),  # behind their numbers
        ((*WXYZ, 3, 0.8, 0.0, 0.0, 0.6, 2), "2"),  # before their accuracies
    ],
)
def test_each_quaternion_of_a_message_is_a_sensor_of_its_own(numbers: tuple[float, ...], second: str) -> None:
    for sensor, orientation in (("", XYZW), (second, (0.0, 0.0, 0.6, 0.8))):
        decoder = OscDecoder(OscConfig(sensor=sensor))
        found = [item for _ in range(4) for item in items(decoder, "/quaternion", *numbers)]
        assert found == [Reading(NOW, pytest.approx(orientation))] * 4  # pyrefly: ignore[bad-argument-type]
        assert ("set osc.sensor" in decoder.sensors.warning) is not bool(sensor)


def test_position_in_front_of_a_quaternion_is_no_orientation() -> None:
    decoder = OscDecoder(OscConfig())
    found = [item for x in (5.2, 0.3, -1.0) for item in items(decoder, "/quat", x, 2.1, -20.7, *WXYZ)]
    assert found == [Reading(NOW, XYZW)] * 3
    assert decoder.sensors.warning == ""


def test_numbers_behind_a_quaternion_that_are_none_name_no_sensor() -> None:
    decoder = OscDecoder(OscConfig())
    found = [item for n in range(30) for item in items(decoder, "/quaternion", *WXYZ, 9.8, 0.1, n / 10, 3.0)]
    assert found == [Reading(NOW, XYZW)] * 30
    assert decoder.sensors.warning == ""


def test_button_beside_the_orientation_of_another_sensor_is_not_the_arms() -> None:
    decoder = OscDecoder(OscConfig())
    items(decoder, "/hand/quaternion", *XYZW)
    items(decoder, "/elbow/quaternion", *OTHER)
    assert items(decoder, "/elbow/button", 1.0) == []
    assert items(decoder, "/hand/button", 1.0) == [Press(NOW)]
    assert items(decoder, "/button", 1.0) == [Press(NOW)]


def test_addresses_without_an_orientation_are_named() -> None:
    decoder = OscDecoder(OscConfig())
    items(decoder, "/accxyz", 0.0, 0.0, 9.8)
    items(decoder, "/1/fader1", 0.5)
    assert decoder.unused.startswith(
        "gets messages (/accxyz, /1/fader1), but none with a quaternion: switch it"
    )
    items(decoder, "/quaternion", *WXYZ)
    assert decoder.unused == ""
    items(decoder, "/quaternion", 1.0, 0.0)
    assert decoder.problem == "/quaternion has 2 numbers, 4 were expected"


def test_numbers_before_and_behind_a_quaternion_are_told_apart_by_norms_and_returns() -> None:
    for before in ([n / 100 for n in range(200)], list(range(200))):  # a time, a count
        decoder = OscDecoder(OscConfig())
        found = [item for each in before for item in items(decoder, "/quaternion", each, *WXYZ)]
        assert len(found) > 180
        assert decoder.sensors.warning == ""
    decoder = OscDecoder(OscConfig())
    found = [item for n in range(40) for item in items(decoder, "/quaternion", *WXYZ, n // 20)]
    assert found == [Reading(NOW, XYZW)] * 40  # an accuracy
    level = [item for _ in range(9) for item in items(OscDecoder(OscConfig()), "/quaternion", 1, 0, 0, 0, 3)]
    assert level == [Reading(NOW, (0.0, 0.0, 0.0, 1.0))] * 9  # whole numbers, as Max sends them
