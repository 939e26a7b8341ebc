"""Parameters of the simulated person. The defaults are measured values (pointing.md §3, §7)."""

from typing import Literal

from pydantic import Field

from pointit.runtime.config.config import Config
from pointit.schemas import BodyMeasures
from pointit.schemas.base import Vec3
from pointit.schemas.person import RayModel

Behaviour = Literal["rest", "lamps", "strips", "select", "send", "fly", "drive"]
"""Behaviour of the person while they may point."""


class SimulatedBodyConfig(Config):
    """The person's true measures. The profile should equal them, or it is wrong."""

    footprint_to_neck_m: float = Field(default=1.43, gt=0, lt=3, description="floor to neck, m")
    neck_to_eyes_m: float = Field(default=0.21, ge=0, lt=1, description="neck to eyes, m")
    neck_to_shoulder_m: float = Field(default=0.0, ge=0, lt=1, description="neck to the shoulder's side, m")
    shoulder_to_wrist_m: float = Field(default=0.55, gt=0, lt=2, description="shoulder to wrist, m")
    wrist_to_finger_m: float = Field(default=0.18, ge=0, lt=1, description="wrist to fingertip, m")
    hand: Literal["left", "right"] = Field(default="right", description="the hand that points")
    ray_model: RayModel = Field(
        default="eye_finger",
        description="method of aiming: finger before the eyes, straight arm at the thing itself, or "
        "forearm with the upper arm hanging; the profile should be the same, or it is wrong",
    )

    def measures(self) -> BodyMeasures:
        """Return them as in the contract."""
        return BodyMeasures(**self.model_dump(exclude={"hand", "ray_model"}))


class ArmConfig(Config):
    """Movement and steadiness of the arm."""

    reach_base_s: float = Field(default=0.25, gt=0, le=2, description="duration of the smallest reach, s")
    reach_per_bit_s: float = Field(
        default=0.156, ge=0, le=2, description="additional time per bit of log2(amplitude/width + 1), s"
    )
    reach_width_deg: float = Field(default=5.0, gt=0, le=90, description="width in that logarithm, deg")
    reach_spread: float = Field(
        default=0.2, ge=0, le=1, description="log-normal spread of the duration, a share"
    )
    reach_with_cursor: float = Field(
        default=1.55,
        ge=1,
        le=3,
        description="factor on the duration of a reach with a cursor (1.15 s instead of 0.74 s)",
    )
    hold_yaw_sd_deg: float = Field(default=0.25, ge=0, le=20, description="noise while holding, yaw, sd, deg")
    hold_pitch_sd_deg: float = Field(
        default=0.16, ge=0, le=20, description="noise while holding, pitch, sd, deg"
    )
    hold_spread: float = Field(
        default=0.9,
        ge=0,
        le=2,
        description="log-normal spread of that noise from hold to hold (p90: yaw 1.07, pitch 0.37 deg)",
    )
    hold_correlation_s: float = Field(
        default=0.3, gt=0, le=10, description="correlation time of that noise, s"
    )
    tremor_rms_deg: float = Field(default=0.05, ge=0, le=5, description="tremor of 6 to 12 Hz, rms, deg")


class AimConfig(Config):
    """Perception, errors and corrections of the person."""

    visual_delay_s: float = Field(default=0.2, ge=0, le=2, description="delay of perception, s")
    reaction_s: float = Field(
        default=0.35, ge=0, le=3, description="delay from light to hand, including the visual delay, s"
    )
    skill: float | None = Field(
        default=0.0,
        ge=0,
        le=1,
        description="0: untrained people's errors without feedback; 1: no errors, a third faster to find "
        "things, half the noise and no lapses; random for each person if empty",
    )
    elevation_bias_deg: float | None = Field(
        default=None,
        ge=-45,
        le=45,
        description="this person's elevation error at any skill, positive: too high, deg; random if empty",
    )
    azimuth_error_reach_sd_deg: float = Field(
        default=5.0, ge=0, le=30, description="azimuth error without feedback from reach to reach, sd, deg"
    )
    bent_arm_share: float = Field(
        default=0.05, ge=0, le=1, description="share of reaches with a bent arm: 5 to 10 deg off"
    )
    correction_period_s: float = Field(
        default=0.35, gt=0, le=5, description="time between corrections towards the visible cursor, s"
    )
    correction_s: float = Field(default=0.25, gt=0, le=2, description="duration of a correction, s")
    content_deg: float = Field(
        default=0.7,
        ge=0,
        le=10,
        description="smallest error that is corrected (with a cursor people end 0.7 deg off, median), deg",
    )
    correction_spread: float = Field(
        default=0.25,
        ge=0,
        le=1,
        description="spread of a correction's size, a share: errors grow with distance (Schmidt 1979)",
    )


class DecisionConfig(Config):
    """Times of finding and choosing, and lapses (`selecting.py` has the sources)."""

    search_base_s: float = Field(default=0.15, ge=0, le=5, description="base time to find the next thing, s")
    search_per_item_s: float = Field(
        default=0.03, ge=0, le=1, description="additional time per thing in view, s"
    )
    decide_per_bit_s: float = Field(
        default=0.15, ge=0, le=2, description="additional time per bit of log2(choices + 1), s"
    )
    lapse_share: float = Field(
        default=0.005,
        ge=0,
        le=1,
        description="share of wrong choices: another thing, or leaving before it is selected",
    )


class WristbandConfig(Config):
    """Errors of the IMU."""

    yaw_rate_bias_sd_degps: float = Field(
        default=0.05, ge=0, le=5, description="yaw drift, random per run, sd, deg/s; real bands: 0.25"
    )
    yaw_drift_degpmin: float | None = Field(
        default=None,
        ge=-300,
        le=300,
        description="yaw drift of this band, positive: to the left, deg/min; random if empty",
    )
    yaw_rate_walk_sd_degps: float = Field(
        default=0.002, ge=0, le=1, description="random walk of the drift, sd after 1 s, deg/s"
    )
    noise_sd_deg: float = Field(default=0.03, ge=0, le=5, description="white noise per axis, sd, deg")
    dropout_share: float = Field(
        default=0.0, ge=0, lt=1, description="share of samples lost in bursts; real radio: 0.01 to 0.05"
    )
    dropout_burst_s: float = Field(default=0.15, gt=0, le=10, description="mean length of a burst, s")
    clock_skew_ppm: float = Field(
        default=20.0, ge=-1000, le=1000, description="rate error of the band's clock, ppm"
    )


class UserSimConfig(Config):
    """A person: position, behaviour, errors."""

    seed: int | None = Field(default=0, ge=0, description="seed of all random numbers; random if empty")
    behaviour: Behaviour = Field(
        default="select",
        description="rest: nothing; lamps: one lamp after another; strips: along the strips, there and back; "
        "select: every object of a kind; send: places on the floor; fly: take a quadrotor, "
        "and land it on each of spots_m; drive: take a ground robot, and send it along them",
    )
    spots_m: tuple[Vec3, ...] = Field(
        default=(),
        description="places where robots are to land, or to go, in turn, on the floor or below 0.3 m; a "
        "quadrotor is to be steered to higher ones itself, m",
    )
    target_kinds: tuple[str, ...] = Field(default=("red",), description="kinds of objects to select")
    position_m: Vec3 = Field(default=(2.0, 0.5, 0.0), description="true position of the feet in the room, m")
    yaw_deg: float | None = Field(
        default=0.0,
        ge=-360,
        le=360,
        description="azimuth of the IMU's yaw origin in the room, deg; unknown, random if empty",
    )
    stance_shift_sd_m: float = Field(
        default=0.0, ge=0, le=2, description="distance of steps from that position per axis, sd, m"
    )
    stance_shift_every_s: float = Field(
        default=15.0, gt=0.1, le=3600, description="time between such steps, mean, s"
    )
    rate_hz: float = Field(default=50.0, ge=5, le=200, description="IMU samples per second, Hz")
    think_s: float = Field(default=1.0, ge=0, le=60, description="idle time before pressing the button, s")
    press_pause_s: float = Field(default=5.0, gt=0, le=600, description="delay before a press is repeated, s")
    points_when_asked: bool = Field(
        default=True, description="point at the lamp or robot that the localizer requests; false: ignore it"
    )
    anchor_every_s: float = Field(
        default=0.0,
        ge=0,
        le=3600,
        description="period of double presses to point at a lamp again, s; 0: never",
    )
    anchor_when_off_deg: float = Field(
        default=0.0, ge=0, le=90, description="cursor error that causes a double press, deg; 0: never"
    )
    lost_press_s: float = Field(
        default=12.0,
        ge=0,
        le=3600,
        description="time without a visible cursor while pointing that causes a press, s; 0: never",
    )
    lamp_hold_s: float = Field(
        default=2.0, gt=0, le=600, description="mean time on a lamp (behaviour lamps) or place (send), s"
    )
    deadline: dict[str, float] = Field(
        default={},
        description="by belt: arc length, m, from which it is too late to select a package; if empty, where "
        "it passes the first bay of the map, or else where the belt ends",
    )
    strip_speed_mps: float = Field(
        default=0.5, gt=0, le=5, description="speed along the strips (behaviour strips), m/s"
    )
    give_up_s: float = Field(default=5.0, gt=0, le=60, description="maximum time spent on one object, s")
    retry_s: float = Field(default=2.0, ge=0, le=60, description="time until an object is tried again, s")
    rest_elevation_deg: float = Field(
        default=-75.0, ge=-90, le=0, description="elevation of the resting arm, deg"
    )
    body: SimulatedBodyConfig = Field(default=SimulatedBodyConfig(), description="measures")
    arm: ArmConfig = Field(default=ArmConfig(), description="movement")
    aim: AimConfig = Field(default=AimConfig(), description="aiming")
    mind: DecisionConfig = Field(default=DecisionConfig(), description="finding and choosing")
    wristband: WristbandConfig = Field(default=WristbandConfig(), description="the IMU")
