"""The localizer with recorded people: what is taken, how far off it is, and which robot is meant."""

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pointit.geometry import rotation
from pointit.geometry.array_types import Array
from pointit.geometry.rotation import Quaternion
from pointit.schemas import NS_PER_S, PointingRay
from pointit.services.imu_bridge.arm_frame import MOUNTINGS, ArmFrame
from pointit.services.localizer.estimation.estimator import (
    Pointings,
    Refusal,
    Solution,
    SolverSettings,
    solve,
)
from pointit.services.localizer.moving_target import MovingTarget
from pointit.services.localizer.outputs import Output
from pointit.services.localizer.target_disambiguator import TargetDisambiguator, rank_by_posterior
from pointit.services.localizer.verification import followed, without_spikes
from pointit.sim.recordings import OPERATOR, read_imu_csv
from pointit_lab.evaluation.datasets import motion_relloc, read_trials
from pointit_lab.evaluation.localization.arm_rays import eye_finger_rays
from pointit_lab.evaluation.localization.trial import FollowRecording, LocalizationTrial, TrialReading
from pointit_lab.evaluation.recordings.data_folder import file_of, read_index
from tests.support.data import data_file
from tests.unit.localizer.person import START_NS, config, poses, yaw_difference
from tests.unit.localizer.test_estimator import is_outside
from tests.unit.localizer.test_mounting import TURNS, verdict
from tests.unit.localizer.test_moving_target import TRUST, robots

RISE_S = 0.7
UNLIMITED = SolverSettings().unlimited()


@pytest.fixture(scope="module")
def windows() -> list[LocalizationTrial]:
    """Return every second window of 3 s of recorded people."""
    trials = read_trials(data_file("recordings"), ["proximity_waypoints", "motion_relloc"]).trials
    return [trial for trial in trials if trial.condition == "3 s"][::2]


def with_directions(pointings: Pointings, azimuths: np.ndarray, elevations: np.ndarray) -> Pointings:
    level = np.cos(elevations)
    directions = np.stack([level * np.cos(azimuths), level * np.sin(azimuths), np.sin(elevations)], axis=1)
    return Pointings(pointings.stamps_s, pointings.origins_m, directions, pointings.targets_m)


def raised(pointings: Pointings, hangs_s: float, seed: int) -> Pointings:
    """Return the rays of an arm that hangs for `hangs_s` and then comes up."""
    rng = np.random.default_rng(seed)
    rays = pointings.directions
    azimuths = np.unwrap(np.arctan2(rays[:, 1], rays[:, 0]))
    elevations = np.arcsin(rays[:, 2])
    times_s = pointings.stamps_s - pointings.stamps_s[0]
    share = np.clip((times_s - hangs_s) / RISE_S, 0.0, 1.0)
    share = share * share * (3.0 - 2.0 * share)
    return with_directions(
        pointings,
        share * azimuths + (1.0 - share) * (azimuths[0] + rng.uniform(-1.0, 1.0)),
        share * elevations + (1.0 - share) * math.radians(-50.0),
    )


def error_m(found: Solution, trial: LocalizationTrial) -> float:
    return math.hypot(found.x_m - trial.x_m, found.y_m - trial.y_m)


def test_people_who_follow_are_taken(windows: list[LocalizationTrial]) -> None:
    found = [followed(trial.pointings, UNLIMITED) for trial in windows]
    assert np.mean([isinstance(each, Solution) for each in found]) > 0.85


@pytest.mark.parametrize("hangs_s", [0.3, 0.8, 1.5])
def test_arm_that_came_late_is_not_taken(windows: list[LocalizationTrial], hangs_s: float) -> None:
    """Without this check every third would be, and most of them more than a metre off."""
    wrong = 0
    for seed, trial in enumerate(windows):
        found = followed(raised(trial.pointings, hangs_s, seed), SolverSettings())
        if isinstance(found, Solution):
            wrong += error_m(found, trial) > max(0.5, 2.0 * found.position_sigma_m)
    assert wrong <= 0.03 * len(windows)


def test_still_arm_is_refused_when_the_robot_moves(windows: list[LocalizationTrial]) -> None:
    rng = np.random.default_rng(1)
    for trial in windows:
        rays = trial.pointings.directions
        azimuth = math.atan2(rays[0, 1], rays[0, 0])
        elevation = math.asin(rays[0, 2])
        unrest = np.cumsum(rng.normal(0.0, math.radians(0.15), (len(rays), 2)), axis=0)
        still = with_directions(trial.pointings, azimuth + unrest[:, 0], elevation + unrest[:, 1])
        assert isinstance(followed(still, UNLIMITED), Refusal)


def test_rays_that_leap_are_left_out(windows: list[LocalizationTrial]) -> None:
    """Every seventh ray goes anywhere; the arm's own are kept."""
    rng = np.random.default_rng(2)
    taken = kept = 0
    for trial in windows:
        pointings = trial.pointings
        anywhere = rng.normal(size=pointings.directions.shape)
        anywhere /= np.linalg.norm(anywhere, axis=1)[:, None]
        leaps = rng.random(len(pointings)) < 0.15
        spoiled = Pointings(
            pointings.stamps_s,
            pointings.origins_m,
            np.where(leaps[:, None], anywhere, pointings.directions),
            pointings.targets_m,
        )
        clean = without_spikes(pointings)
        left = without_spikes(spoiled)
        assert len(clean) > 0.97 * len(pointings)
        assert len(left) > 0.7 * len(pointings)
        one, other = (followed(each, UNLIMITED) for each in (pointings, spoiled))
        taken += isinstance(one, Solution)
        if isinstance(one, Solution) and isinstance(other, Solution):
            kept += 1
            assert math.hypot(one.x_m - other.x_m, one.y_m - other.y_m) < max(0.2, one.position_sigma_m)

    assert kept >= 0.9 * taken > 0


def test_late_arm_costs_no_more_than_its_own_time_again() -> None:
    """The arm comes up 2 s late: its rays before are forgotten once it follows."""
    trials = read_trials(data_file("recordings"), ["proximity_waypoints"]).trials
    longest = [trial for trial in trials if trial.condition == "8 s"]
    for seed, trial in enumerate(longest[::6]):
        late = raised(trial.pointings, 1.3, seed)
        procedure = MovingTarget(config(reaction_s=0.0))
        procedure.start(START_NS)
        outputs = list[Output]()
        times_s = late.stamps_s - late.stamps_s[0]
        for t_s, origin, ray, target in zip(
            times_s.tolist(),
            late.origins_m.tolist(),
            late.directions.tolist(),
            late.targets_m.tolist(),
            strict=True,
        ):
            now_ns = START_NS + round(t_s * NS_PER_S)
            procedure.on_objects("room", robots(t_s, drone=tuple(target)))
            procedure.on_ray(PointingRay(stamp_ns=now_ns, origin_m=tuple(origin), direction=tuple(ray)))
            outputs += procedure.step(now_ns)
        (pose,) = poses(outputs)
        assert pose.stamp_ns <= START_NS + 7 * NS_PER_S
        x_m, y_m, _ = pose.position_m
        assert math.hypot(x_m - trial.x_m, y_m - trial.y_m) < 0.8


# a tracker that is late


@pytest.mark.parametrize("name", ["motion_relloc", "proximity_waypoints"])
def test_recorded_people_are_within_two_sigma_despite_a_late_tracker(name: str) -> None:
    """A recorded robot whose places are taken 0.2 s late."""
    reading = read_trials(data_file("recordings"), [name])
    outside: dict[float, list[bool]] = {0.0: [], 0.15: []}
    off_m: dict[float, list[float]] = {0.0: [], 0.15: []}
    trials = [trial for trial in reading.trials if trial.condition == "10 s"]
    for trial in trials:
        t_s = trial.pointings.stamps_s
        targets_m = trial.pointings.targets_m
        late_m = np.column_stack([np.interp(t_s - 0.2, t_s, targets_m[:, axis]) for axis in range(3)])
        for latency_sigma_s, judged_as in outside.items():
            result = solve(
                dataclasses.replace(trial.pointings, targets_m=late_m),
                SolverSettings(latency_sigma_s=latency_sigma_s),
            )
            assert isinstance(result, Solution)  # none is refused for it
            off_m[latency_sigma_s].append(math.hypot(result.x_m - trial.x_m, result.y_m - trial.y_m))
            turned_rad = 0.0 if trial.yaw_rad is None else yaw_difference(result.yaw_rad, trial.yaw_rad)
            judged_as.append(is_outside(result, off_m[latency_sigma_s][-1], turned_rad))

    assert np.mean(outside[0.15]) <= 0.05
    assert np.mean(outside[0.15]) < np.mean(outside[0.0])
    assert np.median(off_m[0.15]) < np.median(off_m[0.0])


# sensors that sit wrong


@pytest.mark.parametrize("name", ["motion_relloc", "proximity_waypoints"])
def test_no_recorded_person_is_said_to_wear_the_sensor_wrong(name: str) -> None:
    accepted = doubted = 0
    for trial in read_trials(data_file("recordings"), [name]).trials:
        if trial.condition not in ("3 s", "5 s", "10 s"):
            continue
        is_accepted, fault = verdict(trial.pointings)
        assert "seems to be mounted" not in fault, (trial.subject, trial.condition, fault)
        accepted += is_accepted
        doubted += bool(fault)
        assert not (fault and trial.condition == "10 s")  # a whole window leaves no doubt
    assert doubted <= 0.01 * accepted  # windows of 3 s tell a mounting less well than a whole one


def windows_with(turn: Quaternion, step_s: float) -> Iterator[Pointings]:
    """Yield windows of 10 s of a recorded operator whose sensor is turned on the arm."""
    folder = data_file("recordings/motion_relloc")
    arm = ArmFrame(rotation.multiply(MOUNTINGS[motion_relloc.MOUNTING], turn))
    for entry in read_index(folder):
        path = file_of(folder, entry) if entry.get("kind") == motion_relloc.KIND else None
        if path is None:
            continue
        recorded = read_imu_csv(path)
        assert recorded.robot_m is not None
        for start_s in np.arange(0.0, float(recorded.t_s[-1]) - 10.0, step_s):
            part = (recorded.t_s >= start_s) & (recorded.t_s < start_s + 10.0)
            sensors: list[Quaternion] = [tuple(row) for row in recorded.orientation_xyzw[part].tolist()]
            rays = eye_finger_rays((arm.orientation(each) for each in sensors), OPERATOR)
            yield Pointings(recorded.t_s[part] - start_s, *rays, recorded.robot_m[part])


@pytest.mark.parametrize("turn", ["left", "right", "backwards"])
def test_recorded_arms_with_a_sensor_turned_on_them_are_refused(turn: str) -> None:
    """The arm rolls as arms do."""
    faults: list[str] = []
    for gathered in windows_with(TURNS[turn], 3.0):
        is_accepted, fault = verdict(gathered)
        assert fault or not is_accepted
        faults.append(fault)
    assert np.mean(["seems to be mounted" in fault for fault in faults]) > 0.7


@pytest.mark.parametrize("degrees", [-150, -120, -60, 60, 120, 150])
@pytest.mark.parametrize("axis", [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0)], ids=["pitch", "yaw"])
def test_recorded_arms_with_far_turned_sensors_are_not_accepted_silently(
    axis: tuple[float, float, float], degrees: int
) -> None:
    """Turned by 60 degrees about its own vertical it still rises by half with the arm: some are taken."""
    turn = rotation.from_axis_angle(axis, math.radians(degrees))
    verdicts = [verdict(gathered) for gathered in windows_with(turn, 9.0)]
    silent = sum(is_accepted and not fault for is_accepted, fault in verdicts)
    some = axis[2] == 1.0 and abs(degrees) == 60
    assert silent <= (0.7 * len(verdicts) if some else 0)


def test_a_sensor_that_is_rolled_about_the_arm_changes_nothing() -> None:
    for degrees in (-90, 45, 180):
        turn = rotation.from_axis_angle((1.0, 0.0, 0.0), math.radians(degrees))
        assert {verdict(gathered) for gathered in windows_with(turn, 20.0)} == {(True, "")}


# which robot


class Recorded(TrialReading):
    """Keeps whole recordings instead of their windows."""

    def __init__(self) -> None:
        super().__init__()
        self.followings: list[FollowRecording] = []

    def follow(self, path: Path, following: FollowRecording) -> None:
        del path
        self.followings.append(following)


def meant_in(following: FollowRecording, begin_s: float, decoy_m: Array) -> str:
    """Return the choice in the 3 s from `begin_s` on, the robot of the recording or a decoy."""
    stamps_s = following.pointings.stamps_s
    part = slice(*np.searchsorted(stamps_s, (begin_s, begin_s + 3.0)).tolist())
    results = [
        (
            name,
            solve(
                Pointings(
                    stamps_s[part],
                    following.pointings.origins_m[part],
                    following.pointings.directions[part],
                    path_m[part],
                ),
                UNLIMITED,
            ),
        )
        for name, path_m in (("robot", following.pointings.targets_m), ("decoy", decoy_m))
    ]
    meant = TargetDisambiguator()
    told = meant.choose(rank_by_posterior(results, 1.0 + 3.0 * TRUST.independent_hz, TRUST.ray_sigma_rad))
    return meant.object_id if isinstance(told, Solution) else ""


def test_recorded_robot_is_chosen_over_decoys_with_a_similar_path() -> None:
    """The decoy flies the recorded path mirrored, or some seconds late; windows of 3 s.

    Where the robot flew circles, the late one looks exactly the same from another place: nobody can tell.
    """
    reading = Recorded()
    motion_relloc.read(data_file("recordings/motion_relloc"), reading)
    told: list[str] = []
    for following in reading.followings:
        stamps_s = following.pointings.stamps_s
        path_m = following.pointings.targets_m
        mirrored = path_m * [1.0, -1.0, 1.0] + [0.0, 2.0 * path_m[:, 1].mean(), 0.0]
        late = np.column_stack([np.interp(stamps_s - 4.0, stamps_s, path_m[:, axis]) for axis in range(3)])
        for decoy_m in (mirrored, late):
            told += [meant_in(following, t, decoy_m) for t in np.arange(4.0, stamps_s[-1] - 3.0, 1.0)]
    decided = [name for name in told if name]

    assert len(decided) >= 60
    assert decided.count("robot") >= 0.95 * len(decided)
