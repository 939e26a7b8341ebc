"""Report on a device: rate, gaps, silence, frozen, too many connections, low battery."""

from collections.abc import Iterable

import pytest

from pointit.services.imu_bridge.wrist.monitor import FROZEN_S, STORM, Values, WristMonitor

STEP = 1e-4


def monitor() -> WristMonitor:
    monitor = WristMonitor("anna's wrist (fake)", silence_s=3.0)
    monitor.on_connected(0.0)
    return monitor


def send(wrist: WristMonitor, times_s: Iterable[float], values: Values | None = None) -> None:
    """Send readings, with a report after each second; other values each time unless they are given."""
    for number, time_s in enumerate(times_s):
        wrist.on_reading(values or (number * STEP, 0.0, 0.0, 1.0), time_s)
        if number % 50 == 49:
            list(wrist.report(time_s))


def at_50_hz(first_s: float, last_s: float) -> list[float]:
    return [first_s + number / 50 for number in range(round(50 * (last_s - first_s)))]


def figures(wrist: WristMonitor, now_s: float) -> dict[str, float | None]:
    return {name: value for name, value, _unit in wrist.report(now_s)}


def said(wrist: WristMonitor, now_s: float, *, is_explained: bool = False) -> list[str]:
    return [text for _topic, text in wrist.warnings(now_s, is_explained=is_explained) if text]


def test_rate_and_gaps_are_counted() -> None:
    wrist = monitor()
    send(wrist, at_50_hz(0.0, 10.0))
    send(wrist, at_50_hz(10.25, 20.25))
    found = figures(wrist, 20.25)
    assert found["rate"] == pytest.approx(50.0, rel=0.03)
    assert found["gaps"] == 1
    assert found["latest gap"] == pytest.approx(270)
    assert not said(wrist, 20.25)
    send(wrist, at_50_hz(20.25, 90.0))
    assert figures(wrist, 90.0)["gaps"] == 0


def test_pauses_of_a_slow_device_are_no_gaps() -> None:
    wrist = monitor()
    for second in range(20):
        for number in range(5):
            wrist.on_reading((second + number * STEP, 0.0, 0.0, 1.0), second + number / 5)
        list(wrist.report(second + 0.9))
    assert figures(wrist, 20.0)["gaps"] == 0


def test_connected_device_that_sends_nothing_is_silent_and_a_lost_one_is_not() -> None:
    wrist = monitor()
    send(wrist, at_50_hz(0.0, 5.0))
    list(wrist.report(7.0))
    assert not said(wrist, 7.5)
    list(wrist.report(8.5))
    (text,) = said(wrist, 8.5)
    assert text.startswith("anna's wrist (fake) is connected, but has sent nothing for 4 s: ")
    assert not said(wrist, 8.5, is_explained=True)
    wrist.on_disconnected("it is out of reach")
    assert said(wrist, 9.0) == ["it is out of reach"]
    wrist.on_connected(10.0)
    assert not said(wrist, 10.5)


def test_silence_is_not_judged_after_this_machine_has_stalled() -> None:
    wrist = monitor()
    send(wrist, at_50_hz(0.0, 5.0))
    list(wrist.report(5.0))
    list(wrist.report(15.0))
    assert not said(wrist, 15.0)
    list(wrist.report(16.0))
    assert len(said(wrist, 16.0)) == 1


def test_same_orientation_for_long_is_a_table_or_a_frozen_device() -> None:
    wrist = monitor()
    send(wrist, at_50_hz(0.0, 5.0))
    send(wrist, at_50_hz(5.0, 5.0 + FROZEN_S - 0.5), (0.0, 0.0, 0.0, 1.0))
    assert not said(wrist, 9.5)
    send(wrist, at_50_hz(9.5, 12.0), (0.0, 0.0, 0.0, 1.0))
    assert [text.partition(":")[0] for text in said(wrist, 12.0)] == [
        "anna's wrist (fake) has sent the same orientation for 7 s"
    ]
    send(wrist, at_50_hz(12.0, 13.0))
    assert not said(wrist, 13.0)


def test_device_with_two_decimals_is_not_taken_for_frozen() -> None:
    wrist = monitor()
    for number, time_s in enumerate(at_50_hz(0.0, 20.0)):
        wrist.on_reading((0.01 * (number // 400), 0.0, 0.0, 1.0), time_s)
        if number % 50 == 0:
            list(wrist.report(time_s))
            assert not said(wrist, time_s)


def test_raw_values_that_never_change_are_of_a_frozen_device() -> None:
    wrist = monitor()
    send(wrist, at_50_hz(0.0, 7.0), (0.0, 0.0, 0.0, 0.0, 0.0, 9.81))
    assert len(said(wrist, 7.0)) == 1


def test_connections_again_and_again_are_named() -> None:
    wrist = monitor()
    for number in range(STORM):
        wrist.on_connected(100.0 + number / 10)
    assert [text.partition(":")[0] for text in said(wrist, 101.0)] == [
        "anna's wrist (fake) was connected 5 times within 10 s"
    ]
    assert not said(wrist, 120.0, is_explained=True)


def test_low_battery_is_a_warning() -> None:
    wrist = monitor()
    wrist.battery = 0.5
    assert figures(wrist, 1.0)["battery"] == 50
    assert not said(wrist, 1.0)
    wrist.battery = 0.07
    assert said(wrist, 1.0) == ["the battery of anna's wrist (fake) is at 7%: charge it"]
