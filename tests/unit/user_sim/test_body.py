"""Bodies of simulated people, and robots that they steer."""

import math
from typing import Any

import numpy as np
import pytest

from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Feedback, RobotState
from pointit.schemas.cues import SIGNS, Cue
from pointit.services.user_sim.body import Arm, PosturalNoise, StandingPosition
from pointit.services.user_sim.config import ArmConfig, UserSimConfig, WristbandConfig
from pointit.services.user_sim.goal import REST, PersonGoal
from pointit.services.user_sim.robot_user import GroundRobotUser, QuadrotorUser
from pointit.services.user_sim.selecting import DecisionTimes
from pointit.services.user_sim.sight import Sight
from pointit.services.user_sim.wristband import Wristband
from pointit.sim.aim import Aim
from tests.unit.user_sim.life import ROOM, living

STILL = ArmConfig(hold_yaw_sd_deg=0.0, hold_pitch_sd_deg=0.0, tremor_rms_deg=0.0, reach_spread=0.0)


def arm(config: ArmConfig = STILL) -> Arm:
    return Arm(Aim(0.0, 0.0), config, np.random.default_rng(1))


def direction(moving: Arm, now_s: float, aim: Aim) -> vector.Vec3:
    return rotation.rotate(moving.follow(round(now_s * NS_PER_S), aim), (1.0, 0.0, 0.0))


def test_reach_has_the_measured_duration_and_peak_speed() -> None:
    moving = arm()
    aim = Aim(math.radians(39.0), 0.0)
    duration_s = moving.reach_s(math.radians(39.0))
    assert duration_s == pytest.approx(0.74, abs=0.02)
    moving.reach(0, aim, duration_s)
    times_s = np.arange(0.0, duration_s, 0.001)
    angles_deg = np.degrees([vector.azimuth(direction(moving, t, aim)) for t in times_s])
    assert angles_deg[0] == pytest.approx(0.0, abs=1e-9)
    assert np.diff(angles_deg).max() / 0.001 == pytest.approx(102.0, abs=5.0)
    assert math.degrees(vector.azimuth(direction(moving, duration_s, aim))) == pytest.approx(39.0)


def test_speed_of_the_arm_is_continuous_when_the_aim_changes() -> None:
    moving = arm()
    first = Aim(1.0, 0.2)
    moving.reach(0, first, 0.8)
    step_s = 1e-4
    before = [direction(moving, t, first) for t in (0.4 - step_s, 0.4)]
    # the new aim runs away at 0.5 rad/s
    second = Aim(-0.5, -0.3, 0.5, 0.0)
    moving.reach(round(0.4 * NS_PER_S), second, 0.8)
    after = [direction(moving, 0.4 + t, Aim(-0.5 + 0.5 * t, -0.3, 0.5, 0.0)) for t in (0.0, step_s)]
    assert vector.angle_between(before[1], after[0]) < 1e-7
    for pair in zip(vector.subtract(before[1], before[0]), vector.subtract(after[1], after[0]), strict=True):
        assert pair[0] / step_s == pytest.approx(pair[1] / step_s, abs=0.02)
    end = Aim(-0.5 + 0.5 * 0.8, -0.3, 0.5, 0.0)
    assert vector.azimuth(direction(moving, 1.2, end)) == pytest.approx(end.azimuth_rad)


@pytest.mark.parametrize("rate_hz", [25.0, 50.0, 200.0])
def test_unrest_is_as_measured_whatever_the_rate(rate_hz: float) -> None:
    config = ArmConfig(tremor_rms_deg=0.0)
    unrest = PosturalNoise(config, np.random.default_rng(3))
    samples = np.degrees([unrest.at(round(i / rate_hz * NS_PER_S)) for i in range(int(400 * rate_hz))])
    assert samples.std(axis=0) == pytest.approx([0.25, 0.16], rel=0.1)
    lag = round(0.3 * rate_hz)
    for axis in samples.T:  # of two poles, 0.3 and 0.1 s
        assert np.corrcoef(axis[:-lag], axis[lag:])[0, 1] == pytest.approx(0.53, abs=0.1)


def test_tremor_lies_between_6_and_12_hz() -> None:
    config = ArmConfig(hold_yaw_sd_deg=0.0, hold_pitch_sd_deg=0.0)
    unrest = PosturalNoise(config, np.random.default_rng(3))
    samples = np.degrees([unrest.at(i * NS_PER_S // 100) for i in range(6000)])[:, 0]
    assert samples.std() == pytest.approx(0.05, rel=0.15)
    power = np.abs(np.fft.rfft(samples)) ** 2
    frequencies = np.fft.rfftfreq(len(samples), 0.01)
    inside = power[(frequencies > 5.9) & (frequencies < 12.1)].sum() / power.sum()
    assert inside > 0.95


IDEAL = WristbandConfig(yaw_rate_bias_sd_degps=0.0, yaw_rate_walk_sd_degps=0.0, noise_sd_deg=0.0)
PERIOD_NS = NS_PER_S // 50


def band(config: WristbandConfig, yaw_rad: float = 0.0, seed: int = 1) -> Wristband:
    return Wristband(yaw_rad, config, np.random.default_rng(seed))


def test_orientation_is_given_in_the_persons_frame() -> None:
    # an arm that points along the IMU's yaw origin, azimuth 1 rad in the room, reads yaw 0
    sample = band(IDEAL, yaw_rad=1.0).sample(5, rotation.from_azimuth_elevation(1.0, 0.3))
    assert sample is not None
    arm = rotation.rotate(sample.orientation_xyzw, (1.0, 0.0, 0.0))
    assert vector.azimuth(arm) == pytest.approx(0.0)
    assert vector.elevation(arm) == pytest.approx(0.3)
    assert sample.stamp_ns == 5


@pytest.mark.parametrize("given_degpmin", [-30.0, 0.0, 24.0])
def test_configured_drift_is_that_of_the_band(given_degpmin: float) -> None:
    real = WristbandConfig(yaw_rate_bias_sd_degps=0.25, yaw_drift_degpmin=given_degpmin)
    exact = real.model_copy(update={"yaw_rate_walk_sd_degps": 0.0})
    for seed in range(3):
        wrist = band(exact, seed=seed)
        wrist.sample(0, rotation.IDENTITY)
        wrist.sample(60 * NS_PER_S, rotation.IDENTITY)
        assert math.degrees(wrist.drift_rad) == pytest.approx(given_degpmin)
    walking = [band(real, seed=seed) for seed in range(20)]
    for wrist in walking:
        for second in range(61):
            wrist.sample(second * NS_PER_S, rotation.IDENTITY)
    drifts = np.degrees([wrist.drift_rad for wrist in walking])
    assert drifts.std() > 0.1  # the rate still wanders
    assert drifts.mean() == pytest.approx(given_degpmin, abs=1.0)


def test_silence_comes_in_bursts_of_the_given_share() -> None:
    lossy = IDEAL.model_copy(update={"dropout_share": 0.05, "dropout_burst_s": 0.15})
    wrist = band(lossy)
    lost = np.array([wrist.sample(i * PERIOD_NS, rotation.IDENTITY) is None for i in range(50_000)])
    assert lost.mean() == pytest.approx(0.05, rel=0.2)
    bursts = int((np.diff(lost.astype(int)) == 1).sum())
    assert lost.sum() / bursts * 0.02 == pytest.approx(0.15, rel=0.3)


def test_lost_samples_leave_a_gap_in_seq_and_device_time() -> None:
    lossy = IDEAL.model_copy(update={"dropout_share": 0.3, "clock_skew_ppm": 100.0})
    wrist = band(lossy)
    samples = [wrist.sample(i * PERIOD_NS, rotation.IDENTITY) for i in range(500)]
    kept = [s for s in samples if s is not None]
    assert [s.seq for s in kept] == [i + 1 for i, s in enumerate(samples) if s is not None]
    first = kept[0]
    last = kept[-1]
    assert first.device_time_ns is not None
    assert last.device_time_ns is not None
    ratio = (last.device_time_ns - first.device_time_ns) / (last.stamp_ns - first.stamp_ns)
    assert ratio == pytest.approx(1.0001, abs=1e-8)


PLACE: Vec3 = (2.0, 0.5, 0.1)


def walk(
    sd_m: float, every_s: float, duration_s: float = 2000.0
) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    feet = StandingPosition(PLACE, sd_m, every_s, np.random.default_rng(1))
    return np.array([feet.at(7 + i * PERIOD_NS) for i in range(round(duration_s * 50))])


def test_standing_position_has_the_configured_spread_and_rate() -> None:
    spots = walk(0.05, 4.0)
    assert spots[0] == pytest.approx(PLACE)
    assert spots.mean(axis=0) == pytest.approx(PLACE, abs=0.01)
    assert spots[:, :2].std(axis=0) == pytest.approx([0.05, 0.05], rel=0.2)
    assert np.ptp(spots[:, 2]) == 0.0
    moves = np.abs(np.diff(spots[:, 0])) > 1e-9
    begins = int((np.diff(moves.astype(int)) == 1).sum())
    assert begins == pytest.approx(2000.0 / 5.0, rel=0.15)  # 4 s and the second that a step takes


def test_arm_points_from_the_present_standing_position() -> None:
    life = living("localizing", stance_shift_sd_m=0.3, stance_shift_every_s=2.0)
    life.cue("target", target="led_2")
    life.run(3.0)
    errors = [life.error_rad(life.run(0.5), ROOM.lamps[1].position_m) for _ in range(40)]
    assert np.degrees(np.ptp(errors)) > 1.0  # `life` reckons from the place itself


SPOTS: tuple[Vec3, ...] = ((2.0, 1.0, 0.0), (3.0, 1.0, 0.0), (4.0, 1.0, 0.0))


class Carol:
    """Her eyes have no delay, and her thumb does what she decides."""

    def __init__(self, behaviour: type[QuadrotorUser] | type[GroundRobotUser], **settings: Any) -> None:
        config = UserSimConfig.model_validate(settings)
        self.mind = behaviour(SPOTS, DecisionTimes(config, 0.0, np.random.default_rng(1)))
        self.sight = Sight(0.0)
        self.now_ns = 0
        self.goal: PersonGoal = REST
        self.robots: dict[str, dict[str, Any]] = {
            "quad": {"kind": "quadrotor", "phase": "landed", "position_m": (1.0, 2.0, 0.0)},
            "rover": {"kind": "ground", "phase": "idle", "position_m": (2.0, 2.0, 0.0)},
        }

    def wait(self, lasting_s: float) -> "Carol":
        for _ in range(round(lasting_s * 50)):
            self.now_ns += PERIOD_NS
            for name, fields in self.robots.items():
                usual = {"yaw_rad": 0.0, "velocity_mps": (0.0, 0.0, 0.0), "radius_m": 0.2}
                self.sight.show(
                    self.now_ns, RobotState.model_validate(usual | fields | {"stamp_ns": self.now_ns}), name
                )
            self.sight.look(self.now_ns)
            self.goal = self.mind.goal(self.now_ns, self.sight)
        return self

    def hear(self, cue: Cue, text: str = "", sign_of: Cue | None = None) -> "Carol":
        sign = SIGNS[sign_of or cue]
        self.sight.show(
            self.now_ns, Feedback(stamp_ns=self.now_ns, cue=cue, text=text, chime=sign.chime), "carol"
        )
        return self.wait(0.02)

    def without(self, name: str) -> "Carol":
        del self.robots[name]
        return self


def test_robot_user_aims_at_their_kind_and_presses_once() -> None:
    carol = Carol(QuadrotorUser).wait(0.5)
    assert (carol.goal.point_m, carol.goal.closed_loop, carol.goal.presses) == ((1.0, 2.0, 0.0), False, 0)
    assert carol.wait(3.0).goal.presses == 1
    assert Carol(GroundRobotUser).wait(0.5).goal.point_m == (2.0, 2.0, 0.0)


def test_quadrotor_user_lands_on_one_spot_after_another() -> None:
    carol = Carol(QuadrotorUser).wait(3.0).hear("selected").wait(1.0)
    assert (carol.goal.point_m, carol.goal.closed_loop, carol.goal.robot) == (SPOTS[0], True, "quad")
    assert carol.wait(10.0).goal.presses == 1
    carol.robots["quad"]["position_m"] = (2.05, 1.0, 0.2)
    assert carol.wait(1.0).goal.presses == 2
    carol.hear("selected").hear("selected", sign_of="localized").wait(0.5)
    assert carol.goal.point_m == (2.05, 1.0, 0.2)  # the quad, which she takes again
    carol.wait(3.0).hear("selected").wait(0.5)
    assert carol.goal.point_m == SPOTS[1]


def test_refusing_robot_is_paused_and_an_unclear_one_retried() -> None:
    carol = Carol(QuadrotorUser).wait(3.0).hear("refused", "quad is steered by anna").wait(1.0)
    assert carol.goal == REST
    assert carol.wait(5.0).goal.point_m == (1.0, 2.0, 0.0)
    dora = (
        Carol(QuadrotorUser)
        .wait(3.0)
        .hear("refused", "two robots may be meant: point longer at one")
        .wait(1.0)
    )
    assert dora.goal.point_m == (1.0, 2.0, 0.0)
    assert dora.hear("selected").wait(0.1).goal.point_m == SPOTS[0]


def test_ground_robot_user_sends_along_two_way_points_each() -> None:
    carol = Carol(GroundRobotUser).wait(3.0).hear("selected").wait(1.0)
    assert (carol.goal.point_m, carol.goal.robot, carol.goal.closed_loop) == (SPOTS[0], "", True)
    assert carol.hear("selected").wait(1.0).goal.point_m == SPOTS[1]
    assert carol.goal.presses == 1
    assert carol.hear("selected").wait(1.5).goal.presses == 2
    carol.hear("selected").wait(5.0)
    assert (carol.goal.point_m, carol.goal.presses) == (SPOTS[1], 2)
    assert carol.hear("selected", sign_of="localized").wait(0.5).goal.point_m == SPOTS[2]


def test_steering_continues_after_pointing_at_a_lamp() -> None:
    carol = Carol(GroundRobotUser)
    carol.now_ns = 60 * NS_PER_S
    carol.wait(3.0).hear("selected").wait(2.5)
    carol.hear("refused", "the place is sure to 0.6 m only: choose one nearer to you, or localize again")
    assert carol.goal.gesture == "double"
    carol.now_ns += 5 * NS_PER_S
    carol.wait(3.0).hear("refused", "rover has no way-point yet: stay at a place for 1 s, then press")
    assert carol.wait(0.1).goal.closed_loop


@pytest.mark.parametrize("waits", [False, True])
def test_robot_is_left_to_others_after_a_turn(waits: bool) -> None:
    carol = Carol(GroundRobotUser).wait(3.0)
    if waits:
        carol.hear("refused", "rover is steered by anna").wait(8.0)
    carol.hear("selected")
    for _ in range(2):
        carol.wait(1.0).hear("selected").hear("selected").wait(1.5)
        carol.hear("selected", sign_of="localized")
    assert carol.goal.gesture == "hold"
    assert carol.wait(9.0).goal == REST
    assert (carol.wait(2.0).goal == REST) == waits
    assert carol.wait(50.0).goal != REST


def test_quadrotor_user_aims_anew_when_pointing_past_everything() -> None:
    carol = Carol(QuadrotorUser).wait(3.0).hear("selected").wait(1.0)
    before = carol.goal
    assert carol.hear("refused", "quad: carol points past everything").wait(0.1).goal.key != before.key
    assert carol.goal.point_m == before.point_m


@pytest.mark.parametrize("behaviour", [QuadrotorUser, GroundRobotUser])
def test_choice_of_a_robot_restarts_after_a_loss_or_pause(
    behaviour: type[QuadrotorUser] | type[GroundRobotUser],
) -> None:
    carol = Carol(behaviour).wait(3.0).hear("selected").wait(1.0).hear("deselected").wait(0.1)
    assert not carol.goal.closed_loop
    carol.wait(3.0).hear("selected").wait(1.0)
    assert carol.goal.closed_loop
    carol.now_ns += 5 * NS_PER_S
    assert not carol.wait(0.1).goal.closed_loop
    for name in ("quad", "rover"):
        carol.without(name)
    assert carol.wait(3.0).goal == REST
