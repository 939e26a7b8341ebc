"""The complete selection logic: pointing in; hovers, the selection, its events and cues out."""

import math
from collections.abc import Callable, Mapping, Sequence

from pointit.schemas import (
    ButtonEvent,
    ConveyorState,
    Cursor,
    Environment,
    Selection,
    SelectionEvent,
    TrackedObjects,
)
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.methods.method import MakeMethod, is_by_angle, make_method
from pointit.services.selector.methods.pointer import PersonPointer, PointerResult
from pointit.services.selector.objects.departures import OWN, Departures
from pointit.services.selector.objects.object_positions import ObjectPositions
from pointit.services.selector.objects.scene import Scene
from pointit.services.selector.objects.view import View
from pointit.services.selector.outputs import Action, Cause, Output, Owned, Record
from pointit.services.selector.ownership.ledger import Ledger
from pointit.services.selector.ownership.reservations import Reservations
from pointit.services.selector.ownership.user_presence import UserPresence
from pointit.services.selector.selection_publisher import SelectionPublisher


class SelectionEngine:
    """The selection of a site, controlled by the pointing of all people.

    Stamps decide, not the order of arrival: late and duplicate cursors are ignored, and a clock that was set
    back resets the person's state. Every event is passed to `record` before it is returned, for a journal.
    """

    def __init__(
        self, config: SelectorConfig, record: Callable[[Record], None], make: MakeMethod = make_method
    ) -> None:
        """Create with nothing selected, no people and an empty scene. `make` makes the method of each."""
        self._config = config
        self._make = make
        self._is_by_metres = not is_by_angle(config)
        self._aim_rad = math.radians(config.gauge.aim_sigma_deg)
        self._positions = ObjectPositions(
            margin_m=config.margin_m,
            stale_after_s=config.objects_stale_after_s,
            display_lag_s=config.display_lag_s,
            ended_after_s=config.unseen_after_s,
            lead_s=config.lead_s,
        )
        self._scene = Scene(
            stale_after_s=config.objects_stale_after_s,
            display_lag_s=config.display_lag_s,
            reach_rad=math.radians(
                max(config.gauge.sparse_deg, 4.0 * config.gauge.aim_sigma_deg, 4.0 * config.gauge.snap_deg)
            ),
            leave_factor=config.gauge.leave_factor,
            aim=config.gauge.aim,
        )
        self._presences = UserPresence(config.ownerless_after_s)
        self._ledger = Ledger(self._presences.is_gone, self._positions.too_late, undo_steps=config.undo_steps)
        self._reservations = Reservations(config.reserve_s)
        self._departures = Departures(config.left_after_s, config.unseen_after_s)
        self._people: dict[str, PersonPointer] = {}
        self._publisher = SelectionPublisher(
            record, method=config.method, snap_rad=math.radians(config.gauge.snap_deg)
        )

    def use(self, config: SelectorConfig) -> None:
        """Change the method or its times. Selections and reservations stay."""
        self._config = config
        self._is_by_metres = not is_by_angle(config)
        self._publisher.method = config.method
        for pointer in self._people.values():
            pointer.use(config)

    def restore(self, entries: Mapping[str, Owned], events: int, now_ns: int) -> None:
        """Restore what was selected before a restart, and continue numbering after `events`."""
        self._ledger.restore(entries)
        self._publisher.resume_numbering(events)
        for entry in entries.values():
            self._presences.on_activity(entry.user, now_ns)
        self._departures.expect(entries, now_ns)

    def fault(self) -> str:
        """Return the reason why the method fails for a person, or `""`."""
        return next((pointer.fault for pointer in self._people.values() if pointer.fault), "")

    @property
    def has_selected(self) -> bool:
        """Return True if anything is selected."""
        return bool(self._ledger.entries)

    def selection(self, now_ns: int) -> Selection:
        """Return the current selection and reservations."""
        return self._publisher.selection(now_ns, self._ledger.objects(), self._reservations.objects())

    def stale_trackers(self, now_ns: int) -> list[str]:
        """Return the trackers silent for so long that their objects cannot be hovered."""
        return self._positions.silent(now_ns)

    def on_map(self, environment: Environment) -> list[Output]:
        """Set the lines on which objects move."""
        self._scene.on_map(environment)
        return []

    def on_objects(self, tracker: str, objects: TrackedObjects) -> list[Output]:
        """Update the objects of `tracker`. What it has not listed for a while has left."""
        for forgotten in self._positions.update(tracker, objects):
            self._scene.forget(forgotten)
        self._scene.update(tracker, objects)
        return self._depart(objects.stamp_ns, tracker)

    def on_conveyor(self, state: ConveyorState) -> list[Output]:
        """Close the entries of objects that have left the conveyor, with time and bay of departure."""
        left: list[Record] = []
        for gone in state.departures:
            if gone.object_id in self._ledger.entries:
                where = f"left at bay {gone.bay}" if gone.bay else ""
                left += self._ledger.drop((gone.object_id,), gone.stamp_ns, where)
        return self._close(left, state.stamp_ns)

    def on_event(self, event: SelectionEvent) -> list[Output]:
        """Revert what the conveyor refuses: it was accepted here but reached the conveyor too late."""
        if event.event != "refused" or event.cause:  # its own refusals have a cause
            return []
        now_ns = event.stamp_ns
        record = self._ledger.correct(event.object_id, now_ns, event.reason)
        if record is None:
            return []
        self._latch(event.object_id)
        outputs = [Output("", self.selection(now_ns)), *self._publisher.event(record)]
        return [*outputs, self._publisher.cue(record.owner, "refused", event.reason, now_ns)]

    def on_cursor(self, user: str, cursor: Cursor) -> list[Output]:
        """Process a cursor of `user`."""
        pointer = self._people.get(user)
        if pointer is None:
            pointer = self._people[user] = PersonPointer(self._config, user, self._make)
        if not pointer.is_timely(cursor.stamp_ns):
            return []
        now_ns = cursor.stamp_ns
        self._presences.on_activity(user, now_ns)
        is_news = self._reservations.expire(now_ns)
        view = None if self._is_by_metres else self._scene.view_from(cursor)
        tracked = self._positions.hit_test(cursor) if view is None else None
        pointed = pointer.step(
            cursor,
            view,
            None if tracked is None else tracked.id,
            lambda object_id: self._action(user, object_id, now_ns)[0] != "",
        )
        if self._is_by_metres and (pointed.object_id is not None or pointed.fired is not None):
            view = self._scene.view_from(cursor)  # to tell how the object lies about the ray
        action, taken_by = self._standing(user, pointer, pointed, now_ns)
        if pointed.is_shown and pointed.object_id and action in ("select", "deselect"):
            is_news |= self._reservations.reserve(pointed.object_id, user, now_ns)
        is_selected = pointed.object_id in self._ledger.entries
        outputs = [
            self._publisher.hover(
                user, cursor, view, pointed, action=action, taken_by=taken_by, is_selected=is_selected
            )
        ]
        if pointed.fired is not None:
            outputs += self._act(user, pointed.fired, now_ns, "dwell", view)
        if is_news and not any(isinstance(output.message, Selection) for output in outputs):
            outputs.append(Output("", self.selection(now_ns)))
        return outputs

    def on_button(self, user: str, button: ButtonEvent) -> list[Output]:
        """Process a button gesture of `user`, which confirms the hovered object if so configured."""
        pointer = self._people.get(user)
        wanted = self._config.confirm == "press" and button.gesture == self._config.confirm_gesture
        if pointer is None or not wanted:
            return []
        object_id = pointer.press(button.stamp_ns)
        if object_id is None:
            return []
        outputs = self._act(user, object_id, button.stamp_ns, "button", None)
        pointer.latch(object_id)
        return outputs

    def set_present(self, user: str, present: bool, now_ns: int) -> list[Output]:  # noqa: FBT001 - as announced
        """Record the presence of `user`."""
        self._presences.set_present(user, now_ns, present=present)
        return []

    def tick(self, now_ns: int) -> list[Output]:
        """Handle ended trackers, departed objects and expired reservations."""
        for tracker in self._positions.forget(now_ns):
            self._scene.forget(tracker)
        is_news = self._reservations.expire(now_ns)
        outputs = self._depart(now_ns)
        if is_news and not outputs:
            outputs.append(Output("", self.selection(now_ns)))
        return outputs

    def undo(self, user: str, now_ns: int) -> list[Output]:
        """Undo `user`'s last step. Refused with a cue if there is none."""
        records = self._ledger.undo(user, now_ns, self._positions.objects)
        if not records:
            return [self._publisher.cue(user, "refused", "there is nothing to take back", now_ns)]
        return self._publish(user, records, now_ns)

    def clear(self, user: str, now_ns: int) -> list[Output]:
        """Deselect all objects of `user`."""
        return self._publish(user, self._ledger.clear(user, now_ns), now_ns)

    def release(self, user: str, object_id: str, take_over: bool, now_ns: int) -> list[Output]:  # noqa: FBT001
        """Deselect `object_id`, regardless of its owner, or take it over.

        `user` is the caller: a supervisor, or the person who wants it.
        """
        entry = self._ledger.entries.get(object_id)
        records = self._ledger.release(object_id, user, now_ns, take_over=take_over)
        if entry is None or not records:
            status = "is not selected" if entry is None else "is yours already"
            return [self._publisher.cue(user, "refused", f"object {object_id} {status}", now_ns)]
        outputs = self._publish(user, records, now_ns)
        if entry.user != user and records[0].event != "refused":
            done = "taken over" if take_over else "released"
            text = f"{entry.kind or 'object'} was {done} by {user}"
            outputs.append(self._publisher.cue(entry.user, "deselected", text, now_ns))
        return outputs

    def _action(self, user: str, object_id: str, now_ns: int) -> tuple[Action, str]:
        """Return the effect of staying on an object, and the other person who has it, or `""`."""
        owner = self._ledger.blocking_owner(object_id, user, now_ns)
        if owner:
            return "refuse", owner
        holder = self._reservations.holder(object_id)
        if holder and holder != user:
            return "refuse", holder
        is_selected = object_id in self._ledger.entries
        if is_selected and self._config.mode == "select_only":
            return "", ""
        if self._positions.too_late(object_id, now_ns):
            return "refuse", ""
        return ("deselect" if is_selected else "select"), ""

    def _standing(
        self, user: str, pointer: PersonPointer, pointed: PointerResult, now_ns: int
    ) -> tuple[Action, str]:
        """Return the effect of staying on the hovered object, and the other person who has it, or `""`."""
        object_id = pointed.object_id
        if object_id is None:
            return "", ""
        action, taken_by = self._action(user, object_id, now_ns)
        is_done = pointer.is_latched(object_id) and pointed.progress == 0.0
        return ("", taken_by) if is_done else (action, taken_by)

    def _act(self, user: str, object_id: str, now_ns: int, cause: Cause, view: View | None) -> list[Output]:
        """Apply the effect of staying on an object or pressing."""
        tracked = self._positions.objects.get(object_id)
        if tracked is None:  # it has left in the meantime
            return []
        kind = tracked.kind
        action, taken_by = self._action(user, object_id, now_ns)
        confidence = None if view is None else view.confidence(object_id, self._aim_rad)
        if action == "":
            return []
        if taken_by and object_id not in self._ledger.entries:
            record = Record(
                stamp_ns=now_ns,
                event="refused",
                object_id=object_id,
                kind=kind,
                user=user,
                cause=cause,
                confidence=confidence,
                reason=f"{kind or 'object'} is being selected by {taken_by}; wait or choose another one",
            )
        else:
            record = self._ledger.toggle(object_id, kind, user, now_ns, cause=cause, confidence=confidence)
            if record.event != "refused":
                self._reservations.free(object_id)
        return self._publish(user, [record], now_ns)

    def _depart(self, now_ns: int, clock: str = OWN) -> list[Output]:
        entries = self._ledger.entries
        if not entries:
            return []
        left = self._departures.step(entries, self._positions.objects, now_ns, clock)
        return self._close(self._ledger.drop(left, now_ns), now_ns)

    def _close(self, left: Sequence[Record], now_ns: int) -> list[Output]:
        """Free and journal objects that have left. Return the selection if there are any."""
        for record in left:
            self._reservations.free(record.object_id)
            self._publisher.write(record)
        return [Output("", self.selection(now_ns))] if left else []

    def _publish(self, user: str, records: Sequence[Record], now_ns: int) -> list[Output]:
        """Return the messages for `records`, the selection first."""
        outputs: list[Output] = []
        if any(record.event != "refused" for record in records):
            outputs.append(Output("", self.selection(now_ns)))
        for record in records:
            outputs += self._publisher.event(record)
            if record.cause not in ("dwell", "button"):
                self._latch(record.object_id)
        return outputs + self._publisher.cues(user, records, now_ns)

    def _latch(self, object_id: str) -> None:
        """Keep people who rest on an object from changing it again unintentionally."""
        for pointer in self._people.values():
            if pointer.hovered == object_id:
                pointer.latch(object_id)
