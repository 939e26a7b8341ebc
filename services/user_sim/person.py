"""The simulated person: looks, decides, reaches, corrects by the cursor, presses the button."""

import math
from collections.abc import Callable

import numpy as np

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, ButtonEvent, ImuSample, Message
from pointit.services.user_sim.behaviour import Behaviour, asked_goal, make_behaviour
from pointit.services.user_sim.body import Arm, OpenLoopError, StandingPosition
from pointit.services.user_sim.config import UserSimConfig
from pointit.services.user_sim.correction import Correction
from pointit.services.user_sim.goal import REST, ButtonModel, PersonGoal
from pointit.services.user_sim.perception import Perception
from pointit.services.user_sim.selecting import DecisionTimes
from pointit.services.user_sim.sight import Sight
from pointit.services.user_sim.wristband import Wristband
from pointit.sim.aim import Aim, Stance

RATE_STEP_NS = 10_000_000
"""Time step of the estimate of an aim's rate, ns."""


class SimulatedPerson:
    """One simulated person with their wristband. Step it at the band's rate."""

    def __init__(
        self,
        config: UserSimConfig,
        user: str,
        rng: np.random.Generator,
        new_behaviour: Callable[[], Behaviour | None] = lambda: None,
    ) -> None:
        """Create. `new_behaviour` returns their behaviour while they may point, or None for `config`'s."""
        hand_rng, eye_rng, band_rng, foot_rng, decision_rng = rng.spawn(5)
        given_skill = config.aim.skill
        self.user = user
        self.skill = skill = float(decision_rng.random()) if given_skill is None else given_skill
        """Skill, 0 to 1."""
        if config.yaw_deg is None:
            yaw_rad = float(rng.uniform(-math.pi, math.pi))
        else:
            yaw_rad = math.radians(config.yaw_deg)
        self.yaw_rad = yaw_rad
        """Azimuth of {H} in {W}, unknown to the person."""
        self._config = config

        # Body
        self._standing = StandingPosition(
            config.position_m, config.stance_shift_sd_m, config.stance_shift_every_s, foot_rng
        )
        body = config.body
        self._stance = Stance(body.measures(), body.hand, config.position_m, ray_model=body.ray_model)
        self._rest_rad = math.radians(config.rest_elevation_deg)
        self._arm = Arm(Aim(yaw_rad, self._rest_rad), config.arm, hand_rng, skill)
        self._azimuth_rad = yaw_rad
        self._error = OpenLoopError(config.aim, skill, eye_rng)

        # Senses, and what is derived from them
        self._correction = Correction(config.aim, self._stance, hand_rng)
        self._sight = Sight(config.aim.visual_delay_s, config.deadline)
        self._perception = Perception(self._sight, self._correction)

        # Decisions
        times = DecisionTimes(config, skill, decision_rng)

        def new_or_usual_behaviour() -> Behaviour:
            usual_things = self._perception.things
            return new_behaviour() or make_behaviour(config, usual_things, times, decision_rng)

        self._new_behaviour = new_or_usual_behaviour
        self._behaviour = self._new_behaviour()
        self._has_yielded = False
        self._band = Wristband(yaw_rad, config.wristband, band_rng)
        self.goal: PersonGoal = REST
        """Current goal of the hand."""
        self._goal: PersonGoal = REST
        self._act_at_ns = 0
        self._button = ButtonModel(config)
        self._presses = 0
        """Number of presses so far that the behaviour has decided on."""

    @property
    def true_yaw_rad(self) -> float:
        """Return the current azimuth of {H} in {W}, with the drift of the band. No message has it."""
        return self.yaw_rad - self._band.drift_rad

    @property
    def position_m(self) -> Vec3:
        """Return the current position of the person, {W}."""
        return self._stance.position_m

    def see(self, now_ns: int, message: Message, name: str = "") -> None:
        """Show a message to the person."""
        self._sight.show(now_ns, message, name)

    def step(self, now_ns: int, *, yields: bool = False) -> tuple[ImuSample | None, ButtonEvent | None]:
        """Advance to `now_ns`. Return the wristband's sample and the button event, if any.

        With `yields`, as another client moves their wrist, the arm rests and nothing is sent. The person
        continues to see and hear the results.
        """
        # See and hear, also while another client moves the wrist
        self._sight.look(now_ns)
        if yields != self._has_yielded:
            self._has_yielded = yields
            self._behaviour = self._new_behaviour()  # otherwise that time would count
            self._presses = 0
        self._perception.update(now_ns, self.goal)

        # Move: stand elsewhere, turn to another goal, correct by the cursor
        self._stance.move(self._standing.at(now_ns))
        goal = REST if yields else self._wanted_goal(now_ns)
        self._turn_when_decided(now_ns, goal)
        correction = self._correction
        closed = self.goal.closed_loop
        if closed and correction.step(now_ns):
            aim = self._aim_with_rate(now_ns)
            self._arm.reach(now_ns, aim, self._config.aim.correction_s)
        orientation = self._arm.follow(now_ns, self._aim(now_ns))
        correction.remember(now_ns, self._arm.deviation(now_ns))

        # Send the sample, and press the button if the behaviour or the life cycle calls for it
        if yields:
            self._button.wait(now_ns)
            self._band.sample(now_ns, orientation)  # it drifts on
            return None, None
        if self._goal.presses > self._presses:
            self._presses = self._goal.presses
            return self._band.sample(now_ns, orientation), self._button.event(now_ns, self._goal.gesture)
        closed = closed and not self.goal.robot  # a robot is slow
        looks = closed and self.goal.on_line
        sees: bool | None = None
        if looks and self._sight.frame_ns is not None:
            sees = self._perception.cursor is not None
        press = self._button.step(
            now_ns,
            self._perception.perceived,
            known_ns=self._sight.profile_ns,
            off_rad=correction.off_rad if closed else 0.0,
            sees=sees,
        )
        return self._band.sample(now_ns, orientation), press

    def _wanted_goal(self, now_ns: int) -> PersonGoal:
        perceived = self._perception.perceived
        if perceived.state == "asked" and self._config.points_when_asked:
            return asked_goal(now_ns, self._sight, perceived)
        return self._behaviour.goal(now_ns, self._sight) if perceived.state == "pointing" else REST

    def _turn_when_decided(self, now_ns: int, goal: PersonGoal) -> None:
        """Update the same goal. Turn to another one only after the reaction time."""
        if goal.key != self._goal.key:
            aim = self._config.aim
            thinks_s = max(aim.reaction_s - aim.visual_delay_s, 0.0)  # the delay has passed with the sight
            self._act_at_ns = now_ns + round(thinks_s * NS_PER_S)
        self._goal = goal
        if goal.key == self.goal.key:
            self.goal = goal
        elif now_ns >= self._act_at_ns:
            self._turn_to(now_ns, goal)

    def _turn_to(self, now_ns: int, goal: PersonGoal) -> None:
        self._correction.settle(self.goal, goal)
        self.goal = goal
        amplitude_rad = self._arm.amplitude_rad(now_ns, self._aim_with_rate(now_ns))
        self._error.draw(amplitude_rad)
        aim = self._aim_with_rate(now_ns)
        self._arm.start_hold()
        duration_s = self._arm.reach_s(amplitude_rad, with_cursor=goal.closed_loop)
        self._arm.reach(now_ns, aim, duration_s)
        self._correction.begin(self._arm.reached_ns)

    def _aim(self, now_ns: int) -> Aim:
        point = self.goal.point_at(now_ns)
        if point is None:
            return Aim(self._azimuth_rad, self._rest_rad)
        error = self._error.now_rad
        correction = self._correction.now_rad
        beside = (error[0] + correction[0], error[1] + correction[1])
        self._azimuth_rad, elevation_rad = self._stance.aim_at(point, beside)
        return Aim(self._azimuth_rad, elevation_rad)

    def _aim_with_rate(self, now_ns: int) -> Aim:
        aim = self._aim(now_ns)
        later = self._aim(now_ns + RATE_STEP_NS)
        step_s = RATE_STEP_NS / NS_PER_S
        azimuth_rate_radps = vector.wrap(later.azimuth_rad - aim.azimuth_rad) / step_s
        elevation_rate_radps = (later.elevation_rad - aim.elevation_rad) / step_s
        return Aim(aim.azimuth_rad, aim.elevation_rad, azimuth_rate_radps, elevation_rate_radps)
