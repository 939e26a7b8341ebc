"""Acts whose result their carriers have not reported yet, and the states that they report. Pure."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

from pointit.runtime.host.advised_commands import advised_commands
from pointit.schemas import NS_PER_S, ActOutcome, ActResult, ThingState, ThingStates
from pointit.schemas.environment import ThingMode
from pointit.schemas.selection import FailureCode, ResultKind
from pointit.services.selector.selection_publisher import Record

MARGIN_S = 1.0
"""Time beyond the limit of a thing after which its carrier is taken for dead, s."""
DEFAULT_LIMIT_S = 5.0
"""Limit of an act whose carriers are not known yet, s."""
MAX_ABSENCE_NS = 60 * NS_PER_S
"""Time after which a carrier that has ended without taking leave is forgotten, ns."""
MAX_AWAITED_NS = 2 * NS_PER_S
"""Time for which acts wait for a carrier of which not all is known, ns. A round trip to it takes less."""

MAX_LATE_NS = 10 * NS_PER_S
"""Time by which a report of a carrier may be overtaken by its next one, ns."""


@dataclass
class PendingAct:
    """An act whose carriers have not all reported a final result."""

    record: Record
    waits_for: dict[str, bool]
    """Carriers without a final result, and whether it runs for long in each."""
    began_ns: int = 0
    """Time of the first check, ns. 0 until then."""
    is_newest: bool = True
    """False if its object has changed since."""
    is_reported: bool = False
    """True if its start was reported."""
    problem: tuple[FailureCode, str] = ("", "")
    """FailureCode and sentence of the first carrier that failed."""

    @property
    def key(self) -> tuple[str, int]:
        """Return its key: the object, and the stamp of its event."""
        return self.record.object_id, self.record.stamp_ns

    @property
    def event(self) -> Literal["selected", "deselected"]:
        """Return the wanted state."""
        return "selected" if self.record.event == "selected" else "deselected"

    @property
    def user(self) -> str:
        """Return the person of its event."""
        return self.record.owner if self.event == "selected" else self.record.user

    @property
    def result(self) -> ResultKind:
        """Return its result up to now."""
        if self.problem[0]:
            return "failed"
        return "started" if self.waits_for else "done"

    def outcome(self, now_ns: int) -> ActOutcome:
        """Return the message of its result, without a number."""
        code, text = self.problem
        return ActOutcome(
            stamp_ns=now_ns,
            event=self.event,
            object_id=self.record.object_id,
            kind=self.record.kind,
            user=self.user,
            event_ns=self.record.stamp_ns,
            result=self.result,
            code=code,
            text=text,
        )


@dataclass
class _Carrier:
    states: dict[str, ThingState] = field(default_factory=dict[str, ThingState])
    has_reported: bool = False
    """True if it has reported `states` in this life of it. False if they are those of before."""
    is_awaited: bool = True
    """True until it is known whether it runs, and what its states are; for `MAX_AWAITED_NS` at most."""
    awaited_ns: int = 0
    """Time of the first check in which it was awaited, ns. 0 if there was none."""
    newest_ns: dict[str, int] = field(default_factory=dict[str, int])
    """Stamp of the newest report of each thing, a result or a state. Older ones are out of date."""
    is_present: bool | None = None
    """False if it has ended without taking leave, None if its presence was never seen."""
    absent_ns: int = 0
    """Time of the first check in which it was absent, ns. 0 if there was none."""

    def is_newer(self, thing: str, stamp_ns: int) -> bool:
        """Return True if a report of this stamp is not older than the newest one, and note it.

        One that is older by more than `MAX_LATE_NS` is newer: the carrier's clock was set back.
        """
        late_ns = self.newest_ns.get(thing, 0) - stamp_ns
        if 0 < late_ns <= MAX_LATE_NS:
            return False
        self.newest_ns[thing] = stamp_ns
        return True


class Acts:
    """Carriers of each thing with its states, and the acts without a result."""

    def __init__(self) -> None:
        self._carriers: dict[str, _Carrier] = {}
        self._pending: dict[tuple[str, int], PendingAct] = {}
        """By object and stamp of the event."""
        self._checked_ns = 0
        """Time of the last check, ns."""
        self.carried: frozenset[tuple[str, str]] = frozenset()
        """Things and their carriers, also of those that have ended and are not forgotten yet."""

    def expect(self, carried: Iterable[tuple[str, str]]) -> None:
        """Wait for the carriers that had these things before a restart, which have not been received yet."""
        for thing, name in carried:
            carrier = self._carriers.setdefault(name, _Carrier())
            carrier.states[thing] = ThingState(id=thing)
        self._note_carried()

    @property
    def is_awaiting(self) -> bool:
        """Return True if it is not known yet of all carriers whether they run, and what their states are."""
        return any(carrier.is_awaited for carrier in self._carriers.values())

    def is_awaited(self, object_id: str) -> bool:
        """Return True if the object has a carrier of which this is not known yet."""
        for carrier in self._carriers.values():
            if carrier.is_awaited and object_id in carrier.states:
                return True
        return False

    def is_pending(self, object_id: str) -> bool:
        """Return True if the result of an act on the object is not known yet."""
        for (pending_id, _stamp_ns), act in self._pending.items():
            if pending_id == object_id and not act.is_reported:
                return True
        return False

    def refusal(self, object_id: str, event: str, mode: ThingMode) -> str:
        """Return the reason for which an act on the object would fail now, or `""`."""
        for name, carrier in self._carriers.items():
            state = carrier.states.get(object_id)
            if state is None:
                continue
            if carrier.is_awaited:
                return f"whether {name} runs is not known yet: try again in a second"
            if not _is_act(event, mode, state):
                continue
            reason = self._refusal_reason(name, carrier, state)
            if reason:
                return reason
        return ""

    def carrier_warnings(self) -> dict[str, str]:
        """Return a sentence on each carrier that cannot carry out the acts on one of its things."""
        warnings: dict[str, str] = {}
        for name, carrier in self._carriers.items():
            for state in carrier.states.values():
                reason = self._refusal_reason(name, carrier, state)
                if reason:
                    warnings[name] = f"acts on {state.id} are refused: {reason}"
        return warnings

    def _refusal_reason(self, name: str, carrier: _Carrier, state: ThingState) -> str:
        """Return the reason for which a carrier would refuse acts on the thing of `state`, or `""`."""
        if carrier.is_present is False and not self._is_carried(state.id):
            return f"{name} has ended: start it again"
        if not carrier.is_present or state.state != "unavailable":
            return ""
        return state.reason or f"{name} tells that it is unavailable"

    def _is_carried(self, object_id: str) -> bool:
        """Return True if a carrier that is present has the object."""
        for carrier in self._carriers.values():
            if carrier.is_present and object_id in carrier.states:
                return True
        return False

    def replace(self, object_id: str, mode: ThingMode) -> list[PendingAct]:
        """Note that an object changes. Return the acts on a switch that this replaces."""
        replaced: list[PendingAct] = []
        for act in list(self._pending.values()):
            if act.record.object_id != object_id:
                continue
            act.is_newest = False
            if mode == "switch":
                act.problem = ("replaced", "it was switched again before it was done")
                del self._pending[act.key]
                replaced.append(act)
        return replaced

    def begin(self, record: Record, mode: ThingMode) -> Record:
        """Return the record of an event with its carriers: all but the one whose report caused it."""
        if record.event not in ("selected", "deselected") or record.reason:  # it is so already
            return record
        names: list[str] = []
        for name, carrier in self._carriers.items():
            state = carrier.states.get(record.object_id)
            if state is None or not carrier.is_present:
                continue
            if name != record.user and _is_act(record.event, mode, state):
                names.append(name)
        record = record._replace(carriers=" ".join(names))
        if names:
            self.resume(record, is_newest=True)
        return record

    def resume(self, record: Record, *, is_newest: bool) -> None:
        """Wait for the carriers of `record`."""
        waits_for = dict.fromkeys(record.carriers.split(), False)
        act = PendingAct(record, waits_for, is_newest=is_newest)
        self._pending[act.key] = act

    def on_result(self, carrier: str, result: ActResult) -> PendingAct | None:
        """Note a result. Return the act if it is complete, or runs for long in all that are left."""
        if result.result != "started":
            self._note_final_state(carrier, result)
        return self.settle(carrier, result)

    def _note_final_state(self, name: str, result: ActResult) -> None:
        """Give the thing of a final result the state that this tells, unless a newer report came before."""
        carrier = self._carriers.get(name)
        if carrier is None:
            return
        state = carrier.states.get(result.object_id)
        if state is None or not carrier.is_newer(state.id, result.stamp_ns):
            return
        carrier.states[state.id] = state.model_copy(update={"state": result.state})

    def settle(self, carrier: str, result: ActResult) -> PendingAct | None:
        """Give the act of a result its result, as `on_result` without a look at the state of the thing."""
        act = self._pending.get((result.object_id, result.event_ns))
        if act is None or carrier not in act.waits_for:
            return None
        if result.result == "started":
            act.waits_for[carrier] = True
            return self._advance(act)
        if result.result != "failed":
            return self._end(act, carrier, None)
        return self._end(act, carrier, (result.code or "error", result.text))

    def on_states(self, carrier: str, states: ThingStates) -> set[str]:
        """Note what a carrier reports. Return the things whose state was known before."""
        known_carrier = self._carriers.setdefault(carrier, _Carrier())
        previous_states = known_carrier.states
        new_states: dict[str, ThingState] = {}
        for state in states.things:
            new_state = state
            if not known_carrier.is_newer(state.id, states.stamp_ns):  # a result has overtaken this report
                new_state = previous_states.get(state.id, state)
            new_states[state.id] = new_state
        known_carrier.states = new_states
        known_carrier.has_reported = True
        if known_carrier.is_present:
            known_carrier.is_awaited = False
        self._note_carried()
        known_carrier.newest_ns = {name: known_carrier.newest_ns[name] for name in new_states}
        return {name for name, state in previous_states.items() if state.state in ("on", "off")}

    def on_presence(self, carrier: str, *, present: bool) -> list[PendingAct]:
        """Note that a carrier runs, or has ended. Return the acts that have failed by that."""
        known_carrier = self._carriers.setdefault(carrier, _Carrier())
        known_carrier.is_present = present
        known_carrier.newest_ns.clear()
        known_carrier.awaited_ns = 0
        if present:
            known_carrier.is_awaited = not known_carrier.has_reported
            self._note_carried()
            return []
        known_carrier.is_awaited = False
        known_carrier.has_reported = False
        if not known_carrier.states:  # it took leave
            del self._carriers[carrier]
        self._note_carried()

        # What it had to do has failed, at once or when the last of the others has reported
        text = f"{carrier} has ended before it was done: start it again"
        problem: tuple[FailureCode, str] = ("unavailable", text)
        failed: list[PendingAct] = []
        for act in list(self._pending.values()):
            if carrier in act.waits_for and self._end(act, carrier, problem) is not None:
                failed.append(act)
        return failed

    def expire(self, now_ns: int, speed: float) -> list[PendingAct]:
        """Return the acts whose carriers have not reported in time. `speed`: of the site's time."""
        self._follow_clock(now_ns, speed)
        late: list[PendingAct] = []
        for act in self._pending.values():
            act.began_ns = act.began_ns or now_ns
            limit_ns = (MARGIN_S + self._limit_s(act)) * speed * NS_PER_S
            if now_ns - act.began_ns > limit_ns:
                late.append(act)

        for act in late:
            self._end_where_done(act)
            names = ", ".join(sorted(act.waits_for))
            if names:
                doctor = advised_commands().command("pointit doctor")
                text = f"{names} did not report the result in time: look at {doctor}"
                act.problem = ("no_answer", text)
            self._pending.pop(act.key, None)
        return late

    def _end_where_done(self, act: PendingAct) -> None:
        """End a late act for each carrier whose thing has the wanted state.

        A carrier that started again with the selector has no last result that it could repeat.
        """
        wanted_state = "on" if act.event == "selected" else "off"
        for name in list(act.waits_for):
            carrier = self._carriers.get(name)
            if carrier is None or not carrier.is_present:
                continue
            state = carrier.states.get(act.record.object_id)
            if state is not None and (state.state, state.last) == (wanted_state, None):
                self._end(act, name, None)

    def _follow_clock(self, now_ns: int, speed: float) -> None:
        """Move the times of what runs with a clock that was set, or that stood still meanwhile."""
        is_first = self._checked_ns == 0
        passed_ns = now_ns - self._checked_ns
        if not is_first and not 0 <= passed_ns <= MAX_LATE_NS * speed:
            for act in self._pending.values():
                if act.began_ns:
                    act.began_ns += passed_ns
            for carrier in self._carriers.values():
                if carrier.absent_ns:
                    carrier.absent_ns += passed_ns
                if carrier.awaited_ns:
                    carrier.awaited_ns += passed_ns
        self._checked_ns = now_ns

    def forget_absent(self, now_ns: int) -> None:
        """Wait no longer for carriers that do not come. Forget those absent for `MAX_ABSENCE_NS`."""
        for name, carrier in list(self._carriers.items()):
            if carrier.is_awaited:
                carrier.awaited_ns = carrier.awaited_ns or now_ns
                if now_ns - carrier.awaited_ns > MAX_AWAITED_NS:
                    carrier.is_awaited = False
                    if carrier.is_present is None and not carrier.has_reported:  # it ended meanwhile
                        carrier.is_present = False
            if carrier.is_present:
                carrier.absent_ns = 0
                continue
            carrier.absent_ns = carrier.absent_ns or now_ns
            if now_ns - carrier.absent_ns > MAX_ABSENCE_NS:
                del self._carriers[name]
                self._note_carried()

    def _note_carried(self) -> None:
        carried: set[tuple[str, str]] = set()
        for name, carrier in self._carriers.items():
            if carrier.is_present is None and carrier.has_reported:  # perhaps a retained state of a dead one
                continue
            carried.update((thing, name) for thing in carrier.states)
        if carried != self.carried:
            self.carried = frozenset(carried)

    def reported(self) -> Iterable[tuple[str, str, bool]]:
        """Return thing, carrier and state of all things without an act under way whose targets agree."""
        first_carriers: dict[str, str] = {}
        values: dict[str, set[bool]] = {}
        pending_ids = {object_id for object_id, _stamp_ns in self._pending}
        for name, carrier in self._carriers.items():
            if not carrier.is_present:
                continue
            for thing, state in carrier.states.items():
                if state.state not in ("on", "off") or thing in pending_ids:
                    continue
                first_carriers.setdefault(thing, name)
                values.setdefault(thing, set()).add(state.state == "on")

        # Targets that differ have no state in common, so their thing keeps its own
        reports: list[tuple[str, str, bool]] = []
        for thing, is_on in values.items():
            if len(is_on) == 1:
                reports.append((thing, first_carriers[thing], True in is_on))
        return reports

    def has_state(self, object_id: str, state: str) -> bool:
        """Return True if a target reports that the object is `on`, or `off`."""
        for carrier in self._carriers.values():
            if carrier.is_present is False:
                continue
            reported = carrier.states.get(object_id)
            if reported is not None and reported.state == state:
                return True
        return False

    def _limit_s(self, act: PendingAct) -> float:
        """Return the limit that its carriers report, which are not known just after a restart."""
        limits_s: list[float] = []
        for name in act.waits_for:
            carrier = self._carriers.get(name)
            state = None if carrier is None else carrier.states.get(act.record.object_id)
            if state is not None:
                limits_s.append(state.limit_s)
        return max(limits_s, default=DEFAULT_LIMIT_S)

    def _end(
        self, act: PendingAct, carrier: str, problem: tuple[FailureCode, str] | None
    ) -> PendingAct | None:
        """End the part of `carrier` in an act. The first problem counts. Returns as `_advance`."""
        del act.waits_for[carrier]
        if problem is not None and not act.problem[0]:
            act.problem = problem
        return self._advance(act)

    def _advance(self, act: PendingAct) -> PendingAct | None:
        """Return `act` if it is complete, or if its start is to be reported now, else None."""
        if not act.waits_for:
            del self._pending[act.key]
            return act
        if act.problem[0] or act.is_reported:
            return None
        has_started = all(act.waits_for.values())
        if not has_started:
            return None
        act.is_reported = True
        return act


def _is_act(event: str, mode: ThingMode, state: ThingState) -> bool:
    """Return True if a target has something to do. It has nothing to do when a button or a claim is over."""
    if event != "deselected":
        return event == "selected"
    return mode == "switch" or state.state != ""
