"""Faults are what they are said to be, rows say how far stated uncertainties hold, and regressions fail."""

import math
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from pointit.geometry.array_types import Array
from pointit.geometry.vector import Vec3
from pointit.services.localizer.estimation.estimator import Pointings, Refusal, Solution
from pointit.services.pointing.pointer import ArmRay
from pointit_lab.cli.honesty import honesty
from pointit_lab.evaluation.honesty import injections
from pointit_lab.evaluation.honesty.honesty import (
    chosen,
    drawn_again,
    judged_sources,
    sources_of,
    trials_of,
    verdict,
)
from pointit_lab.evaluation.honesty.row import EVERY, Judged, pooled_rows, rows_of
from pointit_lab.evaluation.honesty.simulated_people import followers, rooms
from pointit_lab.evaluation.honesty.sources import Size
from pointit_lab.evaluation.honesty.targets import TARGETS
from pointit_lab.evaluation.localization.arm_rays import STATURE_M, along, scaled_body
from pointit_lab.evaluation.localization.localization import judged
from pointit_lab.evaluation.localization.trial import FollowRecording, LocalizationTrial
from tests.support import there
from tests.support.invoked import printed


def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def rows(values: Array) -> list[Vec3]:
    return [(x, y, z) for x, y, z in values.tolist()]


def azimuths(trial: LocalizationTrial) -> Array:
    rays = trial.pointings.directions
    return np.asarray(np.unwrap(np.arctan2(rays[:, 1], rays[:, 0])), dtype=np.float64)


def elevations(trial: LocalizationTrial) -> Array:
    return np.asarray(np.arcsin(trial.pointings.directions[:, 2]), dtype=np.float64)


@pytest.fixture(scope="module")
def follower() -> FollowRecording:
    return followers([3])[0]


@pytest.fixture(scope="module")
def following(follower: FollowRecording) -> LocalizationTrial:
    return next(follower.trials([10.0]))


@pytest.fixture(scope="module")
def room() -> LocalizationTrial:
    return rooms([3])[0]


@pytest.mark.parametrize(
    ("to_right_m", "hand"), [(injections.BESIDE_M, "right"), (-injections.BESIDE_M, "left")]
)
def test_known_shoulder_offset_restores_the_rays(
    following: LocalizationTrial, to_right_m: float, hand: Literal["left", "right"]
) -> None:
    """The service `pointing`, told the measure, undoes what is injected."""
    after = injections.shoulder(following, rng(), to_right_m=to_right_m)
    turned = float(np.degrees(np.mean(azimuths(after) - azimuths(following))))
    assert 10.0 < abs(turned) < 25.0
    assert after.yaw_rad is not None
    assert following.yaw_rad is not None
    back = after.yaw_rad + math.radians(turned) - following.yaw_rad
    assert math.remainder(back, math.tau) == pytest.approx(0.0, abs=1e-2)
    told = scaled_body(STATURE_M).model_copy(update={"neck_to_shoulder_m": injections.BESIDE_M})
    arms = np.array([along(arm) for arm in injections.arm_directions(after).tolist()])
    _, directions = ArmRay(told, hand=hand).rays(arms)
    assert directions == pytest.approx(following.pointings.directions, abs=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_a_still_body_turns_rays_by_different_angles(seed: int) -> None:
    following = next(followers([seed])[0].trials([10.0]))
    turning = azimuths(injections.shoulder(following, rng(), to_right_m=injections.BESIDE_M)) - azimuths(
        following
    )
    still = azimuths(injections.shoulder_still(following, rng())) - azimuths(following)
    assert np.ptp(still) > 1.1 * np.ptp(turning)


@pytest.mark.parametrize("share", [0.05, 0.15])
def test_a_share_of_the_rays_is_garbage(following: LocalizationTrial, share: float) -> None:
    after = injections.garbage(following, rng(), share=share)
    changed = np.any(after.pointings.directions != following.pointings.directions, axis=1)
    assert np.mean(changed) == pytest.approx(share, rel=0.35)


def test_drift_turns_by_one_degree_a_second_about_the_middle(following: LocalizationTrial) -> None:
    turns_rad = (azimuths(injections.drift(following, rng())) - azimuths(following)).tolist()
    assert math.degrees(abs(turns_rad[-1] - turns_rad[0])) == pytest.approx(10.0, abs=0.1)
    assert math.remainder(math.fsum(turns_rad) / len(turns_rad), math.tau) == pytest.approx(0.0, abs=1e-6)


def test_a_sensor_across_does_not_rise_with_the_arm(following: LocalizationTrial) -> None:
    rises = elevations(following)
    assert np.std(rises) > math.radians(2.0)
    assert abs(np.polyfit(rises, elevations(injections.across(following, rng())), 1)[0]) < 0.5
    assert np.polyfit(rises, elevations(injections.backwards(following, rng())), 1)[0] < -0.5


def test_late_reports_are_those_of_before(follower: FollowRecording) -> None:
    late = follower.shifted(0.5)
    assert len(late.pointings) == pytest.approx(len(follower.pointings) - 25, abs=1)
    now = late.pointings
    then = follower.pointings
    stamp_s = float(now.stamps_s[100])
    before, at_once = np.searchsorted(then.stamps_s, [stamp_s - 0.5 - 1e-9, stamp_s - 1e-9]).tolist()
    assert now.targets_m[100].tolist() == pytest.approx(then.targets_m[before].tolist(), abs=0.02)
    assert np.linalg.norm(now.targets_m[100] - then.targets_m[at_once]) > 0.1


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("wrong_lamp", "expected"), [(False, 0), (True, 1)])
def test_a_wrong_lamp_was_not_pointed_at(
    room: LocalizationTrial, seed: int, *, wrong_lamp: bool, expected: int
) -> None:
    injection = replace(injections.INJECTIONS[0], wrong_lamp=wrong_lamp)
    trial = chosen(room, 3, np.random.default_rng(seed), injection)
    lamp_of = dict(zip(rows(room.pointings.directions), rows(room.pointings.targets_m), strict=True))
    pointed = [lamp_of[ray] for ray in rows(trial.pointings.directions[::40])]
    lit = rows(trial.pointings.targets_m[::40])
    assert len(set(lit)) == len(set(pointed)) == len(trial.pointings) // 40 == 3
    assert len(set(lit) - set(pointed)) == expected
    assert sum(one != other for one, other in zip(lit, pointed, strict=True)) == expected


def test_lamps_on_one_wall_and_holds_one_after_the_other(room: LocalizationTrial) -> None:
    trial = chosen(room, 4, rng(), replace(injections.INJECTIONS[0], one_wall=True))
    assert np.ptp(trial.pointings.targets_m[:, 0]) < 1e-6
    assert np.ptp(trial.pointings.targets_m[:, 1]) > 0.5
    steps = np.diff(trial.pointings.stamps_s)
    assert np.all(steps > 0.0)
    assert np.count_nonzero(steps > 1.0) == 3
    assert trial.condition == "4 lamps"


def test_each_lamp_is_pointed_at_twice_with_the_same_error(room: LocalizationTrial) -> None:
    twice = replace(injections.INJECTIONS[0], visits=2)
    pointings = chosen(room, 3, rng(), twice).pointings
    first, second = np.split(np.arange(len(pointings)), 2)
    assert pointings.directions[first].tolist() == pointings.directions[second].tolist()
    assert pointings.targets_m[first].tolist() == pointings.targets_m[second].tolist()
    assert pointings.stamps_s[second[0]] > pointings.stamps_s[first[-1]]


def test_each_pass_of_a_person_has_faults_of_its_own(room: LocalizationTrial) -> None:
    injection = next(each for each in injections.INJECTIONS if each.name == "garbage 15 %")
    passes = [next(iter(trials_of(source))).pointings for source in sources_of([], [room, room], [injection])]
    changed = [
        {row for row, ray in enumerate(rows(each.directions)) if ray not in rows(room.pointings.directions)}
        for each in passes
    ]
    assert changed[0]
    assert changed[0] != changed[1]


def pose(x_m: float, y_m: float, sigma_m: float, yaw_sigma_rad: float = 0.1) -> Solution:
    return Solution(
        x_m=x_m, y_m=y_m, yaw_rad=0.0, bias_rad=0.0, residual_rad=0.0, samples=9,
        covariance=np.diag([sigma_m**2, sigma_m**2, yaw_sigma_rad**2]),
    )  # fmt: skip


@pytest.mark.parametrize("narrow", [1.0, 0.7, 0.1])
def test_honest_ones_meet_targets(
    monkeypatch: pytest.MonkeyPatch, following: LocalizationTrial, narrow: float
) -> None:
    """Errors drawn from the stated covariance: nominal square, 2 sigma of both, nobody confidently wrong."""
    drawn = np.random.default_rng(1)
    trial = replace(following, x_m=0.0, y_m=0.0, yaw_rad=0.0)

    def found(_: Pointings) -> Solution:
        yaw_rad = float(drawn.normal(0.0, 0.1))
        place = drawn.normal(0.0, 0.2, 2) * (1.0, narrow)
        return replace(
            pose(float(place[0]), float(place[1]), 0.2),
            yaw_rad=yaw_rad,
            covariance=np.diag([0.04, 0.04 * narrow**2, 0.01]),
        )

    monkeypatch.setattr("pointit_lab.evaluation.honesty.honesty.judged", found)
    row = rows_of([verdict(trial, injections.NONE) for _ in range(3000)])[0]
    assert row.square == pytest.approx(1.0, abs=0.1)
    assert row.within_2_sigma == pytest.approx(0.9545, abs=0.012)
    assert row.yaw_within_2_sigma == pytest.approx(0.954, abs=0.015)
    assert TARGETS.broken_by(replace(row, wrong=None)) == []


def test_a_row_counts_who_is_confidently_wrong() -> None:
    def one(error_m: float, *, in_place: bool, is_taken: bool = True, subject: str = "a") -> Judged:
        return Judged(
            set="s", condition=injections.NONE, duration="2 s", subject=subject, taken=is_taken,
            error_m=error_m, square=error_m, in_place=in_place, in_yaw=True,
        )  # fmt: skip

    honest = (one(0.1, in_place=True), one(0.6, in_place=True, subject="b"))
    others = (one(0.4, in_place=False, subject="c"), one(0.7, in_place=False))
    rows = rows_of([*honest, *others, one(9.0, in_place=False, is_taken=False)])
    assert [row.duration for row in rows] == [EVERY, "2 s"]
    row = rows[0]
    assert (row.n, row.taken, row.within_2_sigma) == (5, 0.8, 0.5)
    assert row.wrong is not None
    assert row.wrong.value == pytest.approx(0.25)
    assert row.wrong.low < 0.25 < row.wrong.high
    assert row.far is not None
    assert row.far.value == 0.0
    assert row.without_one == pytest.approx((1 / 3, 2 / 3))
    assert row.wrong_without_one == pytest.approx((0.0, 1 / 3))
    assert there(row.error_m).median == pytest.approx(0.5)


@pytest.mark.parametrize("turned_rad", [0.0, 0.2])
def test_the_cursor_misses_what_an_honest_covariance_states(
    monkeypatch: pytest.MonkeyPatch, following: LocalizationTrial, turned_rad: float
) -> None:
    """Poses that are 0.5 m off or turned, and say so: the rows have the cursor's miss and what is stated."""
    assert following.yaw_rad is not None
    covariance = np.diag([0.125, 0.125, 1e-9 if turned_rad == 0.0 else turned_rad**2])
    found = replace(
        pose(following.x_m + 0.5, following.y_m, 0.5), covariance=covariance, yaw_rad=following.yaw_rad
    )
    turned = replace(found, x_m=following.x_m + 1.5, yaw_rad=found.yaw_rad + turned_rad)

    def result(_: Pointings) -> Solution:
        return turned if turned_rad else found

    monkeypatch.setattr("pointit_lab.evaluation.honesty.honesty.judged", result)
    row = rows_of([verdict(following, injections.NONE)])[0]
    away = following.pointings.targets_m[:, :2] - (following.x_m, following.y_m)
    if turned_rad:
        assert row.far is not None
        assert row.far.value == 1.0
        assert row.miss_m == pytest.approx(1.5, abs=1.2 * turned_rad * float(np.hypot(*away.T).max()))
        assert there(row.miss_sigma_m) > 0.5
        assert (
            0.5 <= there(row.right) <= 0.75
        )  # 29° beside things at right angles to the way off, and turned by 11°
    else:
        assert row.miss_m == pytest.approx(0.5)
        assert row.right == 1.0  # 10° beside
        assert row.miss_sigma_m == pytest.approx(0.5, abs=1e-3)


def test_people_are_drawn_until_a_row_has_enough() -> None:
    size = Size(people=2, rooms=1, windows=1, taken=5)
    (none,) = (each for each in injections.INJECTIONS if each.name == injections.NONE)
    first = judged_sources(sources_of(followers([0, 1]), [], [none], 1), jobs=1, tick=lambda _done, _of: None)
    found = drawn_again(first, [none], size, 0, jobs=1, tick=lambda _done, _of: None)
    (row, *_) = rows_of(found)
    assert found[: len(first)] == first
    assert row.independent >= 5
    assert row.provable == pytest.approx(1.0 - 0.05 ** (1.0 / row.independent))
    assert len({each.subject for each in found}) == row.n // 4
    one_less = [each.subject for each in found[: -2 * 4] if each.taken]
    assert len(set(one_less)) < 5


def test_windows_of_a_stretch_of_a_recording_are_one_trial(follower: FollowRecording) -> None:
    recorded = replace(follower, set="motion_relloc", name="walk")
    ends = [verdict(trial, injections.NONE).unit for trial in recorded.trials([2.0])]
    assert ends == ["walk 0.0"] * 10


def test_a_refused_trial_is_not_taken(following: LocalizationTrial) -> None:
    turned = injections.backwards(following, rng())
    assert isinstance(judged(turned.pointings), Refusal)
    assert not verdict(turned, "mounted backwards").taken


def test_other_processes_find_the_same(follower: FollowRecording, room: LocalizationTrial) -> None:
    sources = sources_of([follower], [room], injections.INJECTIONS[::6], max_trials=1)
    alone, together = (judged_sources(sources, jobs=jobs, tick=lambda _done, _of: None) for jobs in (1, 2))
    assert alone == together


def test_table_has_a_row_for_each_condition_and_names_misses(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("POINTIT_DATA", raising=False)
    asked = ("--condition", injections.NONE, "--condition", "time -0.5 s")
    out, err = printed(
        honesty, *asked, "--quick", "--jobs", "1", "--set", "simulated", env={"COLUMNS": "140"}
    )
    assert "simulated people only" in err
    assert [line for line in out.splitlines() if line.split()[:3] == ["as", "they", "are"]]
    assert "simulated, time -0.5 s: 2 sigma of the place" in out


def test_rows_are_pooled_by_kind_of_people_and_condition() -> None:
    def one(name: str, condition: str, duration: str, *, in_place: bool) -> Judged:
        return Judged(
            set=name,
            condition=condition,
            duration=duration,
            subject="seed 0",
            taken=True,
            error_m=0.7,
            in_place=in_place,
        )

    pooled = pooled_rows(
        [
            one("flights", "drift", "2 s", in_place=True),
            one("lamps", "drift", "3 lamps", in_place=False),
            one("lamps", "garbage", "3 lamps", in_place=True),
            one("drawn", "drift", "2 s", in_place=True),
        ],
        ["drawn"],
    )
    assert [(row.set, row.condition, row.duration, row.n) for row in pooled] == [
        ("recorded people", "drift", EVERY, 2),
        ("recorded people", "garbage", EVERY, 1),
        ("simulated people", "drift", EVERY, 1),
    ]
    assert [None if row.wrong is None else row.wrong.value for row in pooled] == [0.5, 0.0, 0.0]
    assert [row.independent for row in pooled] == [2, 1, 1], "equal names in two sets are two people"
