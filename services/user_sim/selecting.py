"""Selecting every object of some kinds, deselecting wrong ones, and the times that it takes."""

import math
from dataclasses import replace

import numpy as np

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.user_sim.config import UserSimConfig
from pointit.services.user_sim.goal import LOOK_NS, REST, PersonGoal, on_object
from pointit.services.user_sim.perceived_objects import PerceivedObjects, Status
from pointit.services.user_sim.sight import SeenObject, Sight

FIND_SPREAD = 0.3
"""Log-normal spread of the times to find and choose, a share."""
UNSKILLED_SHARE = 0.3
"""Share by which times shrink from skill 0 to 1."""

DWELL_S = 0.8
"""Time on a thing until it is selected, as people learn it, s."""
LEAVE_S = (1.0, 1.5)
"""Range of times after turning to a thing at which a person leaves who considers it selected too early, s."""
CONFIRM_S = 2.0
"""Time after turning to a thing that wants a press until the person presses, s."""
SWITCH_S = 15.0
"""Time after switching a thing on or off until the person switches it back, s."""


class DecisionTimes:
    """Random times of one person's decisions, log-normal, and lapses.

    Visual search has a base and a slope per item (Wolfe 1998: 5 to 10 ms if a colour pops out, 20 to 30 ms if
    features are conjoined, more for moving things in a room). Choosing among n targets takes 0.15 s per bit
    of log2(n + 1) (Hick 1952).
    """

    def __init__(self, config: UserSimConfig, skill: float, rng: np.random.Generator) -> None:
        """Create from the person's configuration and skill, 0 to 1."""
        self._decision = config.mind
        self._rng = rng
        self.quickness = 1.0 - UNSKILLED_SHARE * skill
        """Factor on times."""
        self._lapse_share = config.mind.lapse_share * (1.0 - skill)

    def find_s(self, items: int, choices: int) -> float:
        """Return the time to find a target among `items`, of which `choices` are suitable, s."""
        decision = self._decision
        usual_s = decision.search_base_s + decision.search_per_item_s * items
        usual_s += decision.decide_per_bit_s * math.log2(choices + 1.0)
        spread = math.exp(FIND_SPREAD * float(self._rng.standard_normal()))
        return self.quickness * usual_s * spread

    def lapses(self) -> bool:
        """Return True if a lapse occurs now."""
        return self._lapse_share > 0.0 and float(self._rng.random()) < self._lapse_share

    def between(self, minimum: float, maximum: float) -> float:
        """Return a uniformly random number between the two."""
        return float(self._rng.uniform(minimum, maximum))


class Selecting:
    """Stays with one object until it is done, gone or timed out, then finds the next.

    That is the one that leaves first among those with enough time left, or of resting ones the one that the
    person left least recently, done or given up, then the nearest to the last one. Objects that other people
    have, or are about to have, are left alone.
    """

    def __init__(self, config: UserSimConfig, things: PerceivedObjects, times: DecisionTimes) -> None:
        self._kinds = frozenset(config.target_kinds)
        self._things = things
        self._times = times
        self._give_up_ns = round(config.give_up_s * NS_PER_S)
        self._retry_ns = round(config.retry_s * NS_PER_S)
        arm = config.arm
        # a common reach with the times of reaction and selection; objects with less time left are skipped
        self._needed_s = config.aim.reaction_s + arm.reach_base_s + 3.0 * arm.reach_per_bit_s + DWELL_S
        self._current = ""
        self._next = ""
        self._mistaken = ""
        """Object that was chosen by mistake."""
        self._ready_ns = 0
        self._look_again_ns = 0
        self._since_ns = 0
        self._leave_ns: int | None = None
        self._goal = REST
        self._pause_until_ns: dict[str, int] = {}
        self._switched_ns: dict[str, int] = {}
        """Time at which the person switched each switch last, ns."""
        self._left_ns: dict[str, int] = {}
        """Time at which the person turned from each object last, done or given up, ns."""
        self._is_instructed = False
        self._presses = 0
        self._confirmed_ns = 0
        """Time of turning to the object that was confirmed last, or of its name, ns."""
        self._before: Status = "free"
        """Status of the current object when the person turned to it."""

    def goal(self, now_ns: int, sight: Sight) -> PersonGoal:
        """Return the object on which to hold the cursor, or rest."""
        self._follow_instructions(now_ns, sight)
        if self._current:
            self._continue_object(now_ns, sight)
        if not self._current:
            self._search(now_ns, sight)
        if not self._current and not self._next:
            self._goal = REST
        elif self._goal.object_id:  # the hand stays during the search for the next one
            seen = sight.find(self._goal.object_id, now_ns)
            self._goal = REST if seen is None else on_object(seen, sight, closed_loop=True)
        if not self._presses:
            return self._goal
        return replace(self._goal, presses=self._presses)

    def _follow_instructions(self, now_ns: int, sight: Sight) -> None:
        """Aim only at what a sentence names, such as `Point at nuts.`, and at nothing else from then on."""
        for cue in sight.cues:
            if cue.cue != "target" or cue.target_id:
                continue
            kinds = {seen.thing.kind for seen in sight.objects(now_ns)}
            named = frozenset(kind for kind in kinds if f" {kind}." in cue.text)
            if named or self._is_instructed:
                self._kinds = named
                self._is_instructed = True
                self._current = ""
                self._next = ""

    def _continue_object(self, now_ns: int, sight: Sight) -> None:
        """End with the current object if it is done or timed out."""
        seen = sight.find(self._current, now_ns)
        if seen is None:
            self._leave_object(now_ns)
            return

        # Selected or undone, or no longer to be had
        is_button = seen.thing.mode == "button"
        if is_button and self._things.status(self._current) == "mine":
            self._things.believe(self._current, "free", now_ns)  # anybody may fire it again
            self._leave_object(now_ns)
        elif self._is_switched(seen):
            self._switched_ns[self._current] = now_ns
            self._leave_object(now_ns)
        elif not self._is_open_task(seen, now_ns):
            self._leave_object(now_ns)

        # A lapse, or it takes too long
        elif self._leave_ns is not None and now_ns >= self._leave_ns:
            self._things.believe(self._current, "mine", now_ns)
            self._leave_object(now_ns)
        elif not 0 <= now_ns - self._since_ns <= self._give_up_ns:
            self._pause_until_ns[self._current] = now_ns + self._retry_ns
            self._leave_object(now_ns)

        # It waits for a press
        else:
            asked_ns = self._asked_ns(seen, now_ns, sight)
            if asked_ns not in (0, self._confirmed_ns):
                self._confirmed_ns = asked_ns
                self._presses += 1

    def _asked_ns(self, seen: SeenObject, now_ns: int, sight: Sight) -> int:
        """Return the time at which the current object asked for a press, by its name or itself, or 0."""
        if sight.announced is None:
            is_due = seen.thing.press and self._since_ns <= now_ns - CONFIRM_S * NS_PER_S
            return self._since_ns if is_due else 0
        named = sight.named(now_ns)
        is_named = named is not None and named.thing.id == seen.thing.id
        return sight.announced.began_ns if is_named else 0

    def _leave_object(self, now_ns: int) -> None:
        self._left_ns[self._current] = now_ns
        self._current = self._mistaken = ""
        self._leave_ns = None

    def _search(self, now_ns: int, sight: Sight) -> None:
        """Search for the next one, which takes time, and turn to it."""
        # The search is over: turn to what was found, if it is still there
        if self._next and now_ns < self._ready_ns:
            return
        if self._next:
            seen = sight.find(self._next, now_ns)
            if seen is not None and self._is_open_task(seen, now_ns):
                self._turn_to(seen, now_ns, sight)
            self._next = ""
            return

        # Start a search, unless there was nothing a moment ago
        if 0 <= self._look_again_ns - now_ns <= LOOK_NS:
            return
        self._look_again_ns = now_ns + LOOK_NS
        objects = sight.objects(now_ns)
        tasks = [seen for seen in objects if self._is_worth(seen, now_ns, sight)]
        if not tasks:
            return
        chosen = min(tasks, key=lambda seen: (sight.time_left_s(seen, now_ns), *self._last(seen)))
        if self._times.lapses():
            chosen = self._mistake(chosen, objects)
        self._next = chosen.thing.id
        search_s = self._times.find_s(len(objects), len(tasks))
        self._ready_ns = now_ns + round(search_s * NS_PER_S)

    def _turn_to(self, seen: SeenObject, now_ns: int, sight: Sight) -> None:
        self._current = self._next
        self._since_ns = now_ns
        self._before = self._things.status(self._current)
        self._goal = on_object(seen, sight, closed_loop=True)
        if self._times.lapses():
            stay_s = self._times.between(*LEAVE_S)
            self._leave_ns = now_ns + round(stay_s * NS_PER_S)

    def _is_open_task(self, seen: SeenObject, now_ns: int) -> bool:
        """Return True if its selection is to be changed, and can still be."""
        return self._is_task(seen) and not self._is_decided(seen, now_ns)

    def _is_task(self, seen: SeenObject) -> bool:
        thing = seen.thing
        if thing.mode == "button":  # nobody has it
            return self._is_target(seen)
        status = self._things.status(thing.id)
        if self._is_switch(seen):
            return status in ("free", "mine")
        return status == "free" if self._is_target(seen) else status == "mine"

    def _is_switch(self, seen: SeenObject) -> bool:
        """Return True if the person switches it on and off again: nobody asked for one state of it."""
        return seen.thing.mode == "switch" and self._is_target(seen)

    def _is_switched(self, seen: SeenObject) -> bool:
        if not self._is_switch(seen):
            return False
        return self._things.status(seen.thing.id) != self._before

    @staticmethod
    def _is_decided(seen: SeenObject, now_ns: int) -> bool:
        """Return True if the object's bay is decided, so that it can no longer be selected."""
        return seen.thing.bay_until_ns is not None and now_ns >= seen.thing.bay_until_ns

    def _is_target(self, seen: SeenObject) -> bool:
        return seen.thing.kind in self._kinds or seen.thing.id == self._mistaken

    def _is_worth(self, seen: SeenObject, now_ns: int, sight: Sight) -> bool:
        """Return True if an object needs a change of selection now, and there is time for it."""
        if not self._is_task(seen) or not sight.has_come(seen, now_ns):
            return False
        switched_ns = self._switched_ns.get(seen.thing.id) if self._is_switch(seen) else None
        if switched_ns is not None and 0 <= now_ns - switched_ns < SWITCH_S * NS_PER_S:
            return False
        until_ns = self._pause_until_ns.get(seen.thing.id, 0)
        is_paused = 0 < until_ns - now_ns <= self._retry_ns
        return not is_paused and sight.time_left_s(seen, now_ns) >= self._needed_s

    def _last(self, seen: SeenObject) -> tuple[int, float]:
        """Return the time at which the person left the object, ns, and its distance from the last one, m."""
        here: Vec3 | None = self._goal.point_m
        distance_m = 0.0 if here is None else math.dist(here, seen.thing.position_m)
        return self._left_ns.get(seen.thing.id, 0), distance_m

    def _mistake(self, target: SeenObject, objects: list[SeenObject]) -> SeenObject:
        """Return the thing nearest to `target`, which is mistaken for it."""
        others = [seen for seen in objects if seen.thing.kind not in self._kinds]
        if not others:
            return target
        at_m = target.thing.position_m
        other = min(others, key=lambda seen: math.dist(at_m, seen.thing.position_m))
        self._mistaken = other.thing.id
        return other
