"""A goal of pointing: the state that the person perceives, presses of the button, the motion."""

import math
from dataclasses import dataclass
from typing import Literal

from pointit.geometry import vector
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, ButtonEvent, Feedback
from pointit.schemas.person import Gesture
from pointit.services.user_sim.config import UserSimConfig
from pointit.services.user_sim.eyes import Kind
from pointit.services.user_sim.sight import SeenObject, Sight

State = Literal["idle", "asked", "pointing"]

OFF_S = 2.0
"""Time for which the cursor is off before the person reacts, s."""
WAIT_S = 15.0
"""Time for a requested anchor to help before it is requested again, s."""
CUE_PERIOD_S = 3.0
"""Time without a profile after which the person presses anyway, s."""
PURSUIT_S = 1.5
"""Time for which a thing is extrapolated after it was lost from view, s."""
LOOK_NS = NS_PER_S // 10
"""Time between two looks at the strips while pointing, ns."""
IN_AIR_M = 0.3
"""Height from which a spot is a place for the robot itself. Lower ones are on the floor below it, m."""


class PerceivedState:
    """State derived from cues. Cues before the start of the person are unknown.

    `idle`: nothing happens until they press their button. `asked`: they are to point at `target`, or to wait
    for one. `pointing`: free pointing.
    """

    def __init__(self) -> None:
        self.state: State = "idle"
        self.since_ns = 0
        """Start of the state, ns. Time at a target within pointing counts as pointing."""
        self.target = ""
        """Target while asked. `""`: it will be named, or lights up."""
        self.is_queuing = False
        """While asked: other people come first, and the lit lamp is theirs."""
        self._back: State = "idle"
        """State after being asked, if it fails or was an anchor."""

    def on_cue(self, cue: Feedback, now_ns: int) -> None:
        """Process a cue. Cues of selecting change nothing here."""
        match cue.cue:
            case "target" if cue.turn_rad is None:  # otherwise they point past everything
                self._enter_asked(now_ns, cue.target_id)
                self.is_queuing = cue.waits
            case "started" if cue.waits:
                self._enter_asked(now_ns, cue.target_id)
            case "started":
                self._enter_state("pointing", now_ns)
            case "localized":
                if self.state == "asked":
                    self._enter_state(self._back, now_ns)
            case "refused":
                if self.state == "asked":
                    self._enter_state(self._back, now_ns)
                elif self.state == "idle":  # the press failed
                    self.since_ns = now_ns
            case "stopped":
                self._enter_state(self._back if self.state == "asked" else "idle", now_ns)
            case _:
                pass

    def reset(self, now_ns: int) -> None:
        """Assume `idle`, as no cursor has been seen for long."""
        self._back = "idle"
        self._enter_state("idle", now_ns)

    def _enter_asked(self, now_ns: int, target: str) -> None:
        if self.state != "asked":
            self._back = self.state
            if self.state != "pointing":
                self.since_ns = now_ns
        self.state = "asked"
        self.target = target
        self.is_queuing = False

    def _enter_state(self, state: State, now_ns: int) -> None:
        was_asked_while_pointing = self.state == "asked" and self._back == "pointing"
        was_pointing = self.state == "pointing" or was_asked_while_pointing
        if not was_pointing or state != "pointing":
            self.since_ns = now_ns
        self.state = state
        self.target = ""


class ButtonModel:
    """The person's thumb on the button."""

    def __init__(self, config: UserSimConfig) -> None:
        self._think_ns = round(config.think_s * NS_PER_S)
        self._pause_ns = round(config.press_pause_s * NS_PER_S)
        self._every_ns = round(config.anchor_every_s * NS_PER_S)
        self._lost_ns = round(config.lost_press_s * NS_PER_S)
        self._off_rad = math.radians(config.anchor_when_off_deg)
        self._born_ns: int | None = None
        self._pressed_ns: int | None = None
        self._anchored_ns: int | None = None
        self._on_ns = 0
        """Last time at which the cursor was on target, ns."""
        self._in_vain_ns = 0
        """Time of looking for the cursor since it was seen last, ns."""
        self._before_ns = 0
        self._presses = 0
        self._free_ns: int | None = None
        """Last time at which another client controlled the wrist. None: never."""

    def wait(self, now_ns: int) -> None:
        """Press nothing, as another client controls the wrist. Resets all timers."""
        self._free_ns = self._on_ns = self._before_ns = now_ns
        self._in_vain_ns = 0

    def step(
        self,
        now_ns: int,
        perceived: PerceivedState,
        *,
        known_ns: int | None,
        off_rad: float = 0.0,
        sees: bool | None = None,
    ) -> ButtonEvent | None:
        """Return the gesture at this time, or None.

        Args:
            now_ns: time, ns.
            perceived: perceived state of the interaction.
            known_ns: time since which they know that the system has their profile. None: not yet.
            off_rad: angle from the cursor to the felt direction.
            sees: True if they see their cursor. None: they do not look for it.
        """
        # Time since the last step. A person who paused has not looked for the cursor meanwhile.
        if self._born_ns is None or now_ns < self._born_ns:
            self._born_ns = now_ns
        passed_ns = now_ns - self._before_ns
        self._before_ns = now_ns
        if sees:
            self._in_vain_ns = 0
        elif sees is not None:
            self._in_vain_ns += max(0, min(passed_ns, NS_PER_S))

        # A gesture that the state calls for
        if perceived.state == "pointing":
            gesture = self._press_for_anchor(now_ns, perceived, off_rad)
            if gesture is not None:
                return gesture
            return self._press_when_lost(now_ns, perceived)
        self._on_ns = now_ns
        if perceived.state == "idle":
            self._anchored_ns = None
            return self._press_to_begin(now_ns, perceived, known_ns)
        return None

    def _press_to_begin(
        self, now_ns: int, perceived: PerceivedState, known_ns: int | None
    ) -> ButtonEvent | None:
        greeted_ns = (self._born_ns or 0) + round(CUE_PERIOD_S * NS_PER_S)
        if known_ns is None:
            known_ns = greeted_ns
        ready_ns = max(perceived.since_ns, known_ns) + self._think_ns
        if self._free_ns is not None and self._free_ns <= now_ns:
            ready_ns = max(ready_ns, self._free_ns + self._think_ns)
        if self._pressed_ns is not None and self._pressed_ns <= now_ns:
            ready_ns = max(ready_ns, self._pressed_ns + self._pause_ns)
        latest_ns = now_ns + self._think_ns + self._pause_ns + 10 * NS_PER_S
        if now_ns < ready_ns <= latest_ns:  # a later one is of a clock that was set back
            return None
        self._pressed_ns = now_ns
        return self.event(now_ns, "press")

    def _press_when_lost(self, now_ns: int, perceived: PerceivedState) -> ButtonEvent | None:
        """Press if no cursor was seen for long: the system may not consider them pointing."""
        if self._lost_ns == 0 or self._in_vain_ns <= self._lost_ns:
            return None
        self._in_vain_ns = 0
        self._pressed_ns = now_ns
        perceived.reset(now_ns)
        return self.event(now_ns, "press")

    def _press_for_anchor(self, now_ns: int, perceived: PerceivedState, off_rad: float) -> ButtonEvent | None:
        """Press twice if the last anchor, or the start, is long ago, or the cursor is off for long."""
        if off_rad <= self._off_rad:
            self._on_ns = now_ns
        asked_ns = self._anchored_ns
        since_ns = perceived.since_ns if asked_ns is None else asked_ns
        is_old = 0 < self._every_ns <= now_ns - since_ns
        is_off = self._off_rad > 0.0 and now_ns - self._on_ns > OFF_S * NS_PER_S
        is_answered = asked_ns is None or now_ns - asked_ns > WAIT_S * NS_PER_S
        should_correct = is_off and is_answered
        if not is_old and not should_correct:
            return None
        self._anchored_ns = self._on_ns = now_ns
        self._in_vain_ns = 0
        return self.event(now_ns, "double")

    def event(self, now_ns: int, gesture: Gesture) -> ButtonEvent:
        """Return the event of `gesture`, which the person has decided on."""
        self._presses += 1
        return ButtonEvent(stamp_ns=now_ns, seq=self._presses, source="simulated", gesture=gesture)


@dataclass(frozen=True, slots=True)
class PersonGoal:
    """A goal that moves at constant speed. Without a point the arm rests."""

    key: str
    """Identity: two goals with the same key are the same thing seen at different times."""
    point_m: Vec3 | None = None
    velocity_mps: Vec3 = (0.0, 0.0, 0.0)
    stamp_ns: int = 0
    closed_loop: bool = False
    """True if the system shows a cursor by which the person can correct."""
    kind: Kind = "strip"
    """Kind of line along which the cursor is expected."""
    curve: Polyline | None = None
    """Line with bends that it follows."""
    along_m: float = 0.0
    speed_mps: float = 0.0
    object_id: str = ""
    on_line: bool = True
    """False for an object at which no strip or belt shows the cursor: its own light does, or nothing."""
    lit: bool = False
    """True if the object's own light shows that the person points at it."""
    robot: str = ""
    """Robot, or tracked object of one, that follows the hand and so shows the cursor, or `""`: light does."""
    presses: int = 0
    """Number of presses of the button that the person has decided on so far."""
    gesture: Gesture = "press"
    """The last of them."""

    def point_at(self, now_ns: int) -> Vec3 | None:
        """Return its expected position at `now_ns`, or None."""
        if self.point_m is None:
            return None
        passed_s = min((now_ns - self.stamp_ns) / NS_PER_S, PURSUIT_S)
        if self.curve is not None:
            return self.curve.point_at(self.along_m + self.speed_mps * passed_s)
        return vector.add(self.point_m, vector.scale(self.velocity_mps, passed_s))


REST = PersonGoal("rest")


def on_object(seen: SeenObject, sight: Sight, *, closed_loop: bool) -> PersonGoal:
    """Return the goal at the middle of an object."""
    thing = seen.thing
    line = sight.lines.get(seen.key) if seen.key is not None else None
    is_bent = line is not None and len(line.tangents) > 1
    curve: Polyline | None = None
    if is_bent and thing.surface_speed_mps != 0.0:
        curve = line
    return PersonGoal(
        key=f"object {thing.id}",
        point_m=thing.position_m,
        velocity_mps=thing.velocity_mps,
        stamp_ns=seen.stamp_ns,
        closed_loop=closed_loop,
        kind="belt" if thing.surface == "belt" else "strip",
        curve=curve,
        along_m=thing.surface_position_m,
        speed_mps=thing.surface_speed_mps,
        object_id=thing.id,
        on_line=seen.key is not None and not thing.lit,
        lit=thing.lit,
    )
