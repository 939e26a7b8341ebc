"""Rates of keys and trackers, by hand and by property."""

import json
import math
import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.cli.inspect.hz import RateMeter
from pointit.cli.inspect.track import TrackerMeters, Tracking, show
from pointit.schemas import NS_PER_S, TrackedObject, TrackedObjects


def test_a_regular_stream() -> None:
    meter = RateMeter("objects", 25)
    for k in range(51):
        meter.add(100 + k * 0.04, 30)
    rate = meter.take(102.02, 2.02)
    assert (rate.key, rate.nominal_hz, rate.messages) == ("objects", 25, 51)
    assert rate.rate_hz == pytest.approx(25)
    assert (rate.period_min_s, rate.period_max_s) == pytest.approx((0.04, 0.04))
    assert rate.jitter_s == pytest.approx(0, abs=1e-6)
    assert rate.bytes_per_s == pytest.approx(51 * 30 / 2.02)


def test_one_message_has_no_rate() -> None:
    meter = RateMeter("map")
    meter.add(1.0, 10)
    rate = meter.take(6.0, 5.0)
    assert (rate.messages, rate.rate_hz, rate.period_max_s, rate.jitter_s) == (1, None, None, None)
    assert meter.take(11.0, 5.0).messages == 0


def test_a_stream_that_stops_shows_its_silence() -> None:
    meter = RateMeter("objects")
    for k in range(10):
        meter.add(k * 0.1, 1)
    assert meter.take(5.0, 5.0).period_max_s == pytest.approx(4.1)


def test_the_period_across_two_windows_counts_in_the_second() -> None:
    meter = RateMeter("objects")
    for time_s in (0.0, 1.0):
        meter.add(time_s, 1)
    meter.take(1.5, 1.5)
    meter.add(3.0, 1)
    rate = meter.take(3.0, 1.5)
    assert rate.messages == 1
    assert rate.period_max_s == pytest.approx(2.0)


@given(st.lists(st.floats(1e-3, 10), min_size=1, max_size=50))
def test_the_account_is_that_of_all_periods(periods_s: list[float]) -> None:
    meter = RateMeter("objects")
    now_s = 1e3
    meter.add(now_s, 0)
    for period_s in periods_s:
        now_s += period_s
        meter.add(now_s, 0)
    rate = meter.take(now_s, 1.0)
    assert rate.rate_hz is not None
    assert rate.jitter_s is not None
    assert math.isclose(rate.rate_hz, len(periods_s) / sum(periods_s), rel_tol=1e-6)
    assert math.isclose(rate.jitter_s, statistics.pstdev(periods_s), rel_tol=1e-6, abs_tol=1e-6)


BEGIN_NS = 1000 * NS_PER_S


def thing(name: str, **fields: object) -> TrackedObject:
    return TrackedObject.model_validate({"id": name, "kind": "red", "position_m": (1.0, 2.0, 0.5), **fields})


def measured(*only: str) -> Tracking:
    meters = TrackerMeters(only)
    cups = (thing("mug", velocity_mps=(3.0, 4.0, 0.0), yaw_rad=0.0), thing("cup", position_sigma_m=0.02))
    for step in range(30):
        late_ns = NS_PER_S // 10 if step % 10 else NS_PER_S // 2
        now_ns = BEGIN_NS + step * NS_PER_S // 10
        camera = TrackedObjects(stamp_ns=now_ns - late_ns, objects=cups, latency_sigma_s=0.03)
        meters.add("camera", camera, arrived_s=0.1 * step, arrived_ns=now_ns)
        other = TrackedObjects(stamp_ns=now_ns, objects=(thing("cup"),))
        meters.add("robot", other, arrived_s=0.1 * step, arrived_ns=now_ns)
    return meters.take(3.0, 3.0)


def test_rates_ages_and_objects_are_measured() -> None:
    tracking = measured()
    camera, robot = tracking.trackers
    assert (camera.tracker, camera.objects, camera.latency_sigma_s) == ("camera", 2, 0.03)
    assert (camera.rate_hz, camera.age_s) == pytest.approx((10.0, 0.1))
    assert camera.age_p95_s == pytest.approx(0.5)
    assert robot.age_s == pytest.approx(0.0)
    cup, mug, _ = tracking.objects
    assert (cup.object, cup.tracker, cup.sigma_m, cup.yaw_deg) == ("cup", "camera", 0.02, None)
    assert (mug.x_m, mug.y_m, mug.z_m, mug.speed_mps, mug.yaw_deg) == (1.0, 2.0, 0.5, 5.0, 0.0)


def test_one_object_of_two_trackers_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert show(measured("robot"), 3.0, as_json=False)
    out = capsys.readouterr().out
    assert "warning: the trackers camera and robot both report cup" in out
    assert "mug" not in out.replace("cup of the tracker camera and mug", "")


def test_a_window_is_one_line_of_json(capsys: pytest.CaptureFixture[str]) -> None:
    show(measured(), 3.0, as_json=True)
    (line,) = capsys.readouterr().out.splitlines()
    said = json.loads(line)
    assert said["window_s"] == 3.0
    assert [row["tracker"] for row in said["trackers"]] == ["camera", "robot"]
    assert [row["object"] for row in said["objects"]] == ["cup", "mug", "cup"]
    assert said["twins"][0].startswith("the trackers camera and robot both report cup")


def test_without_a_tracker_the_remedy_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    show(TrackerMeters().take(3.0, 3.0), 3.0, as_json=False)
    assert capsys.readouterr().err == (
        "no tracker was heard within 3 s; start one, or see `pointit doctor`\n"
    )
