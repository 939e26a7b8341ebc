"""Periodic observation of the strips, and estimates from seen and felt signals."""

from collections.abc import Iterator

from pointit.geometry import vector
from pointit.schemas import NS_PER_S, Feedback
from pointit.services.user_sim.correction import Correction
from pointit.services.user_sim.eyes import SeenCursor, Span
from pointit.services.user_sim.goal import IN_AIR_M, LOOK_NS, PerceivedState, PersonGoal
from pointit.services.user_sim.perceived_objects import PerceivedObjects, Status
from pointit.services.user_sim.sight import SeenObject, Sight

ROUND = 4
"""Number of looks from one look at all things to the next. Others are at the goal only."""
ON_M = 0.05
"""Distance beside a thing at which a cursor is on it, m."""
MAX_CURSOR_AGE_S = 0.5
"""Age of a frame up to which its cursor is current, s."""
ROBOT_LAG_S = 0.8
"""Time after a movement of the hand within which a robot that follows it is not where the hand points, s."""
ROBOT_STILL_MPS = 0.15
"""Speed below which a robot has followed, m/s."""


class Perception:
    """Updates estimates from seen and felt signals."""

    def __init__(self, sight: Sight, correction: Correction) -> None:
        self._sight = sight
        self._correction = correction
        self._next_ns = 0
        self._looks = 0
        self._frame_ns: int | None = None
        self.perceived = PerceivedState()
        self.things = PerceivedObjects()
        self.cursor: SeenCursor | None = None
        """Own cursor at the last look."""
        self._answering_id = ""
        """Thing whose light has shown last that the ray is on it, or `""`: a cursor has shown it."""
        self._cursor_ns = 0

    def update(self, now_ns: int, goal: PersonGoal) -> None:
        """Process cues, and look at the strips if it is time."""
        # Cues are heard at any time, and count at once
        for cue in self._sight.cues:
            self.perceived.on_cue(cue, now_ns)
            if cue.turn_rad is not None and goal.closed_loop:
                named = self._sight.find(cue.target_id, now_ns)
                named_m = None if named is None else named.thing.position_m
                self._correction.turn(cue.turn_rad, cue.stamp_ns, now_ns, goal, named_m)
            is_of_selection = cue.cue in ("selected", "deselected", "refused")
            if is_of_selection and self.perceived.state == "pointing":
                self._on_selection_cue(cue, now_ns, goal)

        # A person looks ten times a second
        if now_ns < self._next_ns <= now_ns + LOOK_NS:
            return
        self._next_ns = now_ns + LOOK_NS
        if self.perceived.state == "pointing" and goal.robot:
            self._watch_robot(now_ns, goal)
        elif self.perceived.state == "pointing":
            is_dark = not goal.on_line and not goal.lit
            shows_nothing = is_dark or self._sight.announced is not None
            if shows_nothing or self.things.status(goal.object_id) == "mine":
                self._correction.wait(now_ns)  # no light would show that a search succeeds, or it has
            self._look_at_lights(now_ns, goal)

    def _watch_robot(self, now_ns: int, goal: PersonGoal) -> None:
        """Look at the robot that follows: it, or the place below it if the goal is low, is the cursor.

        Of a robot's part that is a tracked object, such as a hand, it is the place below, at that height.
        """
        self._correction.wait(now_ns)
        robot = self._sight.robots(now_ns).get(goal.robot)
        part = self._sight.find(goal.robot, now_ns)
        if goal.point_m is None:
            return
        goal_height_m = goal.point_m[2]

        if robot is not None:
            x, y, z = robot.position_m
            height_m = z if goal_height_m > IN_AIR_M else goal_height_m
            velocity_mps = robot.velocity_mps
            stamp_ns = robot.stamp_ns
        elif part is not None:
            x, y, _ = part.thing.position_m
            height_m = goal_height_m
            velocity_mps = part.thing.velocity_mps
            stamp_ns = part.stamp_ns
        else:
            return

        # While it is under way, it is not where they point
        if vector.norm(velocity_mps) > ROBOT_STILL_MPS:
            return
        if stamp_ns - self._correction.steady_since_ns < ROBOT_LAG_S * NS_PER_S:
            return
        self._correction.see((x, y, height_m), stamp_ns, goal)

    def _look_at_lights(self, now_ns: int, goal: PersonGoal) -> None:
        frame_ns = self._sight.frame_ns
        is_new = frame_ns is not None and frame_ns != self._frame_ns
        self._frame_ns = frame_ns
        self._looks += is_new
        is_round = self._looks % ROUND == 0
        looks_around = is_new and is_round
        if not goal.closed_loop and not looks_around:
            return
        objects = self._sight.objects(now_ns)
        answering = self._answering(goal, objects) if goal.closed_loop else None

        # Where the ray is: a spoken name, the own light of a thing, or a cursor shows it
        announced = self._sight.announced
        named: SeenObject | None = None
        if goal.closed_loop and announced is not None:
            named = self._sight.named(now_ns)
        if announced is not None and named is not None:
            self._see_answer(named, announced.began_ns, goal)
        elif answering is not None:  # the light may be far from the thing, so that it is no cursor
            self.cursor = None
            self._answering_id = answering.thing.id
            self._cursor_ns = now_ns
            self._see_answer(answering, now_ns - self._sight.delay_ns, goal)
        elif is_new and frame_ns is not None and goal.closed_loop:
            self._find_cursor(frame_ns, goal, objects)

        # What the things look like: the goal in each frame, the others now and then
        if is_new:
            for seen in objects:
                if is_round or seen.thing.id == goal.object_id:
                    appearance = self._sight.looks(seen)
                    self.things.see(seen.thing.id, appearance, now_ns)

    def _see_answer(self, answering: SeenObject, at_ns: int, goal: PersonGoal) -> None:
        is_goal = answering.thing.id == goal.object_id
        self._correction.see(answering.thing.position_m, at_ns, goal, confirms=is_goal)

    def _answering(self, goal: PersonGoal, objects: list[SeenObject]) -> SeenObject | None:
        """Return the thing whose own light shows that the ray is on it, rather the goal than another one."""
        sight = self._sight
        things = self.things
        shown: list[SeenObject] = []
        for seen in objects:
            if not seen.thing.lit or things.status(seen.thing.id) == "mine":
                continue
            if sight.shows_own_color(seen):
                shown.append(seen)
        return min(shown, key=lambda seen: seen.thing.id != goal.object_id, default=None)

    def _find_cursor(self, frame_ns: int, goal: PersonGoal, objects: list[SeenObject]) -> None:
        expected_m = self._correction.expected_m(frame_ns, goal)
        spans = _spans(objects, frame_ns)
        self.cursor = self._sight.eyes.cursor(goal.kind, expected_m, spans)
        if self.cursor is not None:
            self._answering_id = ""
            self._cursor_ns = frame_ns
            self._correction.see(self.cursor.point_m, frame_ns, goal, confirms=goal.on_line)
            return
        mark_m = self._sight.eyes.mark(goal.kind)
        if mark_m is not None:
            self._correction.see_mark(mark_m, frame_ns, goal)

    def _on_selection_cue(self, cue: Feedback, now_ns: int, goal: PersonGoal) -> None:
        """Relate a cue of selecting to the object under the own cursor, or that it names, or to the goal."""
        object_id = self._under_cursor(now_ns) or goal.object_id
        if not goal.on_line and goal.closed_loop:
            named: list[SeenObject] = []
            for seen in self._sight.objects(now_ns):
                if cue.text == f"{seen.thing.kind} {cue.cue}":
                    named.append(seen)
            seen = min(named, key=lambda seen: seen.thing.id != goal.object_id, default=None)
            if seen is not None:
                object_id = seen.thing.id
                self._see_answer(seen, cue.stamp_ns, goal)
        if object_id:
            status_of_cue: dict[str, Status] = {"selected": "mine", "deselected": "free", "refused": "theirs"}
            self.things.believe(object_id, status_of_cue[cue.cue], now_ns)

    def _under_cursor(self, now_ns: int) -> str:
        cursor = self.cursor
        at_ns = self._cursor_ns
        if not 0 <= now_ns - at_ns < MAX_CURSOR_AGE_S * NS_PER_S:
            return ""
        if cursor is None:
            return self._answering_id
        best = ""
        min_distance_m = float("inf")
        for seen in self._sight.objects(now_ns):
            if seen.key != (cursor.kind, cursor.line_id):
                continue
            gap_m = abs(seen.along_m(at_ns) - cursor.position_m)
            if gap_m < min(seen.thing.length_m / 2.0 + ON_M, min_distance_m):
                best = seen.thing.id
                min_distance_m = gap_m
        return best


def _spans(objects: list[SeenObject], at_ns: int) -> Iterator[Span]:
    for seen in objects:
        key = seen.key
        if key is not None:
            middle_m = seen.along_m(at_ns)
            half_m = seen.thing.length_m / 2.0
            yield (key, middle_m - half_m, middle_m + half_m)
