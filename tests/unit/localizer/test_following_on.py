"""Following a robot for long, with pauses, walks and losses; stepped in virtual time."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from pointit.schemas import NS_PER_S, Localization, UserPose
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.outputs import Output
from pointit.services.localizer.procedures.moving_target import CONTRADICTED, WRIST_SIGMA_S, MovingTarget
from tests.unit.localizer.person import START_NS, Person, config, poses, told
from tests.unit.localizer.test_moving_target import PERSON, error_m, place, robots

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


def last_told(outputs: list[Output]) -> Localization:
    return told(outputs)[-1]


def stated(pose: UserPose) -> float:
    """Return one sigma of a pose along its worse direction."""
    return math.sqrt(float(np.linalg.eigvalsh(np.array(pose.covariance).reshape(3, 3)[:2, :2])[1]))


def test_newest_half_that_has_too_few_rays_of_its_own_contradicts_nothing() -> None:
    """Rays at 3 Hz: enough for a pose in 10 s, too few in 5 s."""
    outputs = live(started(config()), 0.0, 12.0, rays_hz=3.0)
    (found,) = poses(outputs)
    assert found.samples < 40
    assert error_m(found) < 0.05
    assert last_told(outputs).phase == "solved"


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


def test_who_walks_away_slowly_is_told_although_each_pose_agrees_with_the_one_before() -> None:
    def walking(t_s: float) -> Person:
        away_m = 0.05 * max(0.0, t_s - RUN_UP_S)
        return Person(PERSON.x - away_m, PERSON.y, PERSON.yaw_rad, PERSON.bias_rad)

    outputs = live(started(ON), 0.0, 45.0, who=walking)
    assert last_told(outputs).reason == CONTRADICTED
    assert max(error_m(pose) for pose in poses(outputs)) < 1.0


@pytest.mark.parametrize(
    ("pause_s", "turned_deg", "is_told"), [(0, 20, True), (60, 20, False), (60, 120, True)]
)
def test_heading_may_have_drifted_while_nothing_came(
    pause_s: float, turned_deg: float, *, is_told: bool
) -> None:
    """The IMU drifts by 0.5°/s (1 sigma): 20° within a minute, not at once."""
    procedure = started(ON)
    assert poses(live(procedure, 0.0, RUN_UP_S + 1.0))
    turned = Person(PERSON.x, PERSON.y, PERSON.yaw_rad + math.radians(turned_deg), PERSON.bias_rad)
    again_s = RUN_UP_S + 1.0 + pause_s
    last = last_told(live(procedure, again_s, again_s + ON.window_s + 0.5, who=lambda _: turned))
    assert last.reason == (CONTRADICTED if is_told else "")


def test_rays_of_before_the_start_make_no_pose_however_late_they_come() -> None:
    procedure = MovingTarget(config())
    start_ns = START_NS + 12 * NS_PER_S
    procedure.start(start_ns)
    for tick in range(120):
        t_s = tick / 10.0
        procedure.on_objects("room", robots(t_s, drone=place(t_s)))
        procedure.on_ray(PERSON.ray(place(t_s), START_NS + round(t_s * NS_PER_S)))
    outputs = procedure.step(start_ns)
    assert poses(outputs) == []
    assert last_told(outputs).samples == 0
    assert "no rays come" in last_told(outputs).reason
    assert last_told(live(procedure, 12.1, 14.5)).samples == pytest.approx(10, abs=6)  # after the reaction


def test_progress_falls_while_the_robot_is_lost() -> None:
    procedure = started(config(window_s=3.0))
    seen = last_told(live(procedure, 0.0, 3.4)).progress
    assert seen > 0.5
    lost = [message.progress for message in told(live(procedure, 3.4, 20.0, is_tracked=False))]
    assert lost == sorted(lost, reverse=True)
    assert lost[-1] == 0.0
