"""Configured faults of the simulated tracker."""

import numpy as np
import pytest

from pointit.schemas import TrackedObjects
from pointit.services.conveyor_sim.config import TrackingConfig
from pointit.services.conveyor_sim.plant import Plant
from pointit.services.conveyor_sim.tracking import Tracker
from tests.unit.conveyor_sim.rooms import S, lanes, plant

PERIOD_NS = S // 25


def pairs(
    seconds: float, **faults: float
) -> tuple[Plant, list[tuple[TrackedObjects, TrackedObjects | None]]]:
    belts = plant(lanes(20.0), feeder={"interval_s": 1.0})
    tracker = Tracker(TrackingConfig(**faults), belts.network.lines, seed=1)
    belts.step(30 * S)
    seen: list[tuple[TrackedObjects, TrackedObjects | None]] = []
    for step in range(round(seconds * 25)):
        now_ns = 30 * S + step * PERIOD_NS
        belts.step(now_ns)
        exact = belts.tracked(now_ns)
        seen.append((exact, tracker.report(exact)))
    return belts, seen


def test_tracker_without_faults_reports_exact_objects() -> None:
    _, seen = pairs(2.0)
    assert all(exact is report for exact, report in seen)


def test_noise_is_along_the_belt_and_as_large_as_asked_for() -> None:
    _, seen = pairs(20.0, noise_m=0.05)
    errors_m: list[float] = []
    for exact, report in seen:
        assert report is not None
        for a, b in zip(exact.objects, report.objects, strict=True):
            errors_m.append(b.surface_position_m - a.surface_position_m)
            assert b.position_m[0] - a.position_m[0] == pytest.approx(errors_m[-1])
            assert b.position_m[1:] == a.position_m[1:]
    assert np.std(errors_m) == pytest.approx(0.05, rel=0.05)
    assert np.mean(errors_m) == pytest.approx(0.0, abs=0.005)


def test_packages_are_missed_one_by_one() -> None:
    _, seen = pairs(20.0, missed_share=0.2)
    exact = sum(len(a.objects) for a, _ in seen)
    reported = sum(len(b.objects) for _, b in seen if b is not None)
    assert reported / exact == pytest.approx(0.8, abs=0.02)
    assert len({len(b.objects) for _, b in seen if b is not None}) > 3


def test_reports_are_lost_in_bursts() -> None:
    tracker = Tracker(TrackingConfig(dropout_share=0.1, dropout_s=0.4), {}, seed=1)
    reports = [tracker.report(TrackedObjects(stamp_ns=step * PERIOD_NS)) for step in range(50_000)]
    lost = np.array([report is None for report in reports])
    assert lost.mean() == pytest.approx(0.1, abs=0.02)
    bursts = np.count_nonzero(lost[1:] & ~lost[:-1])
    assert lost.sum() / 25 / bursts == pytest.approx(0.4, rel=0.2)


def test_late_reports_say_when_it_was_so() -> None:
    _, seen = pairs(4.0, latency_s=0.2)
    truth = {exact.stamp_ns: exact for exact, _ in seen}
    late = [(exact.stamp_ns, report) for exact, report in seen if report is not None]
    assert len(late) == len(seen) - 5
    for now_ns, report in late:
        assert now_ns - report.stamp_ns == 5 * PERIOD_NS
        assert report == truth[report.stamp_ns]
