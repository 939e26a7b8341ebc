"""Parameters of the simulated person; the defaults are people's own numbers (pointing.md §3, §7)."""

from typing import Literal

from pydantic import Field

from pointit.runtime.config.config import Config
from pointit.schemas import BodyMeasures
from pointit.schemas.base import Vec3

Behaviour = Literal["rest", "lamps", "strips", "select", "random", "send"]
"""What the person does once they may point."""


class BodyConfig(Config):
    """The person's true measures; the profile should say the same, or errs."""

    footprint_to_neck_m: float = Field(default=1.43, gt=0, lt=3, description="floor to neck, m")
    neck_to_eyes_m: float = Field(default=0.21, ge=0, lt=1, description="neck to eyes, m")
    neck_to_shoulder_m: float = Field(default=0.0, ge=0, lt=1, description="neck to the shoulder's side, m")
    shoulder_to_wrist_m: float = Field(default=0.55, gt=0, lt=2, description="shoulder to wrist, m")
    wrist_to_finger_m: float = Field(default=0.18, ge=0, lt=1, description="wrist to fingertip, m")
    hand: Literal["left", "right"] = Field(default="right", description="the hand that points")
    ray_model: Literal["eye_finger", "shoulder_arm", "forearm"] = Field(
        default="eye_finger",
        description="how they aim: the finger before the eyes, the straight arm at the thing itself, or the "
        "forearm with the upper arm hanging; the profile should say the same, or errs",
    )

    def measures(self) -> BodyMeasures:
        """Return them as the contract has them."""
        return BodyMeasures(**self.model_dump(exclude={"hand", "ray_model"}))


class ArmConfig(Config):
    """How the arm moves and how still it can be held."""

    reach_base_s: float = Field(default=0.25, gt=0, le=2, description="duration of the smallest reach, s")
    reach_per_bit_s: float = Field(
        default=0.156, ge=0, le=2, description="longer for each bit of log2(amplitude/width + 1), s"
    )
    reach_width_deg: float = Field(default=5.0, gt=0, le=90, description="width in that logarithm, deg")
    reach_spread: float = Field(
        default=0.2, ge=0, le=1, description="log-normal spread of the duration, a share"
    )
    reach_with_cursor: float = Field(
        default=1.55,
        ge=1,
        le=3,
        description="how many times longer a reach takes where a cursor shows (1.15 s instead of 0.74 s)",
    )
    hold_yaw_sd_deg: float = Field(default=0.25, ge=0, le=20, description="unrest while holding, yaw, deg")
    hold_pitch_sd_deg: float = Field(
        default=0.16, ge=0, le=20, description="unrest while holding, pitch, deg"
    )
    hold_spread: float = Field(
        default=0.9,
        ge=0,
        le=2,
        description="log-normal spread of that unrest from hold to hold (p90: yaw 1.07, pitch 0.37 deg)",
    )
    hold_correlation_s: float = Field(default=0.3, gt=0, le=10, description="how long unrest lasts, s")
    tremor_rms_deg: float = Field(default=0.05, ge=0, le=5, description="tremor of 6 to 12 Hz, rms, deg")


class AimConfig(Config):
    """How the person sees, errs and corrects."""

    visual_delay_s: float = Field(default=0.2, ge=0, le=2, description="from the light to the mind, s")
    reaction_s: float = Field(
        default=0.35, ge=0, le=3, description="from the light to the hand, s; contains the visual delay"
    )
    skill: float | None = Field(
        default=0.0,
        ge=0,
        le=1,
        description="0: errs without feedback as untrained people do; 1: never, is a third quicker to find "
        "things, holds half as unsteadily and has no lapses; empty: drawn for each person",
    )
    elevation_error_mean_deg: float = Field(
        default=-2.8, ge=-30, le=30, description="people point too low without feedback, mean, deg"
    )
    elevation_error_person_sd_deg: float = Field(
        default=2.8, ge=0, le=30, description="the same between people, sd, deg"
    )
    elevation_bias_deg: float | None = Field(
        default=None,
        ge=-45,
        le=45,
        description="this person's own, whatever their skill, positive: too high, deg; empty: drawn",
    )
    elevation_error_reach_sd_deg: float = Field(
        default=1.0, ge=0, le=30, description="the same from reach to reach, sd, deg"
    )
    azimuth_error_reach_sd_deg: float = Field(
        default=5.0, ge=0, le=30, description="azimuth without feedback from reach to reach, sd, deg"
    )
    bent_arm_share: float = Field(
        default=0.05, ge=0, le=1, description="share of reaches with a bent arm: 5 to 10 deg beside"
    )
    correction_period_s: float = Field(
        default=0.35, gt=0, le=5, description="time between corrections towards the visible cursor, s"
    )
    correction_gain: float = Field(
        default=0.9, ge=0, le=1.5, description="share of the seen error that is corrected"
    )
    correction_s: float = Field(default=0.25, gt=0, le=2, description="duration of a correction, s")
    content_deg: float = Field(
        default=0.7,
        ge=0,
        le=10,
        description="a smaller error is left as it is (with a cursor people end 0.7 deg beside, median), deg",
    )
    correction_spread: float = Field(
        default=0.25,
        ge=0,
        le=1,
        description="of a correction's size, a share: hands err in proportion to their way (Schmidt 1979)",
    )


class MindConfig(Config):
    """How long it takes to find and choose, how often that goes wrong (`pace.py` has the sources)."""

    check_period_s: float = Field(
        default=0.1, gt=0, le=2, description="between two looks at the strips while pointing, s"
    )
    search_base_s: float = Field(default=0.15, ge=0, le=5, description="to find the next thing at all, s")
    search_per_item_s: float = Field(
        default=0.03, ge=0, le=1, description="longer for each thing that is in view, s"
    )
    decide_per_bit_s: float = Field(
        default=0.15, ge=0, le=2, description="longer for each bit of log2(choices + 1), s"
    )
    search_spread: float = Field(
        default=0.3, ge=0, le=2, description="log-normal spread of these times, a share"
    )
    lapse_share: float = Field(
        default=0.005,
        ge=0,
        le=1,
        description="of choices that go wrong: another thing is taken, or left before it is selected",
    )


class WristbandConfig(Config):
    """How the IMU errs."""

    yaw_rate_bias_sd_degps: float = Field(
        default=0.05, ge=0, le=5, description="yaw drift, drawn once per run, sd, deg/s; real bands: 0.25"
    )
    yaw_drift_degpmin: float | None = Field(
        default=None,
        ge=-300,
        le=300,
        description="this band's own yaw drift, positive: reads ever more to the left, deg/min; empty: drawn",
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
        default=20.0, ge=-1000, le=1000, description="how fast the band's own clock is, ppm"
    )


class UserSimConfig(Config):
    """A person, where they stand, what they want."""

    seed: int | None = Field(default=0, ge=0, description="of everything random; empty: another each run")
    behaviour: Behaviour = Field(
        default="select",
        description="rest; lamps: one lamp after the other; strips: along the strips, there and back; "
        "select: every object of a kind; random: at anything",
    )
    target_kinds: tuple[str, ...] = Field(default=("red",), description="kinds of objects to select")
    position_m: Vec3 = Field(default=(2.0, 0.5, 0.0), description="where the feet truly stand in the room, m")
    yaw_deg: float | None = Field(
        default=0.0,
        ge=-360,
        le=360,
        description="azimuth of the IMU's yaw origin in the room, deg; empty: unknown, random",
    )
    stance_shift_sd_m: float = Field(
        default=0.0, ge=0, le=2, description="how far steps lead away from that place, each way, sd, m"
    )
    stance_shift_every_s: float = Field(
        default=15.0, gt=0.1, le=3600, description="time between such steps, mean, s"
    )
    rate_hz: float = Field(default=50.0, ge=5, le=200, description="IMU samples per second, Hz")
    think_s: float = Field(default=1.0, ge=0, le=60, description="idle time before pressing the button, s")
    press_pause_s: float = Field(
        default=5.0, gt=0, le=600, description="wait for a press to work before pressing again, s"
    )
    points_when_asked: bool = Field(
        default=True,
        description="point at the lamp or robot that the localizer asks for; else do not mind it",
    )
    anchor_every_s: float = Field(
        default=0.0,
        ge=0,
        le=3600,
        description="press twice, to point at a lamp anew, this often, s; 0: never",
    )
    anchor_when_off_deg: float = Field(
        default=0.0,
        ge=0,
        le=90,
        description="press twice when the cursor stays this far from where they point, deg; 0: never",
    )
    lost_press_s: float = Field(
        default=12.0,
        ge=0,
        le=3600,
        description="press when no cursor is to be seen for so long while pointing, s; 0: never",
    )
    lamp_hold_s: float = Field(
        default=2.0,
        gt=0,
        le=600,
        description="time on a lamp (behaviour lamps), thing (random) or place (send), mean, s",
    )
    deadline: dict[str, float] = Field(
        default={},
        description="by belt: where along it, m, it is too late to select a package that comes; empty: where "
        "it passes the first bay that the map has, else where its way ends",
    )
    strip_speed_mps: float = Field(
        default=0.5, gt=0, le=5, description="speed along the strips (behaviour strips), m/s"
    )
    give_up_s: float = Field(default=5.0, gt=0, le=60, description="time spent on one object at most, s")
    retry_s: float = Field(default=2.0, ge=0, le=60, description="until an object given up is tried again, s")
    rest_elevation_deg: float = Field(
        default=-75.0, ge=-90, le=0, description="elevation of the resting arm, deg"
    )
    body: BodyConfig = Field(default=BodyConfig(), description="measures")
    arm: ArmConfig = Field(default=ArmConfig(), description="movement")
    aim: AimConfig = Field(default=AimConfig(), description="aiming")
    mind: MindConfig = Field(default=MindConfig(), description="finding and choosing")
    wristband: WristbandConfig = Field(default=WristbandConfig(), description="the IMU")
