"""Pointing of people: cursors and objects in; hovers and claims to objects out. It decides on no object."""

import math
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Literal

from pointit.schemas import NS_PER_S, ButtonEvent, Claim, Cursor, Environment, Hover, Step, TrackedObjects
from pointit.schemas.base import unchecked
from pointit.schemas.selection import MAX_PRESSED, SelectionManner, SelectsBy
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.methods.pointer import MakeMethod, PersonPointer, PointerResult, is_by_angle
from pointit.services.selector.ownership import Ownership
from pointit.services.selector.seen_objects import SPARSE_RAD, SeenObjects, View
from pointit.services.selector.selection_methods import NameAnnouncer
from pointit.services.selector.selection_publisher import CHANGES, Action, Output, make_cue

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
            ownership: tells what each person may do with an object. Its objects are updated here.
            make: makes the method of each person.
            is_reserved: returns True if a person need not claim, at a time, ns, a reservation of an object
                that they are about to change.
        """
        self._config = config
        self._make = make
        self._is_reserved = is_reserved
        self._ownership = ownership
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
        self._people: dict[str, PersonPointer] = {}
        self._sent: Counter[str] = Counter()
        """Number of hovers by person."""
        self._empty_ns: dict[str, int] = {}
        """Stamp of the last hover of each person whose last hover had no object, ns."""

    def use(self, config: SelectorConfig) -> None:
        """Change the method or its times."""
        self._config = config
        self._is_by_metres = not is_by_angle(config)
        for pointer in self._people.values():
            pointer.use(config)

    def fault(self) -> str:
        """Return the reason why the method fails for a person, or `""`."""
        return next((pointer.fault for pointer in self._people.values() if pointer.fault), "")

    def on_map(self, environment: Environment) -> None:
        """Set the lines on which objects move, and what tracked objects do."""
        self._scene.on_map(environment)
        self._things = {each.id: each.object_fields for each in environment.things if each.is_tracked}
        self._pressed_things = {each.id: (each.label or each.id, each.press) for each in environment.things}

    def manner(self, stamp_ns: int) -> SelectionManner:
        """Return the manner of selecting the present objects, and the map things before they are present."""
        by: SelectsBy = "press" if self._config.confirm == "press" else "stay"
        announcer = next((each.announcer for each in self._people.values() if each.announcer), None)
        names_by: SelectsBy | None = (
            None if announcer is None else "press" if announcer.is_pressed else "stay"
        )
        wants_press = dict(self._pressed_things)
        for one in self._positions.objects.values():
            wants_press[one.id] = (one.kind or one.id, one.press)
        pressed = [name for name, is_pressed in wants_press.values() if is_pressed]
        if by == "press" or not pressed or len(pressed) == len(wants_press):
            by = "press" if pressed else by
            return SelectionManner(stamp_ns=stamp_ns, by=by, names_by=names_by)
        few = tuple(sorted(set(pressed)))[:MAX_PRESSED]
        return SelectionManner(
            stamp_ns=stamp_ns, by=by, pressed=few, pressed_count=len(pressed), names_by=names_by
        )

    def on_objects(self, tracker: str, objects: TrackedObjects) -> None:
        """Update the objects of `tracker`."""
        if self._things and any(one.id in self._things for one in objects.objects):
            listed = tuple(one.model_copy(update=self._things.get(one.id)) for one in objects.objects)
            objects = objects.model_copy(update={"objects": listed})
        for forgotten in self._positions.update(tracker, objects):
            self._scene.forget(forgotten)
        self._scene.update(tracker, objects)

    def forget_ended(self, now_ns: int) -> list[Output]:
        """Forget the objects of trackers and carriers that have ended. End the names of people likewise."""
        for tracker in self._positions.forget(now_ns):
            self._scene.forget(tracker)
        self._ownership.acts.forget_absent(now_ns)
        outputs: list[Output] = []
        for user, pointer in self._people.items():
            if (announcer := pointer.announcer) is not None and announcer.is_silent(now_ns):
                outputs += self._announce(user, announcer, "", now_ns)
        return outputs

    def is_timely(self, user: str, stamp_ns: int) -> bool:
        """Return True if a cursor of `user` with this stamp is new, and must be passed to `on_cursor`."""
        pointer = self._people.get(user)
        if pointer is None:
            pointer = self._people[user] = PersonPointer(self._config, user, self._make)
        return pointer.is_timely(stamp_ns)

    def on_cursor(self, user: str, cursor: Cursor) -> list[Output]:
        """Process a timely cursor of `user`. Return their hover, claims, and cues without a number.

        While they hover nothing, a hover is returned every `EMPTY_PERIOD_NS` only.
        """
        pointer = self._people[user]
        now_ns = cursor.stamp_ns
        view = None if self._is_by_metres else self._scene.view_from(cursor)
        tracked = self._positions.hit_test(cursor) if view is None else None
        pointed = pointer.step(
            cursor,
            view,
            None if tracked is None else tracked.id,
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
        standing: tuple[Action, str] = ("", "")
        if object_id is not None:
            standing = self._standing(user, pointer, object_id, pointed.progress, now_ns)
        hover = self._hover(user, cursor, view, pointed, standing)
        outputs = [] if hover is None else [Output(user, hover)]
        if pointer.announcer is not None:
            outputs += self._announce(user, pointer.announcer, object_id or "", now_ns)
        wanted = object_id if is_shown and standing[0] in CHANGES else None
        if wanted is not None and not self._is_reserved(user, wanted, now_ns):
            outputs.append(Output(user, Claim(stamp_ns=now_ns, object_id=wanted, wish="reserve")))
        if rival is not None:
            names = " or ".join(self._name(each) for each in (object_id, rival))
            unclear = f"{names}? From here both may be meant: step closer, or point beside the other one"
            outputs.append(Output(user, make_cue("refused", unclear, now_ns, 0)))
        if fired is not None:
            if confidence is None and view is not None:
                confidence = view.confidence(fired, self._aim_rad)
            outputs += self._toggle(user, fired, now_ns, "dwell", confidence)
        return outputs

    def on_button(self, user: str, button: ButtonEvent) -> list[Output]:
        """Process a button gesture of `user`, which confirms the hovered object if so configured."""
        pointer = self._people.get(user)
        if pointer is None or button.gesture != "press":
            return []
        object_id = pointer.press(button.stamp_ns)
        if object_id == "" and pointer.is_confirmed_by_press:
            return [Output(user, make_cue("refused", "wait for the name", button.stamp_ns, 0))]
        if not object_id or not (pointer.is_confirmed_by_press or self._positions.is_pressed(object_id)):
            return []
        pointer.latch(object_id)
        return self._toggle(user, object_id, button.stamp_ns, "button")

    def on_step(self, user: str, step: Step) -> list[Output]:
        """Move `user` from the announced object to the one beside it, or to the nearest one."""
        pointer = self._people.get(user)
        if pointer is None or (announcer := pointer.announcer) is None:
            return []
        object_id, now_ns = announcer.step(self._positions.objects.values(), step)
        return self._announce(user, announcer, object_id, now_ns) if object_id else []

    def _announce(self, user: str, announcer: NameAnnouncer, object_id: str, now_ns: int) -> list[Output]:
        announced = announcer.announce(object_id, self._name(object_id) if object_id else "", now_ns)
        return [] if announced is None else [Output(user, announced)]

    def forget(self, user: str) -> None:
        """Forget the pointing of `user`, for whom another selector points from now on."""
        self._people.pop(user, None)
        self._empty_ns.pop(user, None)

    def renew(self) -> None:
        """Note that what people rest on may be selected already, since owners are known only now."""
        for pointer in self._people.values():
            pointer.is_new = True

    def latch(self, object_id: str, user: str = "") -> None:
        """Keep `user`, or everybody, from changing an object that they rest on again unintentionally."""
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
    ) -> list[Output]:
        """Return the claim to toggle an object. None if it has left, or it has no effect."""
        action = self._ownership.action(user, object_id, now_ns)[0]
        if object_id not in self._positions.objects or not action:
            return []
        claim = Claim(
            stamp_ns=now_ns,
            object_id=object_id,
            wish="toggle",
            action=None if action == "refuse" else action,
            cause=cause,
            confidence=confidence,
        )
        return [Output(user, claim)]

    def _name(self, object_id: str | None) -> str:
        tracked = self._positions.objects.get(object_id or "")
        return (tracked.kind if tracked is not None else "") or object_id or "nothing"

    def _standing(
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
        standing: tuple[Action, str],
    ) -> Hover | None:
        object_id = pointed.object_id
        stamp_ns = cursor.stamp_ns
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
        snapped = None if view is None else view.snapped(object_id, cursor, self._snap_rad)
        return Hover(
            stamp_ns=stamp_ns,
            seq=seq,
            object_id=object_id,
            progress=pointed.progress,
            action=standing[0],
            taken_by=standing[1],
            is_selected=self._ownership.is_selected(object_id),
            snapped_m=None if snapped is None else snapped[0],
            snapped_position_m=None if snapped is None else snapped[1],
            miss_rad=None if view is None else view.miss_rad(object_id, cursor),
        )


class PointingEngine:
    """Pointing that the selector of a site and its shards have in common."""

    _hovers: HoverEngine
    _ownership: Ownership

    def fault(self) -> str:
        """Return the reason why the method fails for a person, or `""`."""
        return self._hovers.fault()

    def on_step(self, user: str, step: Step) -> list[Output]:
        """Move `user` from the announced object to the one beside it, or to the nearest one."""
        return self._hovers.on_step(user, step)

    def manner(self, now_ns: int) -> SelectionManner:
        """Return the way in which people select the objects that are there."""
        return self._hovers.manner(now_ns)

    def stale_trackers(self, now_ns: int) -> list[str]:
        """Return the trackers silent for a time after which their objects cannot be hovered."""
        return self._ownership.positions.silent(now_ns)

    def on_map(self, environment: Environment) -> list[Output]:
        """Set the lines on which objects move."""
        self._hovers.on_map(environment)
        return []

    def set_present(self, user: str, present: bool, now_ns: int) -> list[Output]:
        """Record the presence of `user`."""
        self._ownership.presences.set_present(user, now_ns, present=present)
        return []
