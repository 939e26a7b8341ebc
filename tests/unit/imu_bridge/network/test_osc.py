"""Open Sound Control of devices: orientations, rates, buttons and batteries, as apps really pack them.

The datagrams are python-osc's. Addresses and orders are those of the documentation of each device; none of
them was tried.
"""

import math
import re
import struct

import pytest
from pydantic import ValidationError
from pythonosc.osc_bundle_builder import OscBundleBuilder
from pythonosc.osc_message_builder import build_msg

from pointit.schemas import NS_PER_S
from pointit.services.imu_bridge.network.osc import MAX_MESSAGES, OscConfig, OscDecoder, OscMessage, parse
from pointit.services.imu_bridge.sources import Battery, Item, Press, RawReading, Reading
from pointit.services.imu_bridge.streams import MIN_READINGS, ContentError

WXYZ = [0.5, -0.5, 0.5, -0.5]
XYZW = (-0.5, 0.5, -0.5, 0.5)
NOW = 1_800_000_000 * NS_PER_S


def datagram(address: str, *arguments: float | str | bytes | None) -> bytes:
    return build_msg(address, list(arguments)).dgram


def items(decoder: OscDecoder, address: str, *arguments: float | str) -> list[Item]:
    return list(decoder.items(datagram(address, *arguments), NOW))


@pytest.mark.parametrize(
    ("address", "numbers"),
    [
        ("/quaternion", WXYZ),  # NGIMU
        ("/gyrosc/quat", WXYZ),
        ("/SceneRotator/quaternions", WXYZ),
        ("/ZIGSIM/0A1B-2C3D/quaternion", [*XYZW]),  # iPhone
        ("/rotationvector", [*XYZW, 0.1]),  # Sensors2OSC
        ("/gamerotationvector", [*XYZW]),
    ],
)
def test_orientations_of_known_devices(address: str, numbers: list[float]) -> None:
    decoder = OscDecoder(OscConfig())
    assert items(decoder, address, *numbers) == [Reading(NOW, XYZW)]


def test_two_part_address_is_zig_sims_only_beside_device_info() -> None:
    decoder = OscDecoder(OscConfig())
    assert items(decoder, "/my-phone/quaternion", *XYZW) == []
    assert decoder.unused.startswith("gets messages (/my-phone/quaternion), but none with a documented")
    items(decoder, "/my-phone/deviceinfo", "iPhone", "my-phone", "ios", "18.1", 1170.0, 2532.0)
    assert items(decoder, "/my-phone/quaternion", *XYZW) == [Reading(NOW, XYZW)]
    assert decoder.unused == ""


def test_address_and_order_are_configurable() -> None:
    decoder = OscDecoder(OscConfig(address="/wrist/7", order="xyzw"))
    assert items(decoder, "/wrist/7", *XYZW) == [Reading(NOW, XYZW)]
    assert items(decoder, "/wrist/8", *XYZW) == []
    assert items(decoder, "/quaternion", *XYZW) == []
    with pytest.raises(
        ContentError, match=r"/wrist/7 has numbers in an unknown order: .* --set imu-bridge\.osc\.order=xyzw"
    ):
        items(OscDecoder(OscConfig(address="/wrist/7")), "/wrist/7", *XYZW)


def test_quaternion_among_other_numbers_is_read_at_its_declared_position() -> None:
    with pytest.raises(
        ContentError, match=r"4 were expected: .* --set imu-bridge\.osc\.first=2 .*osc\.sensor_position=0"
    ):
        items(OscDecoder(OscConfig()), "/quaternion", 7.0, *WXYZ)
    with pytest.raises(ValidationError, match=r"osc\.first needs osc\.sensor_position: the position of"):
        OscConfig(first=2)
    config = OscConfig(first=2, sensor_position=0)
    assert items(OscDecoder(config), "/quaternion", 7.0, *WXYZ) == [Reading(NOW, XYZW)]
    with pytest.raises(ContentError, match=r"has 5 numbers: name one .*osc\.sensor_position=0"):
        items(OscDecoder(OscConfig(first=2, sensor_position=6)), "/quaternion", 7.0, *WXYZ)


def test_sensors_that_a_number_names_are_not_mixed() -> None:
    """Messages are a counter, the sensor, and its orientation; the counter passes the sensors' numbers."""
    other = [1.0, 0.0, 0.0, 0.0]
    stream = [(float(count), *((1.0, *WXYZ) if count % 2 else (2.0, *other))) for count in range(12)]
    several = OscDecoder(OscConfig(first=3, sensor_position=2))
    readings = [item for each in stream for item in items(several, "/quaternion", *each)]
    assert len(readings) <= MIN_READINGS  # until both are proven
    assert re.search(
        r"several sensors .*/quaternion 1, .* --set imu-bridge\.osc\.sensor=NAME", several.sensors.warning
    )
    chosen = OscDecoder(OscConfig(first=3, sensor_position=2, sensor="1"))
    assert [item for each in stream for item in items(chosen, "/quaternion", *each)] == [
        Reading(NOW, XYZW)
    ] * 6


def test_four_messages_below_the_declared_address_are_one_quaternion() -> None:
    decoder = OscDecoder(OscConfig(address="/quaternion"))
    found = [
        item
        for _ in range(2)
        for axis, n in zip("xyzw", XYZW, strict=True)
        for item in items(decoder, f"/quaternion/{axis}", n)
    ]
    assert found == [Reading(NOW, XYZW)] * 2
    assert items(OscDecoder(OscConfig()), "/quaternion/x", 0.5) == []


def test_time_of_a_bundle_is_the_time_of_the_device() -> None:
    bundle = OscBundleBuilder(1_700_000_000)
    bundle.add_content(build_msg("/quaternion", WXYZ))
    data = bundle.build().dgram
    assert OscDecoder(OscConfig()).items(data, NOW) == [Reading(NOW, XYZW, 1_700_000_000 * NS_PER_S)]


def test_rates_are_used_until_an_orientation_comes() -> None:
    decoder = OscDecoder(OscConfig())
    (raw,) = items(decoder, "/sensors", 90.0, 0.0, -180.0, 0.0, 0.0, 1.0, 20.0, 0.0, 40.0, 1013.0)
    assert isinstance(raw, RawReading)
    assert raw.angular_velocity_radps == pytest.approx((math.pi / 2, 0.0, -math.pi))
    assert raw.acceleration_mps2 == pytest.approx((0.0, 0.0, 9.80665))
    assert items(decoder, "/quaternion", *WXYZ) == [Reading(NOW, XYZW)]
    assert items(decoder, "/sensors", *[0.0] * 10) == []


def test_battery_when_it_changes_and_button_when_it_is_pressed() -> None:
    decoder = OscDecoder(OscConfig())
    for expected in ([Battery(0.75, 3.875)], []):
        assert items(decoder, "/battery", 75.0, 60.0, 3.875, 100.0, "charging") == expected
    assert items(decoder, "/button") == [Press(NOW)]
    assert items(decoder, "/gyrosc/button", 1.0, 1.0) == [Press(NOW)]
    assert items(decoder, "/gyrosc/button", 1.0, 0.0) == []


def test_messages_that_are_too_short_or_not_numbers_are_refused() -> None:
    decoder = OscDecoder(OscConfig())
    with pytest.raises(ContentError, match="/quaternion has 2 numbers, 4 were expected"):
        items(decoder, "/quaternion", 1.0, 0.0)
    assert items(decoder, "/battery", math.nan, 60.0, 3.9) == []
    with pytest.raises(ContentError, match="three finite numbers"):
        items(decoder, "/sensors", math.nan, *[0.0] * 9)


OSCILLATOR = bytes.fromhex("2f6f7363696c6c61746f722f342f6672657175656e637900 2c660000 43dc0000")
"""`/oscillator/4/frequency` with 440.0, of the specification."""


def test_example_of_the_specification() -> None:
    assert parse(OSCILLATOR) == ([OscMessage("/oscillator/4/frequency", (440.0,), None)], "")


def test_arguments_of_every_type() -> None:
    data = datagram("/a", 1, "text", 0.5, b"blob!", True, False, None, 2.5)
    assert parse(data) == ([OscMessage("/a", (1.0, 0.5, 1.0, 0.0, 2.5), None)], "")
    assert parse(datagram("/button")) == ([OscMessage("/button", (), None)], "")
    assert parse(b"/button\0") == ([OscMessage("/button", (), None)], "")


def test_bundles_in_bundles_have_the_time_of_the_sender() -> None:
    inner = OscBundleBuilder(1_700_000_000)
    inner.add_content(build_msg("/inner"))
    outer = OscBundleBuilder(1)  # immediately
    outer.add_content(build_msg("/outer"))
    outer.add_content(inner.build())
    found, _ = parse(outer.build().dgram)
    assert [each.address for each in found] == ["/outer", "/inner"]
    assert found[1].time_ns == 1_700_000_000 * NS_PER_S


@pytest.mark.parametrize(("tag", "time_ns"), [(1, None), (5 << 32 | 1 << 31, 5_500_000_000)])
def test_bundle_time_is_none_or_from_a_clock_never_set(tag: int, time_ns: int | None) -> None:
    data = b"#bundle\0" + struct.pack(">Qi", tag, len(OSCILLATOR)) + OSCILLATOR
    assert parse(data) == ([OscMessage("/oscillator/4/frequency", (440.0,), time_ns)], "")


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
        b"#bundle\0",
        b"#bundle\0" + bytes(8) + struct.pack(">i", -4),
        b"#bundle\0" + bytes(8) + struct.pack(">i", 400) + b"/a",
        b"x" * 10_000,
    ],
)
def test_datagram_that_is_not_osc_is_refused(data: bytes) -> None:
    with pytest.raises(ContentError):
        OscDecoder(OscConfig()).items(data, NOW)


def test_bundles_that_are_too_deep_or_too_full_are_bounded() -> None:
    data = OSCILLATOR
    for _ in range(5):
        data = b"#bundle\0" + struct.pack(">Qi", 1, len(data)) + data
    assert parse(data) == ([], "is not OSC: too many bundles in bundles, or one that is cut off")
    element = struct.pack(">i", 8) + b"/a\0\0,\0\0\0"
    assert len(parse(b"#bundle\0" + struct.pack(">Q", 1) + 600 * element)[0]) == MAX_MESSAGES


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


def test_unreadable_message_is_named_and_the_others_are_used() -> None:
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


def test_orientations_of_one_time_are_of_several_sensors() -> None:
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


def test_button_beside_another_sensor_is_ignored() -> None:
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
