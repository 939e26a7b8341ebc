"""Periodic looks at the strips, and the beliefs derived from what is seen and felt."""

from collections.abc import Iterator

from pointit.geometry import vector
from pointit.schemas import NS_PER_S
from pointit.services.user_sim.decision.belief import Belief
from pointit.services.user_sim.decision.correction import Correction
from pointit.services.user_sim.decision.goal import IN_AIR_M, Goal
from pointit.services.user_sim.sight.eyes import SeenCursor, Span
from pointit.services.user_sim.sight.object_beliefs import ObjectBeliefs, Status
from pointit.services.user_sim.sight.sight import SeenObject, Sight

ROUND = 4
"""Number of looks from one look at all things to the next. Others are at the goal only."""
ON_M = 0.05
"""Distance beside a thing at which a cursor is on it, m."""
STILL_S = 0.5
"""Age of a frame up to which its cursor is current, s."""
ROBOT_LAG_S = 0.8
"""Time after a movement of the hand within which a robot that follows it is not where the hand points, s."""
ROBOT_STILL_MPS = 0.15
"""Speed below which a robot has followed, m/s."""


class Perception:
    """Updates beliefs from what is seen and felt."""

    def __init__(self, sight: Sight, correction: Correction, period_s: float) -> None:
        self._sight = sight
        self._correction = correction
        self._period_ns = round(period_s * NS_PER_S)
        self._next_ns = 0
        self._looks = 0
        self._frame_ns: int | None = None
        self.belief = Belief()
        self.things = ObjectBeliefs()
        self.cursor: SeenCursor | None = None
        """Own cursor at the last look."""
        self._cursor_ns = 0

    def update(self, now_ns: int, goal: Goal) -> None:
        """Process cues, and look at the strips if it is time."""
        for cue in self._sight.cues:
            self.belief.on_cue(cue, now_ns)
            if cue.turn_rad is not None and goal.closed_loop:
                self._correction.turn(cue.turn_rad, cue.stamp_ns, now_ns)
            if cue.cue in ("selected", "deselected", "refused") and self.belief.state == "pointing":
                self._on_selection_cue(cue.cue, now_ns, goal)
        if now_ns < self._next_ns <= now_ns + self._period_ns:
            return
        self._next_ns = now_ns + self._period_ns
        if self.belief.state == "pointing" and goal.robot:
            self._watch(now_ns, goal)
        elif self.belief.state == "pointing":
            self._look(now_ns, goal)

    def _watch(self, now_ns: int, goal: Goal) -> None:
        """Look at the robot that follows: it, or the place below it if the goal is low, is the cursor."""
        robot = self._sight.robots(now_ns).get(goal.robot)
        self._correction.wait(now_ns)
        if robot is None or goal.point_m is None or vector.norm(robot.velocity_mps) > ROBOT_STILL_MPS:
            return
        if robot.stamp_ns - self._correction.steady_since_ns < ROBOT_LAG_S * NS_PER_S:
            return
        x, y, z = robot.position_m
        height_m = z if goal.point_m[2] > IN_AIR_M else goal.point_m[2]
        self._correction.see((x, y, height_m), robot.stamp_ns, goal)

    def _look(self, now_ns: int, goal: Goal) -> None:
        frame_ns = self._sight.frame_ns
        if frame_ns is None or frame_ns == self._frame_ns:
            return
        self._frame_ns = frame_ns
        self._looks += 1
        is_round = self._looks % ROUND == 0
        if not is_round and not goal.closed_loop:
            return
        objects = self._sight.objects(now_ns)
        eyes = self._sight.eyes
        if goal.closed_loop:
            self._find_cursor(frame_ns, goal, objects)
        for seen in objects:
            key = seen.key
            if key is not None and (is_round or seen.thing.id == goal.object_id):
                looks = eyes.looks(seen.thing.kind, key, seen.along_m(frame_ns), seen.thing.length_m)
                self.things.see(seen.thing.id, looks, now_ns)

    def _find_cursor(self, frame_ns: int, goal: Goal, objects: list[SeenObject]) -> None:
        expected_m = self._correction.expected_m(frame_ns, goal)
        self.cursor = self._sight.eyes.cursor(goal.kind, expected_m, _spans(objects, frame_ns))
        if self.cursor is not None:
            self._cursor_ns = frame_ns
            self._correction.see(self.cursor.point_m, frame_ns, goal)
            return
        mark_m = self._sight.eyes.mark(goal.kind)
        if mark_m is not None:
            self._correction.see_mark(mark_m, frame_ns, goal)

    def _on_selection_cue(self, cue: str, now_ns: int, goal: Goal) -> None:
        """Relate a cue of selecting to the object under the own cursor, or to the goal."""
        if object_id := self._under_cursor(now_ns) or goal.object_id:
            told: dict[str, Status] = {"selected": "mine", "deselected": "free", "refused": "theirs"}
            self.things.believe(object_id, told[cue], now_ns)

    def _under_cursor(self, now_ns: int) -> str:
        cursor, at_ns = self.cursor, self._cursor_ns
        if cursor is None or not 0 <= now_ns - at_ns < STILL_S * NS_PER_S:
            return ""
        best, least_m = "", float("inf")
        for seen in self._sight.objects(now_ns):
            if seen.key != (cursor.kind, cursor.line_id):
                continue
            gap_m = abs(seen.along_m(at_ns) - cursor.position_m)
            if gap_m < min(seen.thing.length_m / 2.0 + ON_M, least_m):
                best, least_m = seen.thing.id, gap_m
        return best


def _spans(objects: list[SeenObject], at_ns: int) -> Iterator[Span]:
    for seen in objects:
        key = seen.key
        if key is not None:
            middle_m, half_m = seen.along_m(at_ns), seen.thing.length_m / 2.0
            yield (key, middle_m - half_m, middle_m + half_m)
