"""A simulated person stepped by hand, and the room they stand in."""

import math
from collections.abc import Callable
from typing import Literal

import numpy as np

from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    NS_PER_S,
    BodyMeasures,
    Cursor,
    Environment,
    Feedback,
    ImuSample,
    Lamp,
    LampColor,
    PointingRay,
    Strip,
    TrackedObject,
    TrackedObjects,
    UserPose,
    UserProfile,
)
from pointit.services.led_driver.config import LedDriverConfig
from pointit.services.led_driver.light_state import LightState
from pointit.services.pui.cursor import PersonCursor
from pointit.services.pui.surfaces import Surfaces
from pointit.services.user_sim.config import (
    AimConfig,
    ArmConfig,
    DecisionConfig,
    UserSimConfig,
    WristbandConfig,
)
from pointit.services.user_sim.person import SimulatedPerson
from pointit.sim.aim import Stance
from tests.support import there

PERIOD_NS = NS_PER_S // 50
ROOM = Environment(
    stamp_ns=0,
    name="test",
    lamps=(
        Lamp(id="led_1", position_m=(1.699, -2.609, 0.85)),
        Lamp(id="led_2", position_m=(0.8, -1.0, 0.15)),
    ),
    strips=(Strip(id="0", line_m=((4.85, -1.425, 0.9), (4.85, 3.575, 0.9)), pixels=150, direction=-1),),
)
Cue = Literal["started", "stopped", "target", "localized", "refused", "selected", "deselected"]
State = Literal["idle", "localizing", "pointing"]
PRECISE = UserSimConfig(
    arm=ArmConfig(hold_yaw_sd_deg=0.0, hold_pitch_sd_deg=0.0, tremor_rms_deg=0.0, reach_spread=0.0),
    aim=AimConfig(skill=1.0, correction_spread=0.0, content_deg=0.0),
    mind=DecisionConfig(search_base_s=0.0, search_per_item_s=0.0, decide_per_bit_s=0.0),
    wristband=WristbandConfig(yaw_rate_bias_sd_degps=0.0, yaw_rate_walk_sd_degps=0.0, noise_sd_deg=0.0),
    yaw_deg=0.0,
)


class Life:
    """A person stepped in virtual time, with what they have sent."""

    def __init__(self, config: UserSimConfig, seed: int = 1) -> None:
        self.now_ns = 0
        self.person = SimulatedPerson(config, "anna", np.random.default_rng(seed))
        self.presses: list[int] = []
        self.doubles: list[int] = []
        self.last: ImuSample | None = None
        self.before_step: Callable[[], None] = lambda: None
        self.position_m = config.position_m
        self.off_rad = 0.0
        self.eyes_m = Stance(BodyMeasures(), position_m=config.position_m).eyes_m
        self.person.see(0, ROOM)
        self.lights: LightState | None = None
        self.is_told = True
        """Whether cues say that they point past everything."""

    def cue(self, cue: Cue, text: str = "", target: str = "") -> None:
        waits = "wait" in text.lower()
        feedback = Feedback(stamp_ns=self.now_ns, cue=cue, text=text, target_id=target, waits=waits)
        self.person.see(self.now_ns, feedback)

    def state(self, state: State) -> None:
        text = "Wait for a target to point at." if state == "localizing" else ""
        self.cue("stopped" if state == "idle" else "started", text)

    def shine(self, lamp: str, *, blue: int = 255) -> None:
        self.person.see(self.now_ns, LampColor(stamp_ns=0, color=(0, 0, blue)), lamp)

    def objects(self, *things: TrackedObject) -> None:
        tracked = TrackedObjects(stamp_ns=self.now_ns, objects=things)
        self.person.see(self.now_ns, tracked)
        if self.lights is not None:
            self.lights.content.set_objects("t", tracked, self.now_ns)

    def run(self, duration_s: float) -> ImuSample:
        sample = None
        for _ in range(round(duration_s * 50)):
            self.now_ns += PERIOD_NS
            self.before_step()
            sample, press = self.person.step(self.now_ns)
            if sample is not None and self.lights is not None:
                self._shine(self.lights, sample)
            if press is not None:
                assert press.source == "simulated"
                (self.presses if press.gesture == "press" else self.doubles).append(self.now_ns)
            self.last = sample
        assert sample is not None
        return sample

    def light(self, *, off_rad: float = 0.0, profile: UserProfile | None = None) -> LightState:
        """Switch the strips on; the system believes the person turned by `off_rad`."""
        known = profile or UserProfile(stamp_ns=0)
        self.lights = LightState(LedDriverConfig())
        self.lights.on_map(ROOM)
        self.lights.content.set_profile("anna", known)
        self.person.see(self.now_ns, known)
        self.off_rad = off_rad
        self.pui = PersonCursor(Surfaces(ROOM, ["strip"]))
        self.cursors: list[Cursor] = []
        self.past: list[Feedback] = []
        """Cues that they point past everything."""
        return self.lights

    def yield_for(self, duration_s: float, ray: Callable[[int], Vec3] | None = None) -> None:
        """Live on while somebody else moves the wrist, along `ray`, {H}, at a time, if it is lit."""
        for _ in range(round(duration_s * 50)):
            self.now_ns += PERIOD_NS
            self.before_step()
            assert self.person.step(self.now_ns, yields=True) == (None, None)
            if self.lights is not None and ray is not None:
                self._shine_along(self.lights, self.now_ns, ray(self.now_ns))

    def _shine(self, lights: LightState, sample: ImuSample) -> None:
        self._shine_along(lights, sample.stamp_ns, self.ray(sample))

    def _shine_along(self, lights: LightState, stamp_ns: int, direction: Vec3) -> None:
        self.pui.set_pose(UserPose(stamp_ns=stamp_ns, position_m=self.position_m, yaw_rad=self.off_rad))
        origin = vector.subtract(self.eyes_m, self.position_m)
        ray = PointingRay(stamp_ns=stamp_ns, origin_m=origin, direction=direction)
        cursor = self.pui.cursor(ray)
        if cursor is not None:
            self.cursors.append(cursor)
            lights.on_cursor("anna", cursor, self.now_ns)
            past = self.pui.cue() if self.is_told else None
            if past is not None:
                self.past.append(past)
                self.person.see(self.now_ns, past)
        self.person.see(self.now_ns, there(lights.frame(self.now_ns)))

    def ray(self, sample: ImuSample) -> Vec3:
        """Return the direction from the eyes over the finger in {H}, for a body as it usually is."""
        body = BodyMeasures()
        arm_m = body.shoulder_to_wrist_m + body.wrist_to_finger_m
        finger = rotation.rotate(sample.orientation_xyzw, (arm_m, 0.0, 0.0))
        return vector.normalized(vector.subtract(finger, (0.0, 0.0, body.neck_to_eyes_m)))

    def error(self, sample: ImuSample, point: Vec3) -> tuple[float, float]:
        """Return ray less target in degrees: to the left, upwards."""
        ray = self.ray(sample)
        sight = vector.subtract(point, self.eyes_m)
        azimuth = vector.wrap(vector.azimuth(ray) - vector.azimuth(sight))
        return math.degrees(azimuth), math.degrees(vector.elevation(ray) - vector.elevation(sight))

    def error_rad(self, sample: ImuSample, point: Vec3) -> float:
        return vector.angle_between(self.ray(sample), vector.subtract(point, self.eyes_m))


def thing(name: str, kind: str, along_m: float, speed_mps: float = 0.0) -> TrackedObject:
    return TrackedObject(
        id=name,
        kind=kind,
        position_m=(4.85, -1.425 + along_m, 0.9),
        velocity_mps=(0.0, speed_mps, 0.0),
        length_m=0.3,
        surface="strip",
        surface_id="0",
        surface_position_m=along_m,
        surface_speed_mps=speed_mps,
    )


def living(state: State, *things: TrackedObject, **changes: object) -> Life:
    life = Life(PRECISE.model_copy(update=changes))
    if things:
        life.before_step = lambda: life.objects(*things)
    life.state(state)
    return life
