"""Looking at the strips: seldom, as people do; it is the mind that turns light into places and states."""

from collections.abc import Iterator

from pointit.schemas import NS_PER_S
from pointit.services.user_sim.decision.belief import Belief
from pointit.services.user_sim.decision.correction import Correction
from pointit.services.user_sim.decision.goal import Goal
from pointit.services.user_sim.sight.eyes import SeenCursor, Span
from pointit.services.user_sim.sight.object_beliefs import ObjectBeliefs
from pointit.services.user_sim.sight.sight import SeenObject, Sight

ROUND = 4
"""Every so many looks all things are looked at, not only the one that is pointed at."""
ON_M = 0.05
"""A cursor so far beside a thing is on it."""
STILL_S = 0.5
"""A frame that has stood so long still shows what it shows, but no cursor that moves."""


class Perception:
    """Draws what is believed from what is seen and felt."""

    def __init__(self, sight: Sight, correction: Correction, period_s: float) -> None:
        """Look at what is before `sight` every `period_s`."""
        self._sight = sight
        self._correction = correction
        self._period_ns = round(period_s * NS_PER_S)
        self._next_ns = 0
        self._looks = 0
        self._frame_ns: int | None = None
        self.belief = Belief()
        self.things = ObjectBeliefs()
        self.cursor: SeenCursor | None = None
        """One's own, as last looked for."""
        self._cursor_ns = 0

    def update(self, now_ns: int, goal: Goal) -> None:
        """Take in cues, and look at the strips if it is time to."""
        for cue in self._sight.cues:
            self.belief.hear(cue, now_ns)
            if cue.turn_rad is not None and goal.closed_loop:
                self._correction.turn(cue.turn_rad, cue.stamp_ns, now_ns)
            if cue.cue in ("selected", "deselected", "refused") and self.belief.state == "pointing":
                self._feel(cue.cue, now_ns, goal)
        if now_ns < self._next_ns <= now_ns + self._period_ns:
            return
        self._next_ns = now_ns + self._period_ns
        if self.belief.state == "pointing":
            self._look(now_ns, goal)

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

    def _feel(self, cue: str, now_ns: int, goal: Goal) -> None:
        """Know what a cue of selecting was about: what the own cursor is on, else what is pointed at."""
        about = self._under_cursor(now_ns) or goal.object_id
        if not about:
            return
        if cue == "selected":
            self.things.believe(about, "mine", now_ns)
        elif cue == "deselected":
            self.things.believe(about, "free", now_ns)
        else:
            self.things.believe(about, "theirs", now_ns)

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
