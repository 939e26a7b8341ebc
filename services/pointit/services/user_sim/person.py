"""The person: looks, decides, reaches, corrects by the cursor, presses the button."""

import math

import numpy as np

from pointit.geometry import vector
from pointit.schemas import NS_PER_S, ButtonEvent, ImuSample, Message
from pointit.services.user_sim.aim import Aim, Stance
from pointit.services.user_sim.arm import Arm
from pointit.services.user_sim.behaviour import REST, Goal, localizing_goal, wish_of
from pointit.services.user_sim.config import UserSimConfig
from pointit.services.user_sim.correction import Correction
from pointit.services.user_sim.error import OpenLoopError
from pointit.services.user_sim.sight import Sight
from pointit.services.user_sim.wristband import Wristband

RATE_STEP_NS = 10_000_000
"""Over which an aim's rate is measured."""


class Person:
    """One simulated person with their wristband; step it at the band's rate."""

    def __init__(self, config: UserSimConfig, user: str, rng: np.random.Generator) -> None:
        """Be born; everything random comes from `rng`."""
        hand_rng, eye_rng, band_rng = rng.spawn(3)
        self.yaw_rad = yaw_rad = (
            float(rng.uniform(-math.pi, math.pi)) if config.yaw_deg is None else math.radians(config.yaw_deg)
        )
        """Azimuth of {H} in {W}; the person does not know it either."""
        self._config = config
        self._stance = Stance(config.body.measures(), config.body.hand, config.position_m, yaw_rad)
        self._rest_rad = math.radians(config.rest_elevation_deg)
        self._arm = Arm(Aim(yaw_rad, self._rest_rad), config.arm, hand_rng)
        self._azimuth_rad = yaw_rad
        self._error = OpenLoopError(config.aim, eye_rng)
        self._correction = Correction(config.aim, self._stance)
        self._sight = Sight(config.aim.visual_delay_s)
        self._wish = wish_of(config, user)
        self._band = Wristband(yaw_rad, config.wristband, band_rng)
        self._goal: Goal = REST
        self._wanted: Goal = REST
        self._act_at_ns = 0
        self._pressed_ns: int | None = None
        self._presses = 0

    @property
    def goal(self) -> Goal:
        """Return what the hand is after."""
        return self._goal

    def see(self, now_ns: int, message: Message, name: str = "") -> None:
        """Put a message before the person's eyes."""
        self._sight.show(now_ns, message, name)

    def step(self, now_ns: int) -> tuple[ImuSample | None, ButtonEvent | None]:
        """Live up to `now_ns`; return what the wristband sends and the button, if pressed."""
        self._sight.look(now_ns)
        self._decide(now_ns)
        if self._goal.closed_loop:
            self._correct(now_ns)
        orientation = self._arm.follow(now_ns, self._aim(now_ns))
        self._correction.remember(now_ns, self._arm.deviation(now_ns))
        return self._band.sample(now_ns, orientation), self._press(now_ns)

    def _decide(self, now_ns: int) -> None:
        """Follow the same goal on; turn to another one only after the reaction time."""
        state = self._sight.interaction.state if self._sight.interaction is not None else "idle"
        wanted = REST
        if state == "pointing":
            wanted = self._wish.goal(now_ns, self._sight)
        elif state == "localizing":
            wanted = localizing_goal(now_ns, self._sight)
        if wanted.key != self._wanted.key:
            aim = self._config.aim
            thinks_s = max(aim.reaction_s - aim.visual_delay_s, 0.0)  # the delay has passed with the sight
            self._act_at_ns = now_ns + round(thinks_s * NS_PER_S)
        self._wanted = wanted
        if wanted.key == self._goal.key:
            self._goal = wanted
        elif now_ns >= self._act_at_ns:
            self._turn_to(now_ns, wanted)

    def _turn_to(self, now_ns: int, goal: Goal) -> None:
        self._goal = goal
        self._correction.settle()
        amplitude_rad = self._arm.amplitude_rad(now_ns, self._aim_with_rate(now_ns))
        self._error.draw(amplitude_rad)
        aim = self._aim_with_rate(now_ns)
        self._arm.reach(now_ns, aim, self._arm.reach_s(amplitude_rad))
        self._correction.begin(self._arm.reached_ns)

    def _correct(self, now_ns: int) -> None:
        """Look where the cursor is and move again, if it is time to."""
        if self._correction.step(now_ns, self._goal, self._sight.cursors):
            self._arm.reach(now_ns, self._aim_with_rate(now_ns), self._config.aim.correction_s)

    def _aim(self, now_ns: int) -> Aim:
        point = self._goal.point_at(now_ns)
        if point is None:
            return Aim(self._azimuth_rad, self._rest_rad)
        self._azimuth_rad, elevation_rad = self._stance.aim_at(point)
        aim = Aim(self._azimuth_rad, elevation_rad)
        return aim.turned(*self._error.now_rad).turned(*self._correction.now_rad)

    def _aim_with_rate(self, now_ns: int) -> Aim:
        aim, later = self._aim(now_ns), self._aim(now_ns + RATE_STEP_NS)
        step_s = RATE_STEP_NS / NS_PER_S
        return Aim(
            aim.azimuth_rad,
            aim.elevation_rad,
            vector.wrap(later.azimuth_rad - aim.azimuth_rad) / step_s,
            (later.elevation_rad - aim.elevation_rad) / step_s,
        )

    def _press(self, now_ns: int) -> ButtonEvent | None:
        interaction = self._sight.interaction
        if interaction is None or interaction.state != "idle":
            return None
        ready_ns = self._sight.interaction_since_ns + round(self._config.think_s * NS_PER_S)
        if self._pressed_ns is not None:
            ready_ns = max(ready_ns, self._pressed_ns + round(self._config.press_pause_s * NS_PER_S))
        if now_ns < ready_ns:
            return None
        self._pressed_ns = now_ns
        self._presses += 1
        return ButtonEvent(stamp_ns=now_ns, seq=self._presses, source="simulated")
