"""Numbers and names in front of quaternions: sensors, clocks that start at 0, counts and ids of messages."""

import math
from collections.abc import Sequence

import pytest

from pointit.services.imu_bridge.network.udp import UdpConfig, UdpDecoder
from pointit.services.imu_bridge.serial.line_parser import MAX_OPEN, MAX_RISES
from pointit.services.imu_bridge.serial.text_line import TextFramer
from pointit.services.imu_bridge.sources import Reading
from pointit.services.imu_bridge.streams import MAX_NAMES, Order, SensorChoice

ARM, OTHER = (0.6, 0.0, 0.0, 0.8), (0.0, 0.0, 0.8, 0.6)
"""Orientations xyzw of the wrist and of another sensor."""


def text(xyzw: Sequence[float]) -> str:
    x, y, z, w = xyzw
    return ",".join(f"{value:.4f}" for value in (w, x, y, z))


def read_lines(lines: Sequence[str], kind: str) -> tuple[list[Reading], str]:
    """Return the readings and the warning about other sensors."""
    if kind == "cable":
        framer = TextFramer(sensors=(sensors := SensorChoice("serial.sensor", is_noisy=True)))
        items = framer.feed("\n".join(["", *lines, ""]).encode(), 0)
        assert framer.bad == 0, framer.reason
    else:
        decoder = UdpDecoder(UdpConfig())
        items = [item for line in lines for item in decoder.items(line.encode(), 0)]
        sensors = decoder.sensors
    return [item for item in items if isinstance(item, Reading)], sensors.warning


LEVEL = (0.0, 0.05, 0.0, 0.9987)
N = 300


@pytest.mark.parametrize("kind", ["cable", "network"])
@pytest.mark.parametrize("xyzw", [ARM, LEVEL, (0.0, 0.0, 0.0, 1.0)])
@pytest.mark.parametrize(
    "times",
    [
        [f"{10_000 * n}" for n in range(N)],  # µs
        [f"{10 * n}" for n in range(N)],  # ms
        [f"{200 + 10 * n}" for n in range(N)],
        [f"{n}" for n in range(N)],
        [f"{n / 100:.2f}" for n in range(N)],  # s
        [f"{n / 50}" for n in range(N)],
        [f"{10 * (n if n < 30 else n - 30)}" for n in range(N)],  # the board is started again
    ],
)
def test_clocks_that_start_at_0_are_no_sensors(times: list[str], xyzw: Sequence[float], kind: str) -> None:
    readings, warning = read_lines([f"{time},{text(xyzw)}" for time in times], kind)
    assert warning == ""
    assert len(readings) >= N - MAX_RISES - 1
    assert all(each.device_time_ns is not None for each in readings)
    named, warning = read_lines([f"3,{time},{text(ARM)}" for time in times], kind)
    assert warning == ""
    assert len(named) >= N - MAX_RISES - 2
    assert all(each.device_time_ns is not None for each in named)


@pytest.mark.parametrize("kind", ["cable", "network"])
@pytest.mark.parametrize(
    ("mine", "others"),
    [
        ("0,{}", "1,{}"),
        ("1,{}", "5,{}"),
        ("0,{t},{}", "1,{t},{}"),
        ("{t},0,{}", "{t},1,{}"),
        ("wrist {t}: {}", "elbow {t}: {}"),
    ],
)
def test_two_sensors_beside_a_clock_that_starts_at_0_are_told_apart(
    mine: str, others: str, kind: str
) -> None:
    lines = [(mine, others)[n % 2].format(text((ARM, OTHER)[n % 2]), t=5 * n) for n in range(N)]
    readings, warning = read_lines(lines, kind)
    assert all(each.world_from_sensor == pytest.approx(ARM) for each in readings[len(readings) // 3 :])
    assert len(readings) > N // 2 - 40
    assert "several sensors send in one stream" in warning


@pytest.mark.parametrize("kind", ["cable", "network"])
def test_accuracy_that_changes_now_and_then_is_no_sensor(kind: str) -> None:
    lines = [f"{text(ARM)},{2 + (n * 7 % 10 > 6)}" for n in range(N)]
    readings, warning = read_lines(lines, kind)
    assert (len(readings), warning) == (N, "")


@pytest.mark.parametrize(
    ("line", "order"),
    [("{x:.4f},0.0000,0.0000,{w:.4f},0.05", "xyzw"), ("0,{w:.4f},0.0000,0.0000,{x:.4f}", "wxyz")],
)
def test_number_beside_the_quaternion_of_a_level_wrist_is_told_by_signs(line: str, order: Order) -> None:
    framer = TextFramer(order)  # the first and the last four have norm 1
    angles = [0.02 * math.sin(n / 3) for n in range(N)]
    lines = [line.format(x=math.sin(each), w=math.cos(each)) for each in angles]
    items = framer.feed("\n".join(["", *lines, ""]).encode(), 0)
    assert framer.bad == 0, framer.reason
    assert len(items) > N - MAX_OPEN - MAX_RISES
    assert all(each.world_from_sensor[3] > 0.99 for each in items if isinstance(each, Reading))


@pytest.mark.parametrize(
    "names", [[f"{n % 30 if n < 60 else n - 60}" for n in range(N)], [f"{7919 * n:x}-a" for n in range(N)]]
)
def test_counts_that_begin_again_and_ids_of_messages_name_no_sensor(names: list[str]) -> None:
    sensors = SensorChoice("udp.sensor")
    accepted = [sensors.accepts("phone", name) for name in names[:30]]
    assert sensors.warning == ""
    accepted += [sensors.accepts("phone", name) for name in names[30:]]
    assert all(accepted[2 * MAX_NAMES :])
    assert sensors.used in ("phone", "phone #-a")
    assert sensors.warning == ""


def test_sensor_is_found_by_each_of_its_names() -> None:
    for wanted in ("3", "aa:bb:cc:00:11:22", "Left", "3 aa:bb:cc:00:11:22 left hand"):
        assert SensorChoice("udp.sensor", wanted).accepts("3", "AA:BB:CC:00:11:22", "left hand")
    assert not SensorChoice("udp.sensor", "aa:bb:cc:00:11:23").accepts("3", "AA:BB:CC:00:11:22")


def test_whole_numbers_with_a_point_are_ids_in_json() -> None:
    decoder = UdpDecoder(UdpConfig(sensor="2"))
    for number, xyzw in ((1, OTHER), (2, ARM)) * 3:
        x, y, z, w = xyzw
        read = decoder.items(f'{{"id": {number}.0, "q": [{w}, {x}, {y}, {z}]}}'.encode(), 0)
        assert len(read) == (number == 2)


def test_time_that_several_sensors_share_is_no_sensor() -> None:
    names = ("wrist", "elbow", "hand", "chest", "head")
    lines = [f"{name},{5000 + 10 * n},{text(ARM)}" for n in range(50) for name in names]
    readings, _ = read_lines(lines, "network")
    assert len(readings) == 50
    assert all(each.device_time_ns is not None for each in readings)


LETTERS = "abcdefghijklmnopqrstuvwxyz"


@pytest.mark.parametrize(
    ("mine", "others", "used"),
    [
        (("wrist{n}",), ("elbow{n}",), "wrist#"),  # a count behind the name
        (("s1_{n}",), ("s2_{n}",), "s1_#"),
        (("wrist",), ("elbow-{n}",), "wrist"),
        (("{n}",), ("elbow",), ""),
        (("{n}",), ("elbow", "{n}"), ""),
        (("imu1", "12:00:{time_s:.3f}"), ("imu2", "12:00:{time_s:.3f}"), "imu1"),
        (("{id:08x}",), ("elbow",), ""),
    ],
)
def test_second_sensor_is_reported_and_not_read_although_no_name_is_shared(
    mine: Sequence[str], others: Sequence[str], used: str
) -> None:
    sensors = SensorChoice("udp.sensor")
    accepted = [
        sensors.accepts(
            *(each.format(n=n, time_s=n / 100, id=7919 * (n + 9)) for each in (mine, others)[n % 2])
        )
        for n in range(2 * N)
    ]
    assert accepted[N:] == [True, False] * (N // 2)
    assert sensors.used == used
    assert "several sensors send in one stream" in sensors.warning


@pytest.mark.parametrize("first", [0, 1])
def test_ten_sensors_beside_counts_are_told_apart(first: int) -> None:
    sensors = SensorChoice("udp.sensor")
    accepted = [sensors.accepts(f"node{n % 10}", f"{first + n // 10}") for n in range(2 * N)]
    assert sum(accepted[N:]) == N // 10


def test_second_sensor_whose_name_always_changes_is_reported_with_its_first_reading() -> None:
    sensors = SensorChoice("udp.sensor")
    for _ in range(9):
        sensors.accepts("wrist")
    assert not sensors.accepts("elbow-1")
    assert sensors.warning.startswith("several sensors send in one stream: wrist is used, not elbow-1;")


def test_names_that_all_differ_are_reported_unless_they_are_a_count() -> None:
    sensors, count = SensorChoice("udp.sensor"), SensorChoice("udp.sensor")
    for n in range(N):
        sensors.accepts("".join(LETTERS[7 * n // 26**k % 26] for k in range(5)))
        count.accepts(f"{n}")
    assert sensors.warning.startswith("each reading names another sensor, the last ")
    assert sensors.warning.endswith("let it send a name that stays the same, and set udp.sensor to it")
    assert count.warning == ""


def test_configured_sensor_is_found_before_a_count_and_behind_it() -> None:
    sensors = SensorChoice("udp.sensor", "wrist")
    accepted = [sensors.accepts(("wrist", "elbow")[n % 2] + f"{n}") for n in range(2 * N)]
    assert accepted[N:] == [True, False] * (N // 2)
    assert sensors.warning == ""
