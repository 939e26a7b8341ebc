"""The robot that a person points at, and cues when it is not clear which."""

import math
from typing import Literal, NamedTuple

from pointit.schemas import NS_PER_S, Candidate, PointingRay, RobotState, UserPose
from pointit.services.goal.robot_identification import RobotIdentifier

PERIOD_NS = NS_PER_S // 5
"""Time between two identifications without a press."""
PENDING_NS = 3 * NS_PER_S
"""Time after a press within which an unclear choice may still become clear by pointing on."""
LIKELY = 0.1
"""Probability from which a robot is named as one that may be meant."""
ONE = 0.8
"""Share of the likeliest robot in all likely ones from which only a place beside it may be meant instead."""
RATHER = 0.5
"""Probability from which staying asks whether a robot is meant: nothing else says that one is wanted."""
SHOWN_STEP = 0.05
"""Resolution of published probabilities, which are rounded down: what is shown is not stated too high."""


class ChosenRobot(NamedTuple):
    """A result of pointing at robots."""

    robot: str
    """The robot that is meant, or `""` if it is unclear."""
    problem: str
    """One sentence for the person, or `""`."""


class RobotChoice:
    """Identifies the robot that one person points at, and takes it by a press or by staying on it."""

    def __init__(self, take: Literal["press", "dwell"], dwell_s: float) -> None:
        self._identifier = RobotIdentifier()
        self._take = take
        self._dwell_ns = round(dwell_s * NS_PER_S)
        self._next_ns = 0
        self._pressed_ns: int | None = None
        self._asked = ("", 0)
        """Robot that another press takes, and since when."""
        self._on = ("", 0)
        """Robot that is pointed at, and since when."""
        self._done: str = ""
        """Robot whose stay had a result, until another one, or none, is pointed at."""
        self.candidates: tuple[Candidate, ...] = ()
        """Robots that may be meant, in steps of `SHOWN_STEP`, the likeliest first."""

    def on_ray(self, ray: PointingRay) -> None:
        """Process a ray of the person."""
        self._identifier.on_ray(ray)

    def on_pose(self, pose: UserPose) -> None:
        """Update the person's own pose."""
        self._identifier.on_pose(pose)

    def on_robot(self, robot: str, state: RobotState) -> None:
        """Update the place of a robot."""
        if state.phase == "lost":
            self.forget(robot)
            return
        self._identifier.on_robot(
            robot, state.stamp_ns, state.position_m, position_sigma_m=state.position_sigma_m
        )

    def forget(self, robot: str) -> None:
        """Remove a robot that is no longer heard of."""
        self._identifier.forget(robot)

    def reset(self) -> None:
        """Withdraw an unclear choice, and show no candidates."""
        self._pressed_ns = None
        self._asked = self._on = ("", 0)
        self.candidates = ()

    def press(self, now_ns: int) -> ChosenRobot:
        """Return the robot pointed at.

        If it is unclear which, pointing on for a while may make it clear. If it is unclear whether one is
        meant at all, or a place near it, another press takes it.
        """
        chosen = self._identify(now_ns)
        (asked, asked_ns), self._asked = self._asked, ("", 0)
        candidates, one = self._likely()
        if one and one == asked and 0 <= now_ns - asked_ns <= PENDING_NS:
            chosen = chosen or asked
        if chosen:
            self._pressed_ns = None
            return ChosenRobot(chosen, "")
        if not candidates:
            self._pressed_ns = None
            return ChosenRobot("", "no robot is where you point: point at one, then press")
        self._pressed_ns = now_ns
        if one:
            self._asked = (one, now_ns)
            return ChosenRobot("", f"{one} may be meant: press again to take it")
        return ChosenRobot("", _unclear(candidates))

    def step(self, now_ns: int) -> ChosenRobot | None:
        """Return a choice that became clear by pointing on, or None. Identifies at 5 Hz only.

        Staying on a robot that may be meant asks for staying on it for as long again.
        """
        if 0 <= self._next_ns - now_ns <= PERIOD_NS:
            return None
        self._next_ns = now_ns + PERIOD_NS
        chosen = self._identify(now_ns)
        on: str = chosen
        if self._pressed_ns is not None and not 0 <= now_ns - self._pressed_ns <= PENDING_NS:
            self._pressed_ns = None
        if self._take == "dwell" and self.candidates and self.candidates[0].probability >= RATHER:
            on = chosen or self._likely()[1]
        if on != self._on[0]:
            self._on = (on, now_ns)
        if on != self._done:
            self._done = ""
        stayed = self._take == "dwell" and now_ns - self._on[1] >= self._dwell_ns
        if not on or on == self._done or not (stayed or (chosen and self._pressed_ns is not None)):
            return None
        if not chosen and self._asked != self._on:
            self._asked = self._on = (on, now_ns)
            return ChosenRobot("", f"{on} may be meant: stay on it to take it")
        self._pressed_ns, self._done = None, on
        return ChosenRobot(on, "")

    def _likely(self) -> tuple[list[Candidate], str]:
        """Return the robots that may be meant, and the one that is if any is, `""` if that is unclear."""
        candidates = [each for each in self.candidates if each.probability >= LIKELY]
        is_one = bool(candidates) and candidates[0].probability >= ONE * sum(
            each.probability for each in candidates
        )
        return candidates, candidates[0].object_id if is_one else ""

    def _identify(self, now_ns: int) -> str:
        found = self._identifier.identify(now_ns)
        steps = [(each.object_id, math.floor(each.probability / SHOWN_STEP)) for each in found.candidates]
        rounded = [Candidate(object_id=name, probability=step * SHOWN_STEP) for name, step in steps]
        self.candidates = tuple(each for each in rounded if each.probability > 0.0)
        return found.chosen


def _unclear(candidates: list[Candidate]) -> str:
    names = [each.object_id for each in candidates]
    count = "two" if len(names) == 2 else str(len(names))
    listed = f"{', '.join(names[:-1])} and {names[-1]}"
    return f"{count} robots may be meant, {listed}: point longer at one"
