"""Decisions on objects: claims and requests of people in; the selection, its events and cues out."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

from pointit.runtime.bus.timeliness import MAX_AHEAD_NS
from pointit.schemas import (
    NS_PER_S,
    ActOutcome,
    ActResult,
    Claim,
    ConveyorState,
    SelectedObject,
    Selection,
    SetThing,
    ThingStates,
)
from pointit.schemas.selection import NOT_DONE, REPORTED, RESTORED
from pointit.services.selector.act_states import ActStates
from pointit.services.selector.acts import PendingAct
from pointit.services.selector.claim_budget import ClaimBudget
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.earlier_claims import EarlierClaims
from pointit.services.selector.object_positions import OWN, Departures
from pointit.services.selector.ownership import ObjectChange, Ownership
from pointit.services.selector.selection_publisher import (
    ACTIONS,
    CHANGES,
    OutgoingMessage,
    Owned,
    Record,
    SelectionPublisher,
)

MAX_CLAIM_AGE_NS = 5 * NS_PER_S
"""Claims of shards that are older are refused: the person has gone on since, ns of the wall."""

MAX_RESERVED = 2
"""Limit of objects that a shard can reserve for a person: the one that they point at and the one before."""

MAX_PRESS_DELAY_NS = 200_000_000
"""Time after the stamp of a press from which its button counts as shown later, ns: headsets send it late."""
SHOWN_NS = 600_000_000
"""Time for which a button is selected at least, ns. It ends with the next tick."""

MIN_PERIOD_NS = 50_000_000
"""Minimum time between selections that only claims to reservations have changed, ns."""


class Arbiter:
    """The owner of each object: the first person who points at it steadily, or presses.

    Pointing alone decides nothing. A person's side makes a `Claim` (*I have stayed on box_3 for a second*),
    and the arbiter answers with events: selected, refused because ben has it, deselected. A site has one
    arbiter, so that two people on two machines cannot both own a box.

    Every event is passed to `record`, a journal, before it is returned and published. What somebody has seen
    is therefore not lost when the selector is killed.
    """

    def __init__(
        self,
        config: SelectorConfig,
        ownership: Ownership,
        record: Callable[[Record], None],
        latch: Callable[[str, str], None],
    ) -> None:
        """Create with nothing decided.

        Args:
            config: parameters.
            ownership: entries and reservations, changed here alone, and the objects.
            record: called with each event.
            latch: called with each object that is changed other than by dwelling or pressing here, and with
                the person who changed it, or `""` if everybody is to leave it first.
        """
        # Objects, their owners and reservations
        self._ownership = ownership
        self._ledger = ownership.ledger
        self._reservations = ownership.reservations
        self._positions = ownership.positions
        self.acts = ownership.acts
        """Carriers of things and their acts, which readers may ask. Changed here alone."""
        self._act_states = ActStates()
        self._latch = latch
        self._departures = Departures(config.unseen_after_s)

        # Messages
        self._publisher = SelectionPublisher(record, method=config.method)
        self._dwell_s = config.dwell_s
        self._tells_method = False
        self.speed = 1.0
        """Speed of the site's time by the wall's. Ages of claims are those of the wall."""
        self._has_changed = False
        """True if reservations have changed since the last selection that was returned."""

        # Claims of each person
        self._earlier_claims = EarlierClaims()
        self._budget = ClaimBudget()
        self._selected_ns = 0
        """Time of the last selection, ns."""
        self._shown_ns: dict[tuple[str, int], int] = {}
        """Time since which each fired button is shown, ns, by id and stamp of the press."""

    def use(self, config: SelectorConfig) -> None:
        """Note a change of the method or its times."""
        self._publisher.method = config.method
        self._dwell_s = config.dwell_s
        self._has_changed |= self._tells_method

    def tell_method(self) -> None:
        """Put method and dwell time in selections from now on, for shards."""
        self._tells_method = self._has_changed = True

    def restore(
        self,
        entries: Mapping[str, Owned],
        events: int,
        now_ns: int,
        *,
        decided: Iterable[tuple[str, int]] = (),
        pending: Iterable[tuple[Record, bool]] = (),
        carried: Iterable[tuple[str, str]] = (),
    ) -> None:
        """Restore what was selected before a restart, and wait for the results of acts.

        Args:
            entries: selected objects by id.
            events: number of the last event.
            now_ns: time, ns.
            decided: persons and stamps of the last claims, which may come again.
            pending: events whose result was not reported, and whether each is the last one of its object.
            carried: things and their carriers, for which acts wait.
        """
        self._ledger.restore(entries)
        self._publisher.resume_numbering(events)

        # Owners and objects get their full time to appear again
        for entry in entries.values():
            self._ownership.presences.on_activity(entry.user, now_ns)
        self._departures.expect(entries, now_ns)

        # Claims that may be sent again, and acts without a result
        for user, stamp_ns in decided:
            self._earlier_claims.is_decided(user, stamp_ns)
        for record, is_newest in pending:
            self.acts.resume(record, is_newest=is_newest)
            self._act_states.begin(record, record.stamp_ns)
        self.acts.expect(carried)

    def repeat_outcomes(self, outcomes: Iterable[ActOutcome]) -> list[OutgoingMessage]:
        """Return the messages of outcomes that may not have been published before a restart."""
        outputs: list[OutgoingMessage] = []
        for outcome in outcomes:
            self._act_states.restore(outcome)
            outputs.append(self._publisher.outcome(outcome.model_copy(update={"is_repeated": True})))
        return outputs

    def knows_things(self, *things: str) -> bool:
        """Return True if it is known of these things and all that is selected where they are and who acts.

        Just after a start it is not: neither objects nor carriers have been received.
        """
        objects = self._positions.objects
        is_listed = all(name in objects for name in (*things, *self._ledger.entries))
        return is_listed and self._positions.has_trackers and not self.acts.is_awaiting

    @property
    def has_selected(self) -> bool:
        """Return True if anything is selected."""
        return bool(self._ledger.entries)

    def selection(self, now_ns: int) -> Selection:
        """Return the current selection and reservations."""
        self._has_changed = False
        self._selected_ns = now_ns
        dwell_s = self._dwell_s if self._tells_method else None
        objects: list[SelectedObject] = []
        for selected in self._ledger.objects():
            # several acts may end at once, and are told one after the other
            is_pending = self.acts.is_pending(selected.id) or self._act_states.is_asked(selected.id)
            if is_pending:
                objects.append(selected.model_copy(update={"is_pending": True}))
            else:
                objects.append(selected)
        reserved = self._reservations.objects()
        selection = self._publisher.selection(
            now_ns, tuple(objects), reserved, self._act_states.all(), dwell_s
        )
        return selection.model_copy(update={"undoable": self._ledger.undoable_users()})

    def changed_selection(self, now_ns: int) -> list[OutgoingMessage]:
        """Return the selection if it has changed since it was returned last."""
        if not self._has_changed:
            return []
        return [OutgoingMessage("", self.selection(now_ns))]

    def on_activity(self, user: str, now_ns: int) -> None:
        """Note that `user` is active, and free expired reservations."""
        self._ownership.presences.on_activity(user, now_ns)
        self._has_changed |= self._reservations.expire(now_ns)

    def claim(self, user: str, claim: Claim, now_ns: int, refused: str = "") -> list[OutgoingMessage]:
        """Decide on a claim: select or deselect, or refuse it.

        Args:
            user: person who wants the object.
            claim: what they want. One with the stamp of an earlier one is that one again, and ignored.
            now_ns: time from which a reservation counts, ns. An event has the stamp of its claim.
            refused: reason for which it is refused anyway, or `""`.
        """
        object_id = claim.object_id
        at_ns = claim.stamp_ns
        cause = claim.cause
        action, taken_by = self._ownership.action(user, object_id, now_ns)
        if claim.wish == "reserve":
            if action in CHANGES and not refused:
                self._has_changed |= self._reservations.reserve(object_id, user, now_ns)
            return []
        if self._earlier_claims.is_decided(user, at_ns):
            return []

        # Reasons against it. The first counts
        tracked = self._positions.objects.get(object_id)
        kind = "" if tracked is None else tracked.kind
        name = kind or "object"
        reason = refused
        if not reason and taken_by and not self._ownership.is_selected(object_id):
            reason = f"{name} is being selected by {taken_by}; wait or choose another one"
        is_shard_dwell = self._tells_method and cause == "dwell"
        if not reason and is_shard_dwell and self._earlier_claims.is_twice(user, claim, self._dwell_s):
            reason = f"{name} was changed by you just now: leave it, then point again"

        # Without one the ledger decides, which refuses what belongs to another person
        if reason:
            change = self._ledger.refuse(
                object_id, kind, user, at_ns, cause=cause, confidence=claim.confidence, reason=reason
            )
        else:
            change = self._ledger.toggle(
                object_id,
                kind,
                user,
                at_ns,
                cause=cause,
                confidence=claim.confidence,
            )
        if not change.is_refused:
            self._reservations.free(object_id)
            if cause == "dwell":
                self._earlier_claims.add_dwell(user, object_id, at_ns)
        return self._publish(user, [change], at_ns)

    def on_claim(self, user: str, claim: Claim, now_ns: int) -> list[OutgoingMessage]:
        """Decide on a claim of a shard, which may come late and know less.

        While no objects are known, just after a start, none is decided, nor while it is not known whether the
        carrier of its object runs: the shard sends it again. So it does with those above the budget of the
        person.
        """
        if not self._budget.allows(user, claim, now_ns):
            return []
        is_known = self._positions.has_trackers and not self.acts.is_awaited(claim.object_id)
        if claim.wish == "toggle" and not is_known:
            return []
        self.on_activity(user, now_ns)
        refusal = self._refusal(user, claim, now_ns)
        outputs = self.claim(user, claim, now_ns, refusal)
        if claim.wish == "toggle":
            self._latch(claim.object_id, user)
            return outputs + self.changed_selection(now_ns)
        self._has_changed |= self._reservations.keep_last(user, MAX_RESERVED)
        is_soon = 0 <= now_ns - self._selected_ns < MIN_PERIOD_NS
        if is_soon:  # the selection is returned with the next cursor, claim or tick
            return outputs
        return outputs + self.changed_selection(now_ns)

    def excess(self, now_ns: int) -> str:
        """Return a warning about people whose claims are ignored, or `""`."""
        return self._budget.problem(now_ns)

    def _refusal(self, user: str, claim: Claim, now_ns: int) -> str:
        """Return the reason for which a claim of a shard cannot be granted, or `""`."""
        tracked = self._positions.objects.get(claim.object_id)
        kind = "object"
        if tracked is not None and tracked.kind:
            kind = tracked.kind

        # It came too late, or by a wrong clock
        age_ns = (now_ns - claim.stamp_ns) / max(1.0, self.speed)
        age_s = age_ns / NS_PER_S
        if age_ns > MAX_CLAIM_AGE_NS:
            return (
                f"{kind} was asked for {age_s:.0f} s ago: point again (the connection of your machine was "
                "interrupted, or its clock is behind)"
            )
        if -age_ns > MAX_AHEAD_NS:
            return f"{kind} cannot be given: the clock of your machine is {-age_s:.0f} s ahead, set it right"
        if tracked is None:
            return f"{kind} has left"

        # It would have no effect
        action, taken_by = self._ownership.action(user, claim.object_id, now_ns)
        if not action:
            return f"{kind} is selected already"
        if taken_by:  # `claim` gives the reason
            return ""
        refusal = self._ownership.refusal(claim.object_id, now_ns)
        if refusal:
            return refusal

        # It would have another effect than the person has seen
        has_other_effect = claim.action is not None and claim.action != action
        if has_other_effect or claim.stamp_ns <= self._ledger.changed_ns(claim.object_id):
            status = "selected" if self._ownership.is_selected(claim.object_id) else "deselected"
            return f"{kind} was {status} in the meantime: point again to change that"
        return ""

    def on_conveyor(self, state: ConveyorState) -> list[OutgoingMessage]:
        """Close the entries of objects that have left the conveyor, with time and bay of departure."""
        records: list[Record] = []
        for departure in state.departures:
            if departure.object_id in self._ledger.entries:
                reason = f"left at bay {departure.bay}" if departure.bay else ""
                records += self._ledger.drop((departure.object_id,), departure.stamp_ns, reason)
        return self._close_entries(records, state.stamp_ns)

    def on_result(self, carrier: str, result: ActResult, now_ns: int) -> list[OutgoingMessage]:
        """Note the result of an act by a carrier."""
        act = self.acts.on_result(carrier, result)
        return [] if act is None else self._conclude(act, now_ns)

    def on_states(self, carrier: str, states: ThingStates, now_ns: int) -> list[OutgoingMessage]:
        """Note the states that a carrier reports, and give its switches these.

        They have the last results, too, which it may have reported while no selector ran.
        """
        known_things = self.acts.on_states(carrier, states)

        # All are noted before the first is concluded, which follows the targets of all others
        ended_acts: list[PendingAct] = []
        for state in states.things:
            if state.last:
                act = self.acts.settle(carrier, state.last)
                if act is not None:
                    ended_acts.append(act)
        outputs: list[OutgoingMessage] = []
        for act in ended_acts:
            outputs += self._conclude(act, now_ns)
        return outputs + self._follow_targets(now_ns, known_things)

    def on_carrier(self, carrier: str, present: bool, now_ns: int) -> list[OutgoingMessage]:
        """Note that a carrier runs, or has ended."""
        outputs: list[OutgoingMessage] = []
        for act in self.acts.on_presence(carrier, present=present):
            outputs += self._conclude(act, now_ns)
        return outputs + self._follow_targets(now_ns)

    def _conclude(self, act: PendingAct, now_ns: int, newer_user: str = "") -> list[OutgoingMessage]:
        """Report the result of an act. A switch that failed goes back, unless a target has done it.

        `newer_user`: person who replaced it. They get the cue of the newer act only.
        """
        object_id = act.record.object_id
        name = act.record.kind or object_id
        code, _text = act.problem
        outcome = act.outcome(now_ns)
        self._act_states.conclude(act.record, outcome)
        outputs = [self._publisher.outcome(outcome)]

        # Replaced: the newer act decides on the state
        if code == "replaced":
            if act.user != newer_user:
                outputs.append(self._failure_cue(act, now_ns))
            return outputs

        # Failed, started or done
        if code:
            outputs += self._take_back(act, now_ns)
            outputs.append(self._failure_cue(act, now_ns))
            self._latch(object_id, "")
        elif act.result == "started" or not act.is_reported:
            status = act.event if act.result == "done" else "started"
            outputs.append(self._publisher.cue(act.record.user, act.event, f"{name} {status}", now_ns))

        # The selection comes first, as in `_publish`. Other targets react last
        selection = OutgoingMessage("", self.selection(now_ns))
        return [selection, *outputs, *self._follow_targets(now_ns, {object_id})]

    def _take_back(self, act: PendingAct, now_ns: int) -> list[OutgoingMessage]:
        """Give the object of a failed act its previous state. Return the event, if there is one."""
        object_id = act.record.object_id
        if self._positions.mode(object_id) == "button":
            return self._end_failed_button(act, now_ns)
        wanted_state = "on" if act.event == "selected" else "off"
        if self.acts.has_state(object_id, wanted_state):
            return []
        if not act.is_newest:
            return []
        _code, text = act.problem
        record = self._ledger.take_back(act.record, now_ns, f"{NOT_DONE}{text}")
        if record is None:
            return []
        # targets that have done it, or may do it yet, go back, too
        return self._publisher.event(record, act.record.carriers)

    def _end_failed_button(self, act: PendingAct, now_ns: int) -> list[OutgoingMessage]:
        """Deselect a button that did not fire, if it is still shown: what is selected has fired."""
        object_id = act.record.object_id
        if not act.is_newest or object_id not in self._ledger.entries:
            return []
        _code, text = act.problem
        record = self._ledger.end(object_id, now_ns)
        return self._publisher.event(record._replace(reason=f"{NOT_DONE}{text}"))

    def _failure_cue(self, act: PendingAct, now_ns: int) -> OutgoingMessage:
        """Return the cue of an act that failed."""
        _code, reason = act.problem
        name = act.record.kind or act.record.object_id
        return self._publisher.cue(act.record.user, "refused", f"{name}: {reason}", now_ns)

    def _follow_targets(self, now_ns: int, changed: Collection[str] = ()) -> list[OutgoingMessage]:
        """Give switches the states that their targets report. Others react to those of `changed`."""
        outputs: list[OutgoingMessage] = []
        for thing, carrier, is_on in self.acts.reported():
            tracked = self._positions.objects.get(thing)
            if tracked is None or tracked.mode != "switch":
                continue
            if is_on is self._ownership.is_selected(thing):
                continue
            reason = "" if thing in changed else REPORTED
            change = self._ledger.follow(thing, tracked.kind, carrier, now_ns, reason=reason)
            outputs += self._publish(carrier, [change], now_ns)
        return outputs

    def depart(self, now_ns: int, clock: str = OWN) -> list[OutgoingMessage]:
        """Close the entries of objects that are missing for too long on `clock`."""
        entries = self._ledger.entries
        if not entries:
            return []
        left_ids = self._departures.step(entries, self._positions.objects, now_ns, clock)
        records = self._ledger.drop(left_ids, now_ns)
        return self._close_entries(records, now_ns)

    def tick(self, now_ns: int) -> list[OutgoingMessage]:
        """Handle departed objects, expired reservations, and buttons that were shown for long enough."""
        self._has_changed |= self._reservations.expire(now_ns)
        outputs = self._end_shown_buttons(now_ns)
        self._has_changed |= bool(outputs)
        for act in self.acts.expire(now_ns, max(1.0, self.speed)):
            outputs += self._conclude(act, now_ns)
        outputs += self._follow_targets(now_ns)
        return outputs + (self.depart(now_ns) or self.changed_selection(now_ns))

    def _end_shown_buttons(self, now_ns: int) -> list[OutgoingMessage]:
        """Deselect the buttons that were shown for `SHOWN_NS`. Return the events."""
        new_shown_ns: dict[tuple[str, int], int] = {}
        for object_id, entry in self._ledger.entries.items():
            if self._positions.mode(object_id) == "button":
                key = (object_id, entry.since_ns)
                earliest_ns = max(entry.since_ns, now_ns - MAX_PRESS_DELAY_NS)
                shown_ns = self._shown_ns.get(key, earliest_ns)
                new_shown_ns[key] = min(shown_ns, now_ns)  # later than now if the clock was set back
        self._shown_ns = new_shown_ns
        outputs: list[OutgoingMessage] = []
        for (object_id, _since_ns), shown_ns in new_shown_ns.items():
            if now_ns - shown_ns >= SHOWN_NS:
                outputs += self._publisher.event(self._ledger.end(object_id, now_ns))
        return outputs

    def undo(self, user: str, now_ns: int) -> list[OutgoingMessage]:
        """Undo `user`'s last step. Refused with a cue if there is none."""
        changes = self._ledger.undo(user, now_ns, self._positions.objects)
        if changes:
            return self._publish(user, changes, now_ns)
        text = "there is nothing to take back"
        present_users = self._ownership.presences.present_users(now_ns)
        if present_users and user not in present_users:  # the name may be a wrong one
            text = f"{user} is not there, but {', '.join(present_users)}: {text}"
        return [self._publisher.cue(user, "refused", text, now_ns)]

    def clear(self, user: str, now_ns: int) -> list[OutgoingMessage]:
        """Deselect all objects of `user`."""
        return self._publish(user, self._ledger.clear(user, now_ns), now_ns)

    def release(self, user: str, object_id: str, take_over: bool, now_ns: int) -> list[OutgoingMessage]:
        """Deselect `object_id`, regardless of its owner, or take it over.

        `user` is the caller: an operator, or the person for whom an operator takes it.
        """
        entry = self._ledger.entries.get(object_id)
        change = self._ledger.release(object_id, user, now_ns, take_over=take_over)
        if entry is None or change is None:
            status = "is not selected" if entry is None else "is yours already"
            return [self._publisher.cue(user, "refused", f"object {object_id} {status}", now_ns)]
        outputs = self._publish(user, [change], now_ns)
        if entry.user != user and not change.is_refused:
            kind = entry.kind or "object"
            done = "taken over" if take_over else "released"
            text = f"{kind} was {done} by {user}"
            outputs.append(self._publisher.cue(entry.user, "deselected", text, now_ns))
        return outputs

    def set_thing(self, user: str, query: SetThing, now_ns: int) -> list[OutgoingMessage]:
        """Fire a button or switch a switch, as `user`. Returns nothing if its state is that already."""
        thing = query.thing
        tracked = self._positions.objects.get(thing)
        is_on = self._ownership.is_selected(thing)
        if tracked is None or tracked.mode == "claim":
            return [self._publisher.cue(user, "refused", f"no button or switch {thing} is placed", now_ns)]
        if query.on is is_on:
            return []

        # A button is on for a moment only, and cannot be switched off
        if tracked.mode == "button" and (is_on or query.on is False):
            status = "is a button: it goes off by itself"
            if query.on is None:
                status = "has just fired: try again in a second"
            return [self._publisher.cue(user, "refused", f"{thing} {status}", now_ns)]
        reason = self._ownership.refusal(thing, now_ns)
        if reason:
            return [self._publisher.cue(user, "refused", reason, now_ns)]

        # Switch it, also if somebody has reserved it by pointing
        self._reservations.free(thing)
        change = self._ledger.toggle(
            thing,
            tracked.kind,
            user,
            now_ns,
            cause="",
            reason=RESTORED if query.is_restored else "",
        )
        return self._publish(user, [change], now_ns)

    def _close_entries(self, records: Sequence[Record], now_ns: int) -> list[OutgoingMessage]:
        """Free and journal objects that have left. Return the selection if there are any."""
        for record in records:
            self._reservations.free(record.object_id)
            self.acts.replace(record.object_id, "claim")
            self._act_states.forget((record.object_id,))
            self._publisher.write(record)
        if not records:
            return []
        return [OutgoingMessage("", self.selection(now_ns))]

    def _publish(self, user: str, changes: Sequence[ObjectChange], now_ns: int) -> list[OutgoingMessage]:
        """Begin the acts of `changes`. Return the selection, earlier results, events and cues of `user`."""
        # An act that carriers have to carry out ends the earlier ones on its object
        earlier_outputs: list[OutgoingMessage] = []
        events: list[Record] = []
        for change in changes:
            if not change.is_switched:  # refused, or taken over: nothing is to be carried out
                events += change.records
                continue
            mode = self._positions.mode(change.object_id)
            for record in change.records:
                for act in self.acts.replace(record.object_id, mode):
                    earlier_outputs += self._conclude(act, now_ns, record.user)
                events.append(self.acts.begin(record, mode))
        for record in events:
            self._act_states.begin(record, now_ns)

        # Messages: the selection, then what has led to it
        outputs: list[OutgoingMessage] = []
        if events:
            outputs.append(OutgoingMessage("", self.selection(now_ns)))
        outputs += earlier_outputs
        for record in events:
            outputs += self._publisher.event(record)
            if record.cause not in ACTIONS:
                self._latch(record.object_id, "")

        # Those with carriers get their cue with the result
        done = [record for record in events if not record.carriers]
        return outputs + self._publisher.cues(user, done, now_ns)
