"""Pointing of people: from cursors and objects to hovers and claims. It decides on no object."""

import math
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Literal

from pointit.geometry.vector import Vec3
from pointit.schemas import (
    NS_PER_S,
    ButtonEvent,
    Claim,
    Cursor,
    Environment,
    Hover,
    Step,
    TrackedObject,
    TrackedObjects,
)
from pointit.schemas.base import unchecked
from pointit.schemas.selection import MAX_PRESSED, SelectionManner, SelectsBy
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.methods.pointer import MakeMethod, PersonPointer, PointerResult, is_by_angle
from pointit.services.selector.ownership import Ownership
from pointit.services.selector.seen_objects import SPARSE_RAD, SeenObjects, View
from pointit.services.selector.selection_methods import NameAnnouncer
from pointit.services.selector.selection_publisher import CHANGES, Action, OutgoingMessage, make_cue

EMPTY_PERIOD_NS = NS_PER_S // 5
"""Time between hovers without an object, ns. The first one after an object comes at once."""

_empty_hover = unchecked(Hover)


class HoverEngine:
    """The pointing of each person, apart from all others.

    Stamps decide, not the order of arrival: late and duplicate cursors are ignored, and a clock that was set
    back resets the person's state.
    """

    def __init__(
        self,
        config: SelectorConfig,
        ownership: Ownership,
        make: MakeMethod,
        is_reserved: Callable[[str, str, int], bool],
    ) -> None:
        """Create with no people.

        Args:
            config: parameters.
            ownership: right of each person to change an object. Its objects are updated here.
            make: makes the method of each person.
            is_reserved: returns True if a person need not claim, at a time, ns, a reservation of an object
                that they are about to change.
        """
        self._config = config
        self._make = make
        self._is_reserved = is_reserved
        self._ownership = ownership

        # Objects: by metres for the methods of the paper, and as people see them
        self._positions = ownership.positions
        self._is_by_metres = not is_by_angle(config)
        self._aim_rad = math.radians(config.gauge.aim_sigma_deg)
        self._snap_rad = math.radians(config.gauge.snap_deg)
        self._scene = SeenObjects(
            stale_after_s=config.objects_stale_after_s,
            reach_rad=max(SPARSE_RAD, 4.0 * self._aim_rad, 4.0 * self._snap_rad),
            aim=config.gauge.aim,
        )
        self._things: Mapping[str, Mapping[str, object]] = {}
        """Fields that the map gives tracked objects, by id."""
        self._pressed_things: dict[str, tuple[str, bool]] = {}
        """Name of each thing of the map, and whether it wants a press, by id."""

        # People
        self._people: dict[str, PersonPointer] = {}
        self._sent: Counter[str] = Counter()
        """Number of hovers by person."""
        self._empty_ns: dict[str, int] = {}
        """Stamp of the last hover of each person whose last hover had no object, ns."""
        self._acts_here: dict[str, tuple[str, int]] = {}
        """Object and stamp of the last act of each person on what they hover, since they came to it, ns."""

    def use(self, config: SelectorConfig) -> None:
        """Change the method or its times."""
        self._config = config
        self._is_by_metres = not is_by_angle(config)
        for pointer in self._people.values():
            pointer.use(config)

    def fault(self) -> str:
        """Return the reason why the method fails for a person, or `""`."""
        for pointer in self._people.values():
            fault = pointer.fault
            if fault:
                return fault
        return ""

    def on_map(self, environment: Environment) -> None:
        """Set the lines on which objects move, and what tracked objects do."""
        self._scene.on_map(environment)
        tracked_things: dict[str, Mapping[str, object]] = {}
        pressed_things: dict[str, tuple[str, bool]] = {}
        for thing in environment.things:
            pressed_things[thing.id] = (thing.label or thing.id, thing.press)
            if thing.is_tracked:
                tracked_things[thing.id] = thing.object_fields
        self._things = tracked_things
        self._pressed_things = pressed_things

    def manner(self, stamp_ns: int) -> SelectionManner:
        """Return the manner of selecting the present objects, and the map things before they are present."""
        # Gesture of people who see lights, and of those to whom names are spoken
        by: SelectsBy = "press" if self._config.confirm == "press" else "stay"
        names_by: SelectsBy | None = None
        for pointer in self._people.values():
            if pointer.announcer:
                names_by = "press" if pointer.announcer.is_pressed else "stay"
                break

        # Objects that only a press selects. They are listed unless that is all objects
        wants_press = dict(self._pressed_things)
        for tracked in self._positions.objects.values():
            wants_press[tracked.id] = (tracked.kind or tracked.id, tracked.press)
        pressed = [name for name, is_pressed in wants_press.values() if is_pressed]
        if not pressed:
            return SelectionManner(stamp_ns=stamp_ns, by=by, names_by=names_by)
        if by == "press" or len(pressed) == len(wants_press):
            return SelectionManner(stamp_ns=stamp_ns, by="press", names_by=names_by)
        first_names = tuple(sorted(set(pressed)))[:MAX_PRESSED]
        return SelectionManner(
            stamp_ns=stamp_ns, by=by, pressed=first_names, pressed_count=len(pressed), names_by=names_by
        )

    def on_objects(self, tracker: str, objects: TrackedObjects) -> None:
        """Update the objects of `tracker`."""
        if self._things:
            objects = self._with_map_fields(objects)
        for forgotten in self._positions.update(tracker, objects):
            self._scene.forget(forgotten)
        self._scene.update(tracker, objects)

    def _with_map_fields(self, objects: TrackedObjects) -> TrackedObjects:
        """Return `objects` with the fields that the map gives to some of them."""
        is_in_map = any(tracked.id in self._things for tracked in objects.objects)
        if not is_in_map:
            return objects
        completed: list[TrackedObject] = []
        for tracked in objects.objects:
            fields = self._things.get(tracked.id)
            completed.append(tracked.model_copy(update=fields))
        return objects.model_copy(update={"objects": tuple(completed)})

    def forget_ended(self, now_ns: int) -> list[OutgoingMessage]:
        """Forget the objects of trackers and carriers that have ended. End the names of people likewise."""
        for tracker in self._positions.forget(now_ns):
            self._scene.forget(tracker)
        self._ownership.acts.forget_absent(now_ns)
        outputs: list[OutgoingMessage] = []
        for user, pointer in self._people.items():
            announcer = pointer.announcer
            if announcer is not None and announcer.is_silent(now_ns):
                outputs += self._announce(user, announcer, "", now_ns)
        return outputs

    def is_timely(self, user: str, stamp_ns: int) -> bool:
        """Return True if a cursor of `user` with this stamp is new, and must be passed to `on_cursor`."""
        pointer = self._people.get(user)
        if pointer is None:
            pointer = self._people[user] = PersonPointer(self._config, user, self._make)
        return pointer.is_timely(stamp_ns)

    def on_cursor(self, user: str, cursor: Cursor) -> list[OutgoingMessage]:
        """Process a timely cursor of `user`. Return their hover, claims, and cues without a number.

        While they hover nothing, a hover is returned every `EMPTY_PERIOD_NS` only.
        """
        pointer = self._people[user]
        now_ns = cursor.stamp_ns

        # Apply the person's method to the objects around the ray, or else to the one under the cursor
        view = None if self._is_by_metres else self._scene.view_from(cursor)
        tracked = self._positions.hit_test(cursor) if view is None else None
        under = None if tracked is None else tracked.id
        pointed = pointer.step(
            cursor,
            view,
            under,
            lambda object_id: self._ownership.action(user, object_id, now_ns)[0] != "",
            self._positions.is_pressed,
        )
        object_id, fired, _, is_shown, confidence, rival = pointed
        if pointer.is_new and object_id is not None:
            pointer.is_new = False
            if self._ownership.owner(object_id) == user:
                pointer.latch(object_id)  # another selector may have selected it just now
        if self._is_by_metres and (object_id is not None or fired is not None):
            view = self._scene.view_from(cursor)  # to tell how the object lies about the ray

        # Show the hovered object, with the effect of staying on it
        action: Action = ""
        taken_by = ""
        if object_id is not None:
            action, taken_by = self._effect_of_staying(user, pointer, object_id, pointed.progress, now_ns)
        hover = self._hover(user, cursor, view, pointed, (action, taken_by))
        outputs = [] if hover is None else [OutgoingMessage(user, hover)]
        if pointer.announcer is not None:
            outputs += self._announce(user, pointer.announcer, object_id or "", now_ns)

        # Reserve it once others can see that it is about to change
        is_about_to_change = is_shown and action in CHANGES
        if object_id is not None and is_about_to_change and not self._is_reserved(user, object_id, now_ns):
            outputs.append(OutgoingMessage(user, Claim(stamp_ns=now_ns, object_id=object_id, wish="reserve")))
        if rival is not None:
            names = f"{self._name(object_id)} or {self._name(rival)}"
            unclear = f"{names}? From here both may be meant: step closer, or point beside the other one"
            cue = make_cue("refused", unclear, now_ns, 0)
            outputs.append(OutgoingMessage(user, cue))

        # Claim the object on which the person stayed long enough
        if fired is not None:
            if confidence is None and view is not None:
                confidence = view.confidence(fired, self._aim_rad)
            outputs += self._toggle(user, fired, now_ns, "dwell", confidence)
        return outputs

    def on_button(self, user: str, button: ButtonEvent) -> list[OutgoingMessage]:
        """Process a button gesture of `user`, which confirms the hovered object if so configured."""
        pointer = self._people.get(user)
        if pointer is None or button.gesture != "press":
            return []
        object_id = pointer.press(button.stamp_ns)
        is_confirmed_by_press = pointer.is_confirmed_by_press
        if object_id == "" and is_confirmed_by_press:
            return [OutgoingMessage(user, make_cue("refused", "wait for the name", button.stamp_ns, 0))]
        if not object_id:
            return []
        if not is_confirmed_by_press and not self._positions.is_pressed(object_id):
            return []
        pointer.latch(object_id)
        return self._toggle(user, object_id, button.stamp_ns, "button")

    def on_step(self, user: str, step: Step) -> list[OutgoingMessage]:
        """Move `user` from the announced object to the one beside it, or to the nearest one."""
        pointer = self._people.get(user)
        if pointer is None or pointer.announcer is None:
            return []
        announcer = pointer.announcer
        object_id, now_ns = announcer.step(self._positions.objects.values(), step)
        return self._announce(user, announcer, object_id, now_ns) if object_id else []

    def _announce(
        self, user: str, announcer: NameAnnouncer, object_id: str, now_ns: int
    ) -> list[OutgoingMessage]:
        """Return the message about the name of the hovered object, or `""`, if one is due."""
        label = self._name(object_id) if object_id else ""
        announced = announcer.announce(object_id, label, now_ns)
        return [] if announced is None else [OutgoingMessage(user, announced)]

    def forget(self, user: str) -> None:
        """Forget the pointing of `user`, for whom another selector points from now on."""
        self._people.pop(user, None)
        self._empty_ns.pop(user, None)
        self._acts_here.pop(user, None)

    def forget_act(self, user: str) -> None:
        """Forget the last act of `user`, on which nobody decides."""
        self._acts_here.pop(user, None)

    def forget_acts(self) -> None:
        """Forget the acts of all, since nobody tells of them any more."""
        self._acts_here.clear()

    def renew(self) -> None:
        """Note that the objects that people point at may be selected already: owners are known only now."""
        for pointer in self._people.values():
            pointer.is_new = True

    def latch(self, object_id: str, user: str = "") -> None:
        """Keep `user`, or everybody, from changing an object again unintentionally while they stay on it."""
        for name, pointer in self._people.items():
            if pointer.hovered == object_id and user in ("", name):
                pointer.latch(object_id)

    def _toggle(
        self,
        user: str,
        object_id: str,
        now_ns: int,
        cause: Literal["dwell", "button"],
        confidence: float | None = None,
    ) -> list[OutgoingMessage]:
        """Return the claim to toggle an object. None if it has left, or it has no effect."""
        action, _taken_by = self._ownership.action(user, object_id, now_ns)
        if object_id not in self._positions.objects or not action:
            return []
        self._acts_here[user] = object_id, now_ns
        claim = Claim(
            stamp_ns=now_ns,
            object_id=object_id,
            wish="toggle",
            action=None if action == "refuse" else action,
            cause=cause,
            confidence=confidence,
        )
        return [OutgoingMessage(user, claim)]

    def _name(self, object_id: str | None) -> str:
        """Return the name of an object for people: its kind, or else its id."""
        tracked = self._positions.objects.get(object_id or "")
        if tracked is not None and tracked.kind:
            return tracked.kind
        return object_id or "nothing"

    def _effect_of_staying(
        self, user: str, pointer: PersonPointer, object_id: str, progress: float, now_ns: int
    ) -> tuple[Action, str]:
        """Return the effect of staying on the hovered object, and the other person who has it, or `""`."""
        action, taken_by = self._ownership.action(user, object_id, now_ns)
        is_done = pointer.is_latched(object_id) and progress == 0.0
        return ("", taken_by) if is_done else (action, taken_by)

    def _hover(
        self,
        user: str,
        cursor: Cursor,
        view: View | None,
        pointed: PointerResult,
        effect: tuple[Action, str],
    ) -> Hover | None:
        """Return the hover of `cursor`, or None if it is one without an object that is not due."""
        object_id = pointed.object_id
        stamp_ns = cursor.stamp_ns
        act_ns = self._act_here(user, object_id)

        # Most cursors are on nothing: those are sent at a lower rate
        if object_id is None:
            empty_ns = self._empty_ns.get(user)
            if empty_ns is not None and 0 <= stamp_ns - empty_ns < EMPTY_PERIOD_NS:
                return None
            self._empty_ns[user] = stamp_ns
        else:
            self._empty_ns.pop(user, None)
        self._sent[user] += 1
        seq = self._sent[user]
        if object_id is None:
            return _empty_hover(stamp_ns=stamp_ns, seq=seq)

        # On an object: where the cursor is shown on it, and how far the ray misses it
        snapped_m: Vec3 | None = None
        snapped_position_m: float | None = None
        miss_rad: float | None = None
        if view is not None:
            snapped = view.snapped(object_id, cursor, self._snap_rad)
            if snapped is not None:
                snapped_m, snapped_position_m = snapped
            miss_rad = view.miss_rad(object_id, cursor)
        action, taken_by = effect
        return Hover(
            stamp_ns=stamp_ns,
            seq=seq,
            object_id=object_id,
            progress=pointed.progress,
            action=action,
            taken_by=taken_by,
            is_selected=self._ownership.is_selected(object_id),
            snapped_m=snapped_m,
            snapped_position_m=snapped_position_m,
            miss_rad=miss_rad,
            act_ns=act_ns,
        )

    def _act_here(self, user: str, object_id: str | None) -> int | None:
        """Return the stamp of the last act of `user` on what they hover, ns, or None. Forget others."""
        if user not in self._acts_here:
            return None
        acted_id, act_ns = self._acts_here[user]
        if acted_id == object_id:
            return act_ns
        del self._acts_here[user]
        return None


class PointingEngine:
    """Pointing that the selector of a site and its shards have in common."""

    _hovers: HoverEngine
    _ownership: Ownership

    def fault(self) -> str:
        """Return the reason why the method fails for a person, or `""`."""
        return self._hovers.fault()

    def on_step(self, user: str, step: Step) -> list[OutgoingMessage]:
        """Move `user` from the announced object to the one beside it, or to the nearest one."""
        return self._hovers.on_step(user, step)

    def manner(self, now_ns: int) -> SelectionManner:
        """Return the way in which people select the present objects."""
        return self._hovers.manner(now_ns)

    def stale_trackers(self, now_ns: int) -> list[str]:
        """Return the trackers that are silent, so that their objects cannot be hovered."""
        return self._ownership.positions.silent(now_ns)

    def on_map(self, environment: Environment) -> list[OutgoingMessage]:
        """Set the lines on which objects move."""
        self._hovers.on_map(environment)
        return []

    def set_present(self, user: str, present: bool, now_ns: int) -> list[OutgoingMessage]:
        """Record the presence of `user`."""
        self._ownership.presences.set_present(user, now_ns, present=present)
        return []
