"""Following a robot with the finger, and the choice of the followed one; in virtual time."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest

from pointit.geometry.floor_sigma import place_sigma_m
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, RememberedBias, TrackedObject, TrackedObjects, UserPose
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation.bias_memory import BiasMemory
from pointit.services.localizer.estimation.estimator import Pointings, Refusal, Solution, SolverSettings
from pointit.services.localizer.moving_target import (
    CONTRADICTED,
    WRIST_SIGMA_S,
    MovingTarget,
    RayWindow,
    TargetDisambiguator,
    Track,
    rank_by_posterior,
)
from pointit.services.localizer.outputs import Output
from tests.unit.localizer.person import EYES_M, START_NS, Person, config, poses, told, yaw_difference

PERSON = Person(0.5, -0.3, 1.1, math.radians(-4.0))
NEAR_M = 0.08
"""Limit of the error of a pose that comes after 3 s of exact following: 0.04 to 0.07 m at five places."""


def place(t_s: float, phase_rad: float = 0.0) -> Vec3:
    """A robot that flies a circle of 1 m about (2.5, 1), once in 8 s, up and down."""
    angle = math.tau * t_s / 8.0 + phase_rad
    return (2.5 + math.cos(angle), 1.0 + math.sin(angle), 0.7 + 0.4 * math.sin(2.0 * angle))


def robots(t_s: float, **places: Vec3) -> TrackedObjects:
    return TrackedObjects(
        stamp_ns=START_NS + round(t_s * NS_PER_S),
        objects=tuple(TrackedObject(id=name, kind="robot", position_m=xyz) for name, xyz in places.items()),
    )


Reports = Callable[[float], dict[str, TrackedObjects]]
"""Reports of each tracker at a time, s."""


def drone(t_s: float) -> dict[str, TrackedObjects]:
    return {"room": robots(t_s, drone=place(t_s))}


def decoyed(t_s: float) -> dict[str, TrackedObjects]:
    return {"room": robots(t_s, decoy=place(t_s, 2.5), drone=place(t_s))}


def twins(beside_m: float) -> Reports:
    def report(t_s: float) -> dict[str, TrackedObjects]:
        x, y, z = place(t_s)
        return {"room": robots(t_s, twin=(x + beside_m, y, z), drone=(x, y, z))}

    return report


def fly(
    procedure: MovingTarget,
    duration_s: float,
    *,
    reports: Reports = drone,
    aim: Callable[[float], Vec3] = place,
    noise_rad: float = 0.0,
    elevation_sigma_rad: float | None = None,
) -> list[Output]:
    """The person follows the robot; rays and reports come at 50 Hz."""
    outputs = procedure.start(START_NS)
    for tick in range(round(duration_s * 50)):
        t_s = tick / 50.0
        now_ns = START_NS + round(t_s * NS_PER_S)
        bias_rad = PERSON.bias_rad + noise_rad * math.sin(t_s / 0.7)
        ray = dataclasses.replace(PERSON, bias_rad=bias_rad).ray(aim(t_s), now_ns)
        procedure.on_ray(ray.model_copy(update={"elevation_sigma_rad": elevation_sigma_rad}))
        for tracker, report in reports(t_s).items():
            procedure.on_objects(tracker, report)
        outputs += procedure.step(now_ns)
    return outputs


def error_m(pose: UserPose, person: Person = PERSON) -> float:
    return math.hypot(pose.position_m[0] - person.x, pose.position_m[1] - person.y)


def test_following_ends_with_one_pose_within_four_seconds_of_following() -> None:
    procedure = MovingTarget(config())
    outputs = fly(procedure, 12.0)
    found = poses(outputs)
    assert len(found) == 1
    assert {message.phase for message in told(outputs)[:-1]} == {"sampling"}
    assert error_m(found[-1]) < NEAR_M
    assert abs(yaw_difference(found[-1].yaw_rad, PERSON.yaw_rad)) < 0.02
    assert found[-1].method == "moving_target"
    assert {(pose.position_m[2], pose.z_sigma_m) for pose in found} == {(0.0, 0.0)}  # on the floor
    assert not procedure.running
    last = told(outputs)[-1]
    assert (last.phase, last.progress, last.target_id) == ("solved", 1.0, "drone")
    assert 3.0 <= (last.stamp_ns - START_NS) / NS_PER_S <= 5.5  # the reaction counts, too


def test_the_pairing_is_by_stamp_not_by_arrival() -> None:
    """A tracker that is 0.4 s late costs 18° of the circle when paired by arrival."""
    found = poses(fly(MovingTarget(config()), 12.0, reports=lambda s: drone(s - 0.4) if s >= 0.4 else {}))
    assert error_m(found[-1]) < 0.1
    assert found[-1].residual_rad < math.radians(0.5)


def test_continuous_goes_on_and_keeps_to_its_window() -> None:
    procedure = MovingTarget(config(window_s=4.0, autostart=True))
    outputs = fly(procedure, 30.0)
    found = poses(outputs)
    assert procedure.running
    assert found[-1].stamp_ns > START_NS + 29 * NS_PER_S
    gaps = np.diff([pose.stamp_ns for pose in found]) / NS_PER_S
    assert np.all((gaps > 0.49) & (gaps < 0.51))  # twice a second
    first_solved = next(message for message in told(outputs) if message.phase == "solved")
    assert first_solved.stamp_ns == found[0].stamp_ns  # a pose exists once it is announced
    assert found[-1].samples == pytest.approx(200, abs=4)


def test_followed_robot_is_chosen_among_two() -> None:
    outputs = fly(MovingTarget(config()), 12.0, reports=decoyed)
    assert told(outputs)[-1].target_id == "drone"
    assert error_m(poses(outputs)[-1]) < NEAR_M
    named = fly(MovingTarget(config(robot_id="decoy", give_up_s=11.0)), 12.0, reports=decoyed)
    assert all(message.target_id == "decoy" for message in told(named))


@pytest.mark.parametrize("noise_rad", [0.0, math.radians(1.0)])
def test_two_robots_that_move_alike_are_refused_by_name(noise_rad: float) -> None:
    outputs = fly(MovingTarget(config(give_up_s=11.0)), 12.0, reports=twins(0.8), noise_rad=noise_rad)
    assert poses(outputs) == []
    last = told(outputs)[-1]
    assert last.phase == "refused"
    assert all(part in last.reason for part in ("two robots move alike", "drone", "twin"))
    named = fly(MovingTarget(config(robot_id="drone")), 12.0, reports=twins(0.8), noise_rad=noise_rad)
    assert error_m(poses(named)[-1]) < 0.3  # after 3 s with an unrest of 1°: 0.17 to 0.31 m at five places


def test_a_robot_that_is_tracked_twice_is_one() -> None:
    assert error_m(poses(fly(MovingTarget(config()), 12.0, reports=twins(0.05)))[-1]) < 0.1


@pytest.mark.parametrize("trackers", [("ahead", "room"), ("room", "ahead")])
def test_second_tracker_with_a_wrong_clock_leaves_the_pose_intact(trackers: tuple[str, str]) -> None:
    ahead_s = {"ahead": 60.0, "room": 0.0}

    def reports(t_s: float) -> dict[str, TrackedObjects]:
        return {name: robots(t_s + ahead_s[name], drone=place(t_s)) for name in trackers}

    assert error_m(poses(fly(MovingTarget(config()), 12.0, reports=reports))[-1]) < NEAR_M


def test_following_without_a_fit_is_refused_at_the_timeout() -> None:
    generator = np.random.default_rng(5)
    anywhere: list[Vec3] = [tuple(each) for each in generator.uniform(-3, 3, (500, 3)).tolist()]
    outputs = fly(MovingTarget(config(give_up_s=8.0)), 10.0, aim=lambda t_s: anywhere[round(t_s * 50)])
    assert poses(outputs) == []
    last = told(outputs)[-1]
    assert last.phase == "refused"
    assert "rays miss" in last.reason
    assert last.residual_rad is not None


def test_missing_robot_and_missing_rays_are_the_reason() -> None:
    procedure = MovingTarget(config(give_up_s=3.0))
    procedure.start(START_NS)
    (first,) = told(procedure.step(START_NS))
    assert first.phase == "sampling"
    assert "no tracker reports a robot" in first.reason
    procedure.on_objects("room", robots(0.0, drone=place(0.0)))
    (second,) = told(procedure.step(START_NS + NS_PER_S))
    assert "no rays come" in second.reason
    (last,) = told(procedure.step(START_NS + 3 * NS_PER_S))
    assert last.phase == "refused"
    assert procedure.step(START_NS + 9 * NS_PER_S) == []


def follow_a_tracker(hz: float, ahead_s: float) -> list[Output]:
    """The person follows a robot whose tracker reports at `hz`, with its clock `ahead_s` ahead."""
    reported = -1

    def reports(t_s: float) -> dict[str, TrackedObjects]:
        nonlocal reported
        if math.floor(t_s * hz) <= reported:
            return {}
        reported = math.floor(t_s * hz)
        return {"room": robots(t_s + ahead_s, drone=place(t_s))}

    return fly(MovingTarget(config(give_up_s=8.0)), 9.0, reports=reports)


@pytest.mark.parametrize("hz", [0.5, 1.0, 2.0])
def test_tracker_that_is_too_slow_is_named_with_its_rate(hz: float) -> None:
    last = told(follow_a_tracker(hz, 0.0))[-1]
    assert last.phase == "refused"
    assert last.reason.startswith(f"robot drone is reported by tracker room at {hz:.1f} Hz and at least 3 Hz")
    assert poses(follow_a_tracker(3.0, 0.0)) != []


@pytest.mark.parametrize("ahead_s", [-3600.0, -15.0, -3.0, 0.8, 3.0, 15.0, 3600.0])
def test_tracker_whose_clock_is_apart_is_named_with_the_difference(ahead_s: float) -> None:
    outputs = follow_a_tracker(25.0, ahead_s)
    assert poses(outputs) == []
    last = told(outputs)[-1]
    assert last.phase == "refused"
    way = "ahead of" if ahead_s > 0 else "behind"
    apart = f"{abs(ahead_s):.1f} s {way} that of the rays"
    assert last.reason.startswith(f"the clock of tracker room is {apart};")


def test_no_pose_is_repeated_when_the_rays_stop() -> None:
    procedure = MovingTarget(config(autostart=True))
    fly(procedure, 12.0)
    for second in range(13, 20):
        outputs = procedure.step(START_NS + second * NS_PER_S)
        if second > 13:
            assert poses(outputs) == []
            assert told(outputs)[-1].phase == "solved"  # the last pose holds
            assert "no rays come" in told(outputs)[-1].reason


def test_a_track_is_linear_between_reports_and_unknown_in_gaps() -> None:
    track = Track(10.0)
    for t_s, x in ((0.0, 0.0), (0.2, 2.0), (0.2, 9.0), (0.1, 9.0), (1.0, 4.0)):  # doubles and older: ignored
        track.add(START_NS + round(t_s * NS_PER_S), (x, 0.0, 1.0))
    stamps = START_NS + np.round(np.array([-0.1, 0.0, 0.05, 0.2, 0.5, 1.0, 1.1]) * NS_PER_S).astype(np.int64)
    places, known = track.at(stamps)
    assert known.tolist() == [False, True, True, True, False, False, False]
    assert places[2].tolist() == pytest.approx([0.5, 0.0, 1.0])
    assert places[3].tolist() == pytest.approx([2.0, 0.0, 1.0])


def test_a_tracker_whose_clock_is_set_back_is_followed() -> None:
    track = Track(10.0)
    for at_s in (5000, 5001, 100, 101, 102):
        track.add(at_s * NS_PER_S, (1.0, 2.0, 3.0))
    assert track.newest_ns == 102 * NS_PER_S


def test_a_window_forgets_and_takes_no_older_ray() -> None:
    window = RayWindow(2.0)
    for t_s in (0.0, 1.0, 0.5, 1.0, 2.0, 2.5):
        window.add(PERSON.ray((1.0, 1.0, 1.0), START_NS + round(t_s * NS_PER_S)))
    assert (len(window), window.newest_ns) == (3, START_NS + round(2.5 * NS_PER_S))


def test_standing_robot_is_the_reason_without_requesting_another_place() -> None:
    stands: Vec3 = (2.5, 1.0, 0.2)
    outputs = fly(
        MovingTarget(config()),
        6.0,
        reports=lambda t_s: {"room": robots(t_s, drone=stands)},
        aim=lambda _: stands,
    )
    assert told(outputs)[-1].reason == "drone stands still: follow it with the arm as soon as it moves"
    assert not any("two or more" in message.reason for message in told(outputs))


def test_pose_is_refined_until_places_near_the_robot_are_certain() -> None:
    def sigma_m(pose: UserPose) -> float:
        return place_sigma_m((2.5, 1.0, 0.0), pose.position_m, pose.covariance, (0.0, 0.0, 1.6), 0.0)

    early = poses(fly(MovingTarget(config()), 12.0))[0]
    limit_m = 0.9 * sigma_m(early)
    outputs = fly(MovingTarget(config(max_place_sigma_m=limit_m)), 25.0)
    late = poses(outputs)[0]
    assert late.stamp_ns > early.stamp_ns
    assert any(f"limit {limit_m:g} m" in message.reason for message in told(outputs))
    assert sigma_m(late) < 1.05 * limit_m


ON = config(window_s=4.0, autostart=True, drift={"rate_sigma_degps": 0.5})
RUN_UP_S = ON.reaction_s + ON.window_s


def live(
    procedure: MovingTarget,
    from_s: float,
    to_s: float,
    *,
    who: Callable[[float], Person] = lambda _: PERSON,
    rays_hz: float = 10.0,
    is_tracked: bool = True,
    latency_sigma_s: float | None = None,
) -> list[Output]:
    """`who` follows the robot, whose place is reported at 10 Hz if `is_tracked`."""
    outputs: list[Output] = []
    for tick in range(round(from_s * 30), round(to_s * 30)):
        t_s = tick / 30.0
        now_ns = START_NS + round(t_s * NS_PER_S)
        if tick % 3 == 0 and is_tracked:
            report = robots(t_s, drone=place(t_s))
            procedure.on_objects("room", report.model_copy(update={"latency_sigma_s": latency_sigma_s}))
        if tick % round(30 / rays_hz) == 0:
            procedure.on_ray(who(t_s).ray(place(t_s), now_ns))
        outputs += procedure.step(now_ns)
    return outputs


def started(parameters: LocalizerConfig) -> MovingTarget:
    procedure = MovingTarget(parameters)
    procedure.start(START_NS)
    return procedure


def stated(pose: UserPose) -> float:
    """Return one sigma of a pose along its worse direction."""
    return math.sqrt(float(np.linalg.eigvalsh(np.array(pose.covariance).reshape(3, 3)[:2, :2])[1]))


def test_newest_half_with_too_few_rays_contradicts_nothing() -> None:
    """Rays at 3 Hz: enough for a pose in 10 s, too few in 5 s."""
    outputs = live(started(config()), 0.0, 12.0, rays_hz=3.0)
    (found,) = poses(outputs)
    assert found.samples < 40
    assert error_m(found) < 0.05
    assert told(outputs)[-1].phase == "solved"


@pytest.mark.parametrize(
    ("tracker_s", "wrist_s", "sigma_s"), [(0.0, None, WRIST_SIGMA_S), (0.03, 0.04, 0.05)]
)
def test_times_of_tracker_and_wrist_are_as_uncertain_as_stated(
    tracker_s: float, wrist_s: float | None, sigma_s: float
) -> None:
    def sigma_m(tracker_s: float, wrist_s: float | None) -> float:
        procedure = started(ON)
        procedure.wrist_sigma_s = wrist_s
        return stated(poses(live(procedure, 0.0, 8.0, latency_sigma_s=tracker_s))[-1])

    assert sigma_m(tracker_s, wrist_s) == pytest.approx(sigma_m(sigma_s, 0.0))
    assert sigma_m(0.0, 0.0) < sigma_m(tracker_s, wrist_s) < sigma_m(0.1, wrist_s)


def test_slow_walk_is_reported_although_consecutive_poses_agree() -> None:
    def walking(t_s: float) -> Person:
        away_m = 0.05 * max(0.0, t_s - RUN_UP_S)
        return Person(PERSON.x - away_m, PERSON.y, PERSON.yaw_rad, PERSON.bias_rad)

    outputs = live(started(ON), 0.0, 45.0, who=walking)
    assert told(outputs)[-1].reason == CONTRADICTED
    assert max(error_m(pose) for pose in poses(outputs)) < 1.0


@pytest.mark.parametrize(
    ("pause_s", "turned_deg", "is_told"), [(0, 20, True), (60, 20, False), (60, 120, True)]
)
def test_heading_may_drift_while_nothing_comes(pause_s: float, turned_deg: float, *, is_told: bool) -> None:
    """The IMU drifts by 0.5°/s (1 sigma): 20° within a minute, not at once."""
    procedure = started(ON)
    assert poses(live(procedure, 0.0, RUN_UP_S + 1.0))
    turned = Person(PERSON.x, PERSON.y, PERSON.yaw_rad + math.radians(turned_deg), PERSON.bias_rad)
    again_s = RUN_UP_S + 1.0 + pause_s
    last = told(live(procedure, again_s, again_s + ON.window_s + 0.5, who=lambda _: turned))[-1]
    assert last.reason == (CONTRADICTED if is_told else "")


def test_rays_from_before_the_start_make_no_pose() -> None:
    procedure = MovingTarget(config())
    start_ns = START_NS + 12 * NS_PER_S
    procedure.start(start_ns)
    for tick in range(120):
        t_s = tick / 10.0
        procedure.on_objects("room", robots(t_s, drone=place(t_s)))
        procedure.on_ray(PERSON.ray(place(t_s), START_NS + round(t_s * NS_PER_S)))
    outputs = procedure.step(start_ns)
    assert (poses(outputs), told(outputs)[-1].samples) == ([], 0)
    assert "no rays come" in told(outputs)[-1].reason
    assert told(live(procedure, 12.1, 14.5))[-1].samples == pytest.approx(10, abs=6)  # after the reaction


REMEMBERED = RememberedBias(
    localizations=3,
    origin_height_m=EYES_M,
    bias_rad=PERSON.bias_rad,
    slope=0.0,
    covariance=(math.radians(1.0) ** 2, 0.0, 0.0, 0.05**2),
)


class RecordingMemory(BiasMemory):
    """A memory that keeps what it is asked."""

    def __init__(self, remembered: RememberedBias | None = None) -> None:
        super().__init__()
        self.remembered = remembered
        self.used: list[RememberedBias | None] = []
        self.learned: list[Pointings] = []

    def believed(self, pointings: Pointings, settings: SolverSettings, floor_m: float) -> SolverSettings:
        self.used.append(self.remembered)
        return super().believed(pointings, settings, floor_m)

    def learn(self, pointings: Pointings, settings: SolverSettings, floor_m: float) -> bool:
        self.learned.append(pointings)
        return super().learn(pointings, settings, floor_m)


def test_remembered_bias_shortens_the_localization() -> None:
    def found_s(memory: BiasMemory) -> float:
        last = told(fly(MovingTarget(config(max_place_sigma_m=0.35), memory), 20.0, noise_rad=0.01))[-1]
        assert last.phase == "solved"
        return (last.stamp_ns - START_NS) / NS_PER_S

    assert found_s(RecordingMemory(REMEMBERED)) < found_s(BiasMemory())


def test_calibrated_person_has_no_remembered_bias() -> None:
    memory = RecordingMemory(REMEMBERED)
    assert poses(fly(MovingTarget(config(), memory), 12.0, elevation_sigma_rad=math.radians(3.0)))
    assert (memory.used, memory.learned) == ([], [])


def test_continuing_rays_are_no_second_measurement_of_the_bias() -> None:
    memory = RecordingMemory()
    procedure = MovingTarget(config(autostart=True, max_place_sigma_m=0.3), memory)
    assert len(poses(fly(procedure, 12.0))) > 5
    assert len(memory.learned) == 1
    assert memory.remembered is not None
    assert memory.remembered.localizations == 1
    assert set(memory.used) == {None}  # as at the start


TRUST = SolverSettings()
N = 9.0


def solution(residual_deg: float, x_m: float = 0.0) -> Solution:
    return Solution(
        x_m=x_m,
        y_m=0.0,
        yaw_rad=0.0,
        bias_rad=0.0,
        covariance=np.eye(3) * 0.01,
        residual_rad=math.radians(residual_deg),
        samples=100,
    )


def decide(meant: TargetDisambiguator, **residuals_deg: float) -> str:
    """Return the chosen robot, or the reason for no choice."""
    results = [(name, solution(deg, ord(name[0]))) for name, deg in residuals_deg.items()]
    fits = rank_by_posterior(results, N, TRUST.ray_sigma_rad)
    told = meant.choose(fits)
    return told.reason if isinstance(told, Refusal) else meant.object_id


def test_probabilities_are_those_of_the_residuals() -> None:
    fits = rank_by_posterior(
        [("b", solution(3.0)), ("a", solution(2.0)), ("c", Refusal("few rays"))], N, 0.0349
    )
    assert [fit.object_id for fit in fits] == ["a", "b", "c"]
    odds = math.exp(-0.5 * N * (math.radians(3.0) ** 2 - math.radians(2.0) ** 2) / 0.0349**2)
    assert fits[0].probability == pytest.approx(1.0 / (1.0 + odds))
    assert sum(fit.probability for fit in fits) == pytest.approx(1.0)
    assert fits[2].probability == 0.0


def test_choice_stays_until_another_robot_is_clearly_meant() -> None:
    meant = TargetDisambiguator()
    assert "two robots move alike, a and b" in decide(meant, a=2.0, b=2.1)
    assert decide(meant, a=1.0, b=6.0) == "a"
    assert decide(meant, a=2.0, b=2.1) == "a"  # at first that would be undecided
    # hardly better: the pose is not changed
    assert "two robots move alike" in decide(meant, a=2.1, b=2.0)
    assert decide(meant, a=2.0, b=2.1) == "a"
    # clearly better, but once is not enough
    assert "two robots move alike" in decide(meant, a=6.0, b=1.0)
    assert decide(meant, a=1.0, b=6.0) == "a"
    decide(meant, a=6.0, b=1.0)
    assert decide(meant, a=6.0, b=1.0) == "b"


def test_one_that_leaves_is_let_go() -> None:
    meant = TargetDisambiguator()
    assert (decide(meant, a=1.0, b=6.0), decide(meant, b=1.0)) == ("a", "b")


def test_robots_that_move_alike_are_distinguished_by_their_probability_alone() -> None:
    """1.0° against 1.5° is half as much again; of nine pointings that may still be chance."""
    assert "two robots move alike, a and b" in decide(TargetDisambiguator(), a=1.0, b=1.5)
    assert decide(TargetDisambiguator(), a=1.0, b=3.5) == "a"
