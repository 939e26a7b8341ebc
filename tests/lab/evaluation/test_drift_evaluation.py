"""Evaluation of drift: recordings in the right format give rows, simulated people meet the claim."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pointit.geometry import vector
from pointit.services.localizer.drift.state import DriftSettings
from pointit_lab.evaluation.datasets.proximity_feedback import PHASES, FloorTrial, Stretch, read_floor_trials
from pointit_lab.evaluation.pointing import drift_simulated
from pointit_lab.evaluation.pointing.drift import LEFT_OUT, candidates, left_out, recorded_rows
from pointit_lab.evaluation.pointing.drift_courses import courses
from pointit_lab.evaluation.pointing.drift_innovation import innovation_rows
from pointit_lab.evaluation.pointing.drift_ratio import ratios
from pointit_lab.evaluation.pointing.drift_solvers import (
    SOLVERS,
    DriftTrial,
    YawEstimate,
    filtered,
    predictable,
)
from pointit_lab.evaluation.pointing.landings import landing_rows
from pointit_lab.evaluation.recordings.row import ALL, Row
from tests.support import there
from tests.support.data import data_file
from tests.support.published_recordings import Stand, write_acts

HEADER = "trial,target_id,target_x,target_y,phase,t,x,y,trial_len_samples\n"
PLACES = ((2.0, -1.0), (2.0, 0.0), (2.0, 1.0))


@pytest.fixture(scope="module")
def hundred() -> list[Row]:
    return drift_simulated.simulated_rows(100)


@pytest.fixture(scope="module")
def recordings() -> Path:
    return data_file("recordings/proximity_feedback")


@pytest.fixture(scope="module")
def recorded(recordings: Path) -> list[Row]:
    return recorded_rows(read_floor_trials(recordings), quiet)


def quiet(_: str) -> None:
    return


def record(folder: Path, rate_degps: float, *, runs: int = 3, subject: str = "01", seed: int = 0) -> None:
    """Write a person whose IMU drifts by `rate_degps`, its yaw set to 0 before each run."""
    rng = np.random.default_rng(seed)
    lines: list[str] = []
    for trial in range(3 * runs):
        place = PLACES[trial % 3]
        scatter = rng.normal(0.0, 1.0)
        for number, phase in enumerate(PHASES):
            for i in range(250):
                t = i / 50.0
                since_s = (trial % 3) * 45.0 + number * 5.0 + t
                azimuth = math.degrees(math.atan2(place[1], place[0])) + rate_degps * since_s + scatter
                away = math.hypot(*place)
                x, y = (away * f(math.radians(azimuth)) for f in (math.cos, math.sin))
                lines.append(
                    f"{trial},{trial % 3 + 1},{place[0]},{place[1]},{phase},{t:.2f},{x:.5f},{y:.5f},2250\n"
                )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"user_{subject}.csv").write_text(HEADER + "".join(lines))


def find(rows: list[Row], condition: str, solver: str, subject: str = ALL) -> Row:
    return next(r for r in rows if (r.condition, r.solver, r.subject) == (condition, solver, subject))


def median(row: Row) -> float:
    return there(row.yaw_deg).median


def p90(row: Row) -> float:
    return there(row.yaw_deg).p90


def within(row: Row) -> float:
    assert row.yaw_within_2_sigma is not None
    return row.yaw_within_2_sigma


def reached(number: int, drift_deg: float) -> FloorTrial:
    """Return a trial whose arm turns 40° to its target, lands, and holds; the IMU is off by `drift_deg`."""
    begin_s, (x, y) = 45.0 * number, PLACES[number]
    times_s = np.arange(250) / 50.0
    share = np.minimum(times_s / 0.8, 1.0)
    done = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    end_rad, away_m = math.atan2(y, x) + math.radians(drift_deg), math.hypot(x, y)
    phases = {
        "open_loop_reach": end_rad + math.radians(40.0) * (done - 1.0),
        "open_loop_hold": np.full(250, end_rad),
    }
    return FloorTrial(
        subject="01",
        number=number,
        target_id=str(number),
        target_m=(x, y),
        start_s=begin_s,
        phases={
            phase: Stretch(
                times_s=begin_s + 5.0 * index + times_s,
                points_m=away_m * np.column_stack([np.cos(phases[phase]), np.sin(phases[phase])]),
            )
            for index, phase in enumerate(PHASES[:2])
        },
    )


def test_landing_of_a_reach_is_an_anchor_in_place_of_a_hold() -> None:
    (course,) = courses([reached(number, 15.0 * number) for number in range(3)])
    landing = there(course.holds[1].landing_mean)
    assert math.degrees(vector.azimuth(landing.direction)) == pytest.approx(15.0, abs=1.0)
    assert 45.6e9 < landing.stamp_ns < 46.0e9
    errors_deg = {
        name: abs(math.degrees(SOLVERS[name](course, (0,), 2).yaw_rad - course.holds[2].yaw_rad))
        for name in ("pointit, first anchor, rests", "pointit, first anchor, rests, landings")
    }
    ignored_deg, learned_deg = errors_deg.values()
    assert learned_deg < 0.7 * ignored_deg
    turned = course.holds[1].turned(math.radians(30.0), 100.0)
    assert there(turned.landing_mean).stamp_ns == landing.stamp_ns + 100_000_000_000
    assert math.degrees(vector.azimuth(there(turned.landing_mean).direction)) == pytest.approx(-15.0, abs=1.0)


def test_people_without_drift_who_point_exactly_are_not_changed_by_landings(tmp_path: Path) -> None:
    assert landing_rows(tmp_path) == []
    write_acts(tmp_path, {"1": (1.6, Stand()), "13": (1.9, Stand(x=0.3))})
    rows = landing_rows(tmp_path)
    assert [(row.subject, row.solver) for row in rows] == [
        (subject, solver) for subject in ("1", "13", ALL) for solver in ("raw", "landings")
    ]
    assert [row.n for row in rows] == [11, 11, 11, 11, 22, 22]
    assert all(p90(row) < 1.0 for row in rows)
    assert all(there(row.pitch_deg).p90 < 1.0 for row in rows)


def test_landings_teach_the_elevation_that_a_person_misses_by(tmp_path: Path) -> None:
    write_acts(tmp_path, {"1": (1.6, Stand(bias_deg=4.0))}, times=3)
    raw, learned = landing_rows(tmp_path)[:2]
    assert there(raw.pitch_deg).median == pytest.approx(4.0, abs=1.0)
    assert there(learned.pitch_deg).median < 0.5 * there(raw.pitch_deg).median


def test_landings_teach_the_elevation_of_recorded_people(recordings: Path) -> None:
    rows = [row for row in landing_rows(recordings.parent) if row.pitch_deg is not None]
    assert {row.set for row in rows} == {"proximity_feedback", "vr_arm_pointing"}
    for raw, learned in zip(rows[::2], rows[1::2], strict=True):
        assert there(learned.pitch_deg).rms < there(raw.pitch_deg).rms


def test_trials_are_read_with_the_times_at_which_they_were(tmp_path: Path) -> None:
    record(tmp_path, 0.3)
    trials = read_floor_trials(tmp_path)
    assert [trial.number for trial in trials] == list(range(9))
    assert (trials[2].start_s, trials[2].target_m) == (90.0, (2.0, 1.0))
    hold = trials[2].phases["open_loop_hold"]
    assert hold.times_s[0] == pytest.approx(95.0)
    assert hold.points_m.shape == (250, 2)
    first, *_ = courses(trials)
    assert len(first.holds) == 3
    # the IMU turns to the left, so that {H} turns to the right
    assert math.degrees(first.holds[2].rate_radps) == pytest.approx(-0.3, abs=0.01)
    rest = first.holds[2].rest
    assert rest is not None
    assert math.degrees(rest.yaw_rate_radps) == pytest.approx(-0.3, abs=0.02)


@pytest.mark.long
def test_the_filter_follows_a_recorded_drift(tmp_path: Path) -> None:
    for number in range(6):
        rate = (-0.45, -0.3, -0.1, 0.15, 0.3, 0.4)[number]
        record(tmp_path / "proximity_feedback", rate, subject=f"{number:02}", seed=number)
    ticks: list[str] = []
    rows = recorded_rows(read_floor_trials(tmp_path / "proximity_feedback"), ticks.append)
    assert ticks
    at_3_min = {name: median(find(rows, "3 min, 1 anchor/min", name)) for name in ("raw", "pointit")}
    assert at_3_min["raw"] > 30.0
    assert at_3_min["pointit"] < 3.5
    assert within(find(rows, "3 min, 1 anchor/min", "pointit")) >= 0.9
    two = {r.solver: median(r) for r in rows if (r.condition, r.subject) == ("90 s, 2 anchors", ALL)}
    assert two["pointit"] < two["re-anchored"] < two["raw"]
    assert find(rows, "90 s, 2 anchors", "pointit", "03").n == 3


@pytest.mark.long
def test_simulated_people_are_within_3_degrees_after_three_minutes(hundred: list[Row]) -> None:
    rows = hundred
    condition = "3 min, 1 anchor/min, after it"
    assert median(find(rows, condition, "raw")) > 17.6
    assert median(find(rows, condition, "pointit")) <= 3.0
    # a minute after the last anchor it takes rests, or luck: the pose itself is 0.15 m uncertain
    assert median(find(rows, "3 min, 1 anchor/min", "pointit, rests")) <= 3.0
    assert median(find(rows, "3 min, 1 anchor/min", "pointit")) <= 4.5
    assert p90(find(rows, "3 min, 1 anchor/min", "pointit")) <= 12.0
    assert within(find(rows, "3 min, 1 anchor/min, 5° scatter", "pointit")) >= 0.85
    for one in ("pointit", "pointit, rests"):
        assert within(find(rows, "3 min, 1 anchor/min", one)) >= 0.9


@pytest.mark.parametrize("leap", ["in motion", "at rest", "after the last anchor"])
def test_a_leap_of_the_yaw_makes_nobody_worse_off_than_anchoring_again(hundred: list[Row], leap: str) -> None:
    for usual in (drift_simulated.USUAL, f"{drift_simulated.USUAL}, quiet IMU"):
        condition = f"{usual}, leap {leap}"
        told, again = (find(hundred, condition, solver) for solver in ("pointit, rests", "re-anchored"))
        assert median(told) <= 1.1 * median(again)
        assert p90(told) <= 1.1 * p90(again)
        if leap != "after the last anchor":
            assert within(told) >= 0.9
            assert median(told) < 4.0


def test_a_pointing_beside_is_followed_in_doubt_until_the_next_anchor(hundred: list[Row]) -> None:
    """It looks like a leap, which is followed at once; the stated uncertainty has both."""
    wrong = find(hundred, drift_simulated.WRONG_ANCHOR, "pointit, rests")
    assert median(wrong) <= 1.1 * median(find(hundred, drift_simulated.WRONG_ANCHOR, "re-anchored"))
    assert within(wrong) >= 0.75
    after = f"{drift_simulated.WRONG_ANCHOR}, after it"
    for solver in ("pointit", "pointit, rests"):
        assert median(find(hundred, after, solver)) <= 3.5
        assert within(find(hundred, after, solver)) >= 0.9


def test_with_a_known_place_the_filter_is_as_good_as_can_be() -> None:
    ways = drift_simulated.DriftPersonModel(place_sigma_m=0.01, bent_arm_share=0.0)
    errors = [
        drift_simulated.outcome(seed, ways, drift_simulated.ANCHORS_S)["pointit"][0] for seed in range(150)
    ]
    assert float(np.sqrt(np.mean(np.square(errors)))) < 1.35 * drift_simulated.bound_rad(
        ways, drift_simulated.ANCHORS_S
    )


def test_ratios_have_intervals_over_people() -> None:
    people = [name for name in "abcd" for _ in range(3)]
    plain = [10.0, 12.0, 14.0] * 4
    found = ratios(people, [0.5 * error for error in plain], plain)
    assert found is not None
    for ratio in found:
        assert (ratio.value, ratio.low, ratio.high) == pytest.approx((0.5, 0.5, 0.5))
    worse = ratios(people, [*plain[:9], 20.0, 24.0, 28.0], plain)
    assert worse is not None
    assert worse[1].low == pytest.approx(1.0)
    assert worse[1].value > 1.0
    assert worse[1].high == pytest.approx(2.0)
    assert ratios(["a", "b"], [1.0, 1.0], [1.0, 1.0]) is None


@pytest.mark.long
def test_recorded_people_are_within_3_degrees_after_3_minutes(recordings: Path, recorded: list[Row]) -> None:
    assert all(set(trial.phases) == set(PHASES) for trial in read_floor_trials(recordings))
    rows = recorded
    assert median(find(rows, "3 min, 1 anchor/min", "raw")) > 17.6
    told = find(rows, "3 min, 1 anchor/min", "pointit")
    assert median(told) <= 2.5
    assert p90(told) <= 15.5  # two chains have a jump of 32° before the hold that is told
    assert within(told) >= 0.9
    soon = find(rows, "90 s, 2 anchors", "pointit")
    assert median(soon) < 0.5 * median(find(rows, "90 s, 2 anchors", "re-anchored"))
    assert within(soon) >= 0.9


def test_with_rests_nobody_is_worse_off_than_by_anchoring_again(recorded: list[Row]) -> None:
    rows = recorded
    condition = "3 min, 1 anchor/min"
    for solver in ("pointit, rests", LEFT_OUT):
        assert median(find(rows, condition, solver)) <= 2.5
        assert p90(find(rows, condition, solver)) <= 11.0
        assert within(find(rows, condition, solver)) >= 0.9
        for subject in {row.subject for row in rows if row.condition == condition}:
            again = find(rows, condition, "re-anchored", subject)
            assert median(find(rows, condition, solver, subject)) <= median(again)
            assert p90(find(rows, condition, solver, subject)) <= p90(again)
        over = there(find(rows, condition, solver).times_plain)
        assert over[0].high < 0.5


def test_landings_hold_the_yaw_of_recorded_people_whose_imu_drifts(recorded: list[Row]) -> None:
    for condition, share in (("90 s, 1 anchor", 0.7), ("3 min, 1 anchor/min", 0.3)):
        ignored, learned = (
            find(recorded, condition, f"pointit, first anchor, rests{name}") for name in ("", ", landings")
        )
        assert median(learned) < share * median(ignored)
        assert p90(learned) < 0.7 * p90(ignored)


def test_settings_of_a_person_are_chosen_by_the_others(tmp_path: Path) -> None:
    """Even if other settings would predict that person exactly."""
    for number, rate in enumerate((-0.3, 0.2, 0.4)):
        record(tmp_path, rate, subject=f"{number:02}", seed=number)
    trials = predictable(courses(read_floor_trials(tmp_path)), (0.0, 45.0), 90.0)
    told = left_out({"90 s": trials})["90 s"]
    assert [one for one, _ in told] == trials

    def off_rad(one: DriftTrial, guess: YawEstimate, settings: DriftSettings) -> float:
        other = filtered(one.course, one.anchors, one.told, settings)
        return math.remainder(other.yaw_rad - guess.yaw_rad, math.tau)

    own = [(one, guess) for one, guess in told if one.course.subject == "00"]
    other = max(candidates(), key=lambda each: sum(abs(off_rad(*one, each)) for one in own))
    suited = list(trials)
    for one, guess in own:
        *before, last = one.course.holds
        away_rad = off_rad(one, guess, other) + one.error_rad(guess)
        exact = replace(one.course, holds=(*before, last.turned(away_rad, 0.0)))
        suited[trials.index(one)] = replace(one, course=exact)
        fitting = filtered(exact, one.anchors, one.told, other)
        assert abs(suited[trials.index(one)].error_rad(fitting)) < 1e-9
    guesses = [guess for one, guess in left_out({"90 s": suited})["90 s"] if one.course.subject == "00"]
    assert guesses == [guess for _, guess in own]
    assert left_out({"90 s": [one for one, _ in own]})["90 s"] == []


def test_steering_a_cursor_tells_nothing_and_a_reach_without_one_tells_the_yaw(tmp_path: Path) -> None:
    for number, rate in enumerate((-0.4, 0.3, 0.5)):
        record(tmp_path, rate, subject=f"{number:02}", seed=number)
    trials = read_floor_trials(tmp_path)
    steered = [_steered(trial) for trial in trials]
    slopes = {row.condition: row.slope for row in innovation_rows(steered, courses(trials))}
    assert slopes["first stop without a cursor"] == pytest.approx(1.0, abs=0.2)
    assert slopes["hold with a cursor"] == pytest.approx(0.0, abs=0.02)
    assert slopes["rest"] == pytest.approx(1.0, abs=0.2)


def _steered(trial: FloorTrial) -> FloorTrial:
    """Return the trial with a person who keeps the cursor on the target."""
    held = trial.phases["feedback_hold"]
    on_target = replace(held, points_m=np.tile(np.array(trial.target_m), (len(held.times_s), 1)))
    return replace(trial, phases={**trial.phases, "feedback_hold": on_target})
