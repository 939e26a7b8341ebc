"""Quaternions beside other numbers, of several sensors, and at addresses as other people name them."""

import math
import struct
from collections.abc import Sequence

import pytest
from pythonosc.osc_message_builder import OscMessageBuilder

from pointit.services.imu_bridge.network.datagram_source import DatagramError
from pointit.services.imu_bridge.network.osc import OscConfig, OscDecoder
from pointit.services.imu_bridge.serial.line_parser import MAX_OPEN, MAX_RISES
from pointit.services.imu_bridge.sources import Reading

N = 150
Numbers = Sequence[float]


def turned(step: int, phase: float = 0.0) -> tuple[float, float, float, float]:
    """Return w, x, y, z of a wrist that starts level and turns."""
    half = 0.01 * step + phase
    axis = (0.6, 0.48 * math.cos(phase), 0.64)
    norm = math.hypot(*axis)
    x, y, z = (math.sin(half) * each / norm for each in axis)
    return (math.cos(half), x, y, z)


def message(address: str, types: str, numbers: Sequence[float | str]) -> bytes:
    builder = OscMessageBuilder(address)
    for kind, each in zip(types, numbers, strict=True):
        builder.add_arg(each, kind)
    return builder.build().dgram


def bundled(*messages: bytes) -> bytes:
    return b"#bundle\0" + struct.pack(">Q", 1) + b"".join(struct.pack(">i", len(m)) + m for m in messages)


def read_all(decoder: OscDecoder, datagrams: Sequence[bytes]) -> tuple[list[tuple[int, Reading]], set[str]]:
    """Return the readings with the numbers of their datagrams, and the problems."""
    readings: list[tuple[int, Reading]] = []
    problems: set[str] = set()
    for step, data in enumerate(datagrams):
        try:
            items = decoder.items(data, step)
        except DatagramError as error:
            problems.add(str(error))
            continue
        readings += [(step, item) for item in items if isinstance(item, Reading)]
        problems |= {decoder.problem} - {""}
        decoder.problem = ""
    return readings, problems


def assert_are_turned(readings: Sequence[tuple[int, Reading]], phase: float = 0.0) -> None:
    for step, reading in readings:
        w, x, y, z = turned(step, phase)
        assert reading.world_from_sensor == pytest.approx((x, y, z, w), abs=1e-5)


@pytest.mark.parametrize(
    ("types", "before", "behind"),
    [
        ("iiffff", ((5000, 10), (3, 0)), ()),  # a time and the number of a sensor
        ("iiffff", ((3, 0), (0, 10)), ()),
        ("hiffff", ((1_700_000_000_000, 1), (7, 0)), ()),
        ("fffff", ((0.0, 0.0),), ()),  # the number of a sensor as a float
        ("fffff", ((1.0, 0.0),), ()),
        ("fffff", ((0.0, 0.01),), ()),
        ("iiiffff", ((0, 1), (2, 0), (1, 0)), ()),
        ("ffffff", ((0.0, 0.01), (4.0, 0.0)), ()),
        ("ddddd", (), (0.05,)),  # an accuracy
        ("ffffi", (), (87,)),
        ("f" * 10, ((0.02, 0.0), (-0.4, 0.01), (0.91, 0.002), (0.01, 0.0), (0.2, 0.0), (0.1, 0.0)), ()),
        ("f" * 10, (), (0.01, 0.02, 0.99, 0.0, 0.1, 0.2)),
        ("fffffff", ((0.2, 0.0), (0.1, 0.02), (0.0, 0.0)), ()),  # a position
        ("ffffffff", ((0.0, 0.01), (0.2, 0.0), (0.1, 0.0), (1.5, 0.0)), ()),
    ],
)
def test_quaternion_is_never_mixed_with_numbers_beside_it(
    types: str, before: Sequence[tuple[float, float]], behind: Numbers
) -> None:
    decoder = OscDecoder(OscConfig(order="wxyz"))
    datagrams = [
        message("/quat", types, (*(start + n * step for start, step in before), *turned(n), *behind))
        for n in range(N)
    ]
    readings, _ = read_all(decoder, datagrams)
    assert_are_turned(readings)
    assert len(readings) >= N - MAX_RISES - 20
    assert decoder.sensors.warning == ""


def test_position_of_a_quaternion_that_stays_open_is_reported_and_can_be_set() -> None:
    level = [message("/quat", "fffff", (0.0, 1.0, 0.0, 0.0, 0.0))] * (MAX_OPEN + 9)
    readings, problems = read_all(OscDecoder(OscConfig()), level)
    assert readings == []
    (problem,) = problems
    assert problem.startswith(
        "/quat has 5 numbers, of which the quaternion may begin at 1 or 2: set osc.first to"
    )
    readings, problems = read_all(OscDecoder(OscConfig(first=2)), level)
    assert {reading.world_from_sensor for _, reading in readings} == {(0.0, 0.0, 0.0, 1.0)}
    assert problems == set()
    _, problems = read_all(OscDecoder(OscConfig(first=3)), level)
    assert problems == {"/quat has 5 numbers, and osc.first is 3: set it to the first of four"}


def test_gravity_is_no_orientation_while_the_quaternion_is_not_known_yet() -> None:
    decoder = OscDecoder(OscConfig())
    datagrams = [
        message("/imu/quat", "fffffff", (*(turned(n) if n > 40 else [0.0] * 4), 0.0, 0.0, 1.0))
        for n in range(N)
    ]
    readings, problems = read_all(decoder, datagrams)
    assert len(readings) > N - 70
    assert_are_turned(readings)
    assert any("begins with four zeros" in each for each in problems)


def test_message_without_a_quaternion_is_reported_and_the_known_position_stays() -> None:
    decoder = OscDecoder(OscConfig())
    numbers = [(9.0, 9.0, *turned(n)) if n != 60 else (1.0, 0.0, 0.0, 0.0, 5.0, 5.0) for n in range(N)]
    readings, problems = read_all(decoder, [message("/imu/quat", "ffffff", each) for each in numbers])
    assert_are_turned(readings)
    assert {step for step, _ in readings} >= {*range(30, N)} - {60}
    assert any("has 6 numbers without a quaternion, whose norm is 1" in each for each in problems)


@pytest.mark.parametrize(("sensor", "phase"), [("", 0.0), ("1", 0.0), ("2", 2.0)])
def test_messages_with_one_address_in_a_bundle_are_of_several_sensors(sensor: str, phase: float) -> None:
    decoder = OscDecoder(OscConfig(sensor=sensor))
    datagrams = [
        bundled(message("/quat", "ffff", turned(n)), message("/quat", "ffff", turned(n, 2.0)))
        for n in range(N)
    ]
    readings, _ = read_all(decoder, datagrams)
    assert len(readings) == N
    assert_are_turned(readings, phase)
    expected = "" if sensor else "/quat 1 is used, not /quat 2; set osc.sensor to the one on the wrist"
    assert decoder.sensors.warning.endswith(expected)
    assert bool(decoder.sensors.warning) is not bool(sensor)


def test_samples_of_one_sensor_at_several_times_in_a_bundle_are_all_read() -> None:
    data = b""
    for time in (5 << 32, 6 << 32):
        inner = message("/quaternion", "ffff", turned(7))
        bundle = b"#bundle\0" + struct.pack(">Qi", time, len(inner)) + inner
        data += struct.pack(">i", len(bundle)) + bundle
    decoder = OscDecoder(OscConfig())
    readings, _ = read_all(decoder, [b"#bundle\0" + struct.pack(">Q", 1) + data])
    assert len(readings) == 2
    assert decoder.sensors.warning == ""


@pytest.mark.parametrize(
    "address",
    [
        *("/Quaternion", "/QUAT", "/quat1", "/quat_2", "/imu/1/quat", "/imu/quat/0", "/Chordata/q/l-hand"),
        *("/wrist/imuQuat", "/myo/orientation", "/quaternion/left", "/m5/attitude", "/phone/rotation_vector"),
    ],
)
def test_addresses_of_orientations_are_known_in_many_spellings(address: str) -> None:
    decoder = OscDecoder(OscConfig(order="wxyz"))
    readings, problems = read_all(decoder, [message(address, "ffff", turned(n)) for n in range(9)])
    assert len(readings) == 9
    assert_are_turned(readings)
    assert problems == set()


@pytest.mark.parametrize(
    ("address", "types"), [("/orientation", "fff"), ("/euler", "ffff"), ("/acc", "ffff")]
)
def test_other_vectors_are_no_orientation(address: str, types: str) -> None:
    decoder = OscDecoder(OscConfig())
    assert read_all(decoder, [message(address, types, turned(3)[: len(types)])]) == ([], set())
    assert address in decoder.unused


def test_order_in_an_address_is_used() -> None:
    decoder = OscDecoder(OscConfig())
    w, x, y, z = turned(20)
    ((_, reading),), _ = read_all(decoder, [message("/imu/quat_xyzw", "ffff", (x, y, z, w))])
    assert reading.world_from_sensor == pytest.approx((x, y, z, w))
    assert decoder.uncertainty == ""


@pytest.mark.parametrize("prefix", ["/quaternion/", "/imu/quat/", "/SceneRotator/q", "/wrist/quat_"])
@pytest.mark.parametrize("is_bundle", [True, False])
def test_components_with_their_own_addresses_are_one_orientation(prefix: str, *, is_bundle: bool) -> None:
    decoder = OscDecoder(OscConfig())
    parts = [
        [message(f"{prefix}{name}", "f", [each]) for name, each in zip("wxyz", turned(n), strict=True)]
        for n in range(N)
    ]
    if is_bundle:
        readings, problems = read_all(decoder, [bundled(*each) for each in parts])
        assert_are_turned(readings)
    else:
        del parts[5][1]  # a datagram is lost
        readings, problems = read_all(decoder, [each for four in parts for each in four])
        assert all(
            reading.world_from_sensor[3] == pytest.approx(turned((step + (step > 20)) // 4)[0])
            for step, reading in readings
        )
    assert problems == set()
    assert len(readings) == N - (not is_bundle)


@pytest.mark.parametrize("address", ["/rotationvector", "/gamerotationvector"])
def test_accuracy_of_android_is_known_also_while_the_phone_is_level(address: str) -> None:
    decoder = OscDecoder(OscConfig())
    readings, problems = read_all(decoder, [message(address, "fffff", (0.0, 0.0, 0.6, 0.8, 0.0))] * 40)
    assert [reading.world_from_sensor for _, reading in readings] == [
        pytest.approx((0.0, 0.0, 0.6, 0.8))
    ] * 40
    assert problems == set()


def test_numbers_that_are_whole_now_and_then_are_of_the_same_messages() -> None:
    decoder = OscDecoder(OscConfig(order="wxyz"))
    data: list[bytes] = []
    for n in range(N):  # as of Max, which sends 0 and 1 as whole numbers
        numbers = (4, 0.6, 0.0, 0.8, 0.0) if n % 2 else (4, *turned(n))
        whole = [float(each).is_integer() for each in numbers]
        types = "".join("i" if each else "f" for each in whole)
        data.append(
            message("/quat", types, [int(v) if w else v for v, w in zip(numbers, whole, strict=True)])
        )
    readings, problems = read_all(decoder, data)
    assert len(readings) >= N - MAX_RISES
    assert problems == set()
