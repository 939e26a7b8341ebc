"""Steering a robot: point at it, press, then land it on a spot, or send it along spots, and so on."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Feedback, RobotKind, RobotState
from pointit.services.user_sim.goal import IN_AIR_M, REST, WAIT_S, Gesture, PersonGoal
from pointit.services.user_sim.selecting import DecisionTimes
from pointit.services.user_sim.sight import Sight

Stage = Literal["choose", "aim", "asked", "steer", "sent"]

AIM_S = 2.4
"""Usual time from turning to a robot to the press: reaction, reach, and a moment of holding, s."""
ANSWER_S = 4.0
"""Time without a cue after which the person aims and presses again, s."""
PAUSE_S = 4.0
"""Usual time for which a robot that refused is left alone, s."""
OVER_M = 0.12
"""Distance of a robot from a spot within which the person is content, m."""
CONTENT_S = 0.6
"""Time for which it stays there before the press, s."""
ENOUGH_S = 25.0
"""Time of steering to a spot after which the person presses anyway, s."""
RESULT_S = 40.0
"""Time without the result of a press after which the person starts again, s."""
WAYPOINT_S = 8.0
"""Time at a place without a cue after which the person points at the next one, s."""
PATH = 2
"""Number of spots of a path: a way-point and a goal."""
SETTLED_S = 1.5
"""Time of steering from which an uncertain place is not that of an arm that turns, s."""
TURN = 2
"""Number of paths or landings after which the person leaves the robot to others."""
TURN_PAUSE_S = 10.0
"""Time for which they leave it to others, s."""
OTHERS_TURN_S = 60.0
"""The same if they know of others who use it, s."""


class _RobotUser(ABC):
    """Takes a robot of one kind. Cues are told apart by ear: tick, double chime, buzz, tock."""

    def __init__(self, kind: RobotKind, spots_m: Sequence[Vec3], times: DecisionTimes) -> None:
        self._kind = kind
        self._spots_m = spots_m
        self._times = times
        self._stage: Stage = "choose"
        self._since_ns = self._called_ns = 0
        self._attempts: int = 0
        self._presses = 0
        self._gesture: Gesture = "press"
        self._lamp_ns = self._unclear = 0
        """Time of the last request to point at a lamp, and number of robots that were not clear."""
        self._robot = ""
        self._is_shared = False
        self._arrivals: int = 0
        self._next: int = 0
        """Index of the next spot, which counts on."""
        self._pause_until_ns: dict[str, int] = {}

    def goal(self, now_ns: int, sight: Sight) -> PersonGoal:
        """Return the robot or spot to point at, with the presses so far, or rest."""
        if not 0 <= now_ns - self._called_ns <= NS_PER_S:
            self._enter_stage("choose", now_ns)  # without pointing meanwhile they have no robot
        self._called_ns = now_ns
        for cue in sight.cues:
            self._is_shared |= "is steered by" in cue.text
            self._on_cue(cue, now_ns)
        robots = sight.robots(now_ns)
        if self._stage == "choose":
            self._choose_robot(robots, now_ns)
        robot = robots.get(self._robot)
        if self._stage in ("aim", "asked"):
            return self._at_robot(robot, now_ns)
        if self._stage == "choose":
            return REST
        return self._at_spot(robot, now_ns)

    @abstractmethod
    def _at_spot(self, robot: RobotState | None, now_ns: int) -> PersonGoal:
        """Return the spot to point at with `robot`, which the person has."""

    @abstractmethod
    def _on_result(self, cue: Feedback, now_ns: int) -> None:
        """Process a cue while the person steers."""

    def _choose_robot(self, robots: dict[str, RobotState], now_ns: int) -> None:
        free: list[str] = []
        for name, robot in robots.items():
            pause_until_ns = self._pause_until_ns.get(name, 0)
            if robot.kind == self._kind and pause_until_ns <= now_ns:
                free.append(name)
        if free and self._spots_m:
            self._robot = free[self._attempts % len(free)]
            self._attempts += 1
            self._enter_stage("aim", now_ns)

    def _at_robot(self, robot: RobotState | None, now_ns: int) -> PersonGoal:
        if robot is None:
            self._enter_stage("choose", now_ns)
            return REST
        if self._stage == "aim" and self._lasted_s(now_ns) > self._usually(AIM_S):
            self._press_button("asked", now_ns)
        elif self._stage == "asked" and self._lasted_s(now_ns) > ANSWER_S:
            self._enter_stage("choose", now_ns)
        goal = self._goal_at(f"robot {self._robot} {self._attempts}", robot.position_m)
        return replace(goal, velocity_mps=robot.velocity_mps, stamp_ns=robot.stamp_ns)

    def _spot_goal(self) -> PersonGoal:
        goal = self._goal_at(f"spot {self._next} {self._attempts}", self._spot_m)
        return replace(goal, closed_loop=True)

    def _goal_at(self, key: str, point_m: Vec3) -> PersonGoal:
        return PersonGoal(key, point_m, presses=self._presses, gesture=self._gesture)

    def _on_cue(self, cue: Feedback, now_ns: int) -> None:
        is_asked = self._stage == "asked"
        is_other_robot = "is yours" in cue.text and self._robot not in cue.text
        if cue.cue == "refused" and self._needs_lamp(cue.text, now_ns):
            self._lamp_ns = now_ns
            self._press_button("asked", now_ns, "double")
        elif cue.cue == "deselected":
            self._enter_stage("choose", now_ns)
        elif is_asked and is_other_robot:
            self._press_button("asked", now_ns, "hold")  # let it go
        elif is_asked and cue.cue == "selected":
            self._enter_stage("sent" if "goes there" in cue.text else "steer", now_ns)
        elif is_asked and cue.cue == "refused":
            self._on_refusal(cue.text, now_ns)
        elif self._stage in ("steer", "sent"):
            self._on_result(cue, now_ns)

    def _on_refusal(self, text: str, now_ns: int) -> None:
        if "press again" in text:
            self._press_button("asked", now_ns)
        elif "way-point" in text:  # it is theirs still
            self._enter_stage("steer", now_ns)
        elif "no robot" in text:
            self._attempts += 1
            self._enter_stage("aim", now_ns)
        elif "longer" not in text:
            pause_s = self._usually(PAUSE_S)
            self._pause_until_ns[self._robot] = now_ns + round(pause_s * NS_PER_S)
            self._enter_stage("choose", now_ns)

    def _needs_lamp(self, text: str, now_ns: int) -> bool:
        """Return True if pointing at a lamp once helps, and was not done just before."""
        is_settled = self._lasted_s(now_ns) > SETTLED_S
        self._unclear += "longer" in text
        is_lost = "localize again" in text and is_settled
        is_unsure = "press twice" in text or is_lost
        is_unclear_again = "longer" in text and self._unclear % 2 == 0
        is_needed = is_unsure or is_unclear_again
        return is_needed and not 0 <= now_ns - self._lamp_ns < WAIT_S * NS_PER_S

    def _count_arrival(self, now_ns: int) -> bool:
        """Go on to the next spot. Return True if it is the others' turn."""
        self._next += 1
        self._arrivals += 1
        if self._arrivals % TURN:
            return False
        pause_s = OTHERS_TURN_S if self._is_shared else TURN_PAUSE_S
        self._pause_until_ns[self._robot] = now_ns + round(pause_s * NS_PER_S)
        return True

    def _enter_stage(self, stage: Stage, now_ns: int) -> None:
        self._stage = stage
        self._since_ns = now_ns

    def _press_button(self, stage: Stage, now_ns: int, gesture: Gesture = "press") -> None:
        self._presses += 1
        self._gesture = gesture
        self._enter_stage(stage, now_ns)

    def _lasted_s(self, now_ns: int) -> float:
        return (now_ns - self._since_ns) / NS_PER_S

    def _usually(self, duration_s: float) -> float:
        return duration_s * self._times.quickness

    @property
    def _spot_m(self) -> Vec3:
        return self._spots_m[self._next % len(self._spots_m)]


class QuadrotorUser(_RobotUser):
    """Takes a quadrotor, steers it over a spot, seeing where it hovers, and lands it. Then the next spot."""

    def __init__(self, spots_m: Sequence[Vec3], times: DecisionTimes) -> None:
        super().__init__("quadrotor", spots_m, times)
        self._over_since_ns: int | None = None

    def _at_spot(self, robot: RobotState | None, now_ns: int) -> PersonGoal:
        if self._stage == "sent" and self._lasted_s(now_ns) > RESULT_S:
            self._enter_stage("choose", now_ns)
        elif self._stage == "steer" and self._is_content(robot, now_ns):
            self._press_button("sent", now_ns)
        return replace(self._spot_goal(), robot=self._robot)

    def _is_content(self, robot: RobotState | None, now_ns: int) -> bool:
        """Return True if the robot has been over the spot for a moment, or the person has tried for long."""
        axes = 3 if self._spot_m[2] > IN_AIR_M else 2
        is_over = False
        if robot is not None:
            spot_m = self._spot_m[:axes]
            distance_m = math.dist(robot.position_m[:axes], spot_m)
            is_over = distance_m <= OVER_M
        if not is_over:
            self._over_since_ns = None
        elif self._over_since_ns is None:
            self._over_since_ns = now_ns
        since_ns = self._over_since_ns
        stay_ns = self._usually(CONTENT_S) * NS_PER_S
        has_stayed = since_ns is not None and now_ns - since_ns >= stay_ns
        return has_stayed or self._lasted_s(now_ns) > ENOUGH_S

    def _on_result(self, cue: Feedback, now_ns: int) -> None:
        if self._stage == "steer":  # what keeps the robot away has led the arm too far
            self._attempts += int("past everything" in cue.text)
        elif cue.chime == "double":
            self._count_arrival(now_ns)
            self._enter_stage("choose", now_ns)
        elif cue.cue == "refused":
            self._next += "choose one" in cue.text
            self._enter_stage("steer", now_ns)


class GroundRobotUser(_RobotUser):
    """Takes a ground robot and sends it along spots, seeing the cursor's light. Then along the next ones."""

    def __init__(self, spots_m: Sequence[Vec3], times: DecisionTimes) -> None:
        super().__init__("ground", spots_m, times)
        self._set = 0
        """Number of way-points set so far."""

    def _at_spot(self, robot: RobotState | None, now_ns: int) -> PersonGoal:  # noqa: ARG002 - the other kind's need
        if self._stage == "sent" and self._lasted_s(now_ns) > RESULT_S:
            self._enter_stage("steer", now_ns)
        elif self._stage == "steer" and self._set >= PATH:
            if self._lasted_s(now_ns) > self._usually(CONTENT_S):
                self._press_button("sent", now_ns)
        elif self._stage == "steer" and self._lasted_s(now_ns) > WAYPOINT_S:
            self._next += 1
            self._since_ns = now_ns
        return self._spot_goal()

    def _on_result(self, cue: Feedback, now_ns: int) -> None:
        if self._stage == "steer" and cue.cue == "selected":
            self._set += 1
            self._next += self._set < PATH
            self._since_ns = now_ns
        elif self._stage == "steer" and cue.cue == "refused":  # not there: another place
            self._next += 1
            self._since_ns = now_ns
        elif self._stage == "sent" and cue.chime == "double":
            if self._count_arrival(now_ns):
                self._press_button("asked", now_ns, "hold")
            else:
                self._enter_stage("steer", now_ns)
        elif self._stage == "sent" and cue.cue == "refused":  # a second stay where the last one was is none
            self._next += 1
            self._enter_stage("steer", now_ns)

    def _enter_stage(self, stage: Stage, now_ns: int) -> None:
        self._set = 0
        super()._enter_stage(stage, now_ns)
