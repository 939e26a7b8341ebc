"""Acts whose result their carriers have not reported yet, and the states that they report. Pure."""

from collections import deque
from collections.abc import Container, Iterable
from dataclasses import dataclass, field
from typing import Literal

from pointit.runtime.host.advised_commands import advised_commands
from pointit.schemas import NS_PER_S, ActOutcome, ActResult, BeginAct, ThingState, ThingStates
from pointit.schemas.environment import ThingMode
from pointit.schemas.selection import BEGIN_WITHIN_S, FailureCode, ResultKind
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
"""Time by which a report of a carrier that does not count may be overtaken by its next one, ns."""
MAX_LIVES = 8
"""Number of former lives of a carrier whose late reports are recognized."""


@dataclass
class PendingAct:
    """An act whose carriers have not all reported a final result."""

    record: Record
    waits_for: dict[str, bool]
    """Carriers without a final result, and whether it runs for long in each."""
    began_ns: int = 0
    """Time of the first check since it was published, or since a carrier was allowed to begin, ns. 0 until
    then."""
    is_newest: bool = True
    """False if its object has changed since."""
    is_reported: bool = False
    """True if its start was reported."""
    begun: set[str] = field(default_factory=set[str])
    """Carriers that may have begun it. Of others it is certain that they have not, and will not."""
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


class _ReportOrder:
    """Order of the reports of one carrier, results and states, which may overtake each other.

    A carrier counts its reports, so no clock matters. Those that do not count are in order by arrival within
    states and within results; between the two, by stamps.
    """

    def __init__(self) -> None:
        self._life_ns = 0
        """Life of the newest report. 0 if the carrier does not count."""
        self._ended_lives: deque[int] = deque(maxlen=MAX_LIVES)
        self._newest: dict[str, ActResult | ThingStates] = {}
        """Newest report of each thing."""

    def is_newer(self, thing: str, report: ActResult | ThingStates) -> bool:
        """Return True if a report on a thing is not older than the newest one, and note it."""
        if report.life_ns != self._life_ns:
            if report.life_ns in self._ended_lives:
                return False
            if self._life_ns:
                self._ended_lives.append(self._life_ns)
            self._life_ns = report.life_ns
            self._newest.clear()
        newest = self._newest.get(thing)
        if newest is not None and _has_overtaken(newest, report):
            return False
        self._newest[thing] = report
        return True

    def keep(self, things: Container[str]) -> None:
        """Forget the reports of all other things."""
        self._newest = {thing: report for thing, report in self._newest.items() if thing in things}


def _has_overtaken(newest: ActResult | ThingStates, report: ActResult | ThingStates) -> bool:
    """Return True if `newest` is newer than `report`, which came after it and is of the same life."""
    if report.life_ns:
        return report.report < newest.report
    if isinstance(report, ActResult) is isinstance(newest, ActResult):
        return False
    return 0 < newest.stamp_ns - report.stamp_ns <= MAX_LATE_NS


@dataclass
class _Carrier:
    states: dict[str, ThingState] = field(default_factory=dict[str, ThingState])
    has_reported: bool = False
    """True if it has reported `states` in this life of it. False if they are those of before."""
    is_awaited: bool = True
    """True until it is known whether it runs, and what its states are; for `MAX_AWAITED_NS` at most."""
    awaited_ns: int = 0
    """Time of the first check in which it was awaited, ns. 0 if there was none."""
    asks_first: bool = False
    """True if it asks before it begins an act."""
    order: _ReportOrder = field(default_factory=_ReportOrder)
    is_present: bool | None = None
    """False if it has ended without taking leave, None if its presence was never seen."""
    absent_ns: int = 0
    """Time of the first check in which it was absent, ns. 0 if there was none."""


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
            act = self._wait_for(record, is_newest=True)
            act.begun.update(name for name in names if not self._carriers[name].asks_first)
        return record

    def resume(self, record: Record, *, is_newest: bool) -> None:
        """Wait for the carriers of the act of `record` from before a restart, which may have begun it."""
        act = self._wait_for(record, is_newest=is_newest)
        act.begun.update(act.waits_for)

    def _wait_for(self, record: Record, *, is_newest: bool) -> PendingAct:
        """Wait for the carriers of `record`."""
        waits_for = dict.fromkeys(record.carriers.split(), False)
        act = PendingAct(record, waits_for, is_newest=is_newest)
        self._pending[act.key] = act
        return act

    def allow(self, carrier: str, query: BeginAct) -> tuple[FailureCode, str]:
        """Let a carrier begin an act. Return the code and reason if it may not, because it has failed.

        The limit of the act counts from now on.
        """
        act = self._pending.get((query.object_id, query.event_ns))
        if act is None or carrier not in act.waits_for:
            return "no_answer", f"it was given up before {carrier} could begin: point again"
        code, _reason = act.problem
        if code:
            return act.problem
        act.begun.add(carrier)
        act.began_ns = 0
        return "", ""

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
        if state is None or not carrier.order.is_newer(state.id, result):
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
            if not known_carrier.order.is_newer(state.id, states):  # a result has overtaken this report
                new_state = previous_states.get(state.id, state)
            new_states[state.id] = new_state
        known_carrier.states = new_states
        known_carrier.has_reported = True
        known_carrier.asks_first = states.asks_first
        if known_carrier.is_present:
            known_carrier.is_awaited = False
        self._note_carried()
        known_carrier.order.keep(new_states)
        return {name for name, state in previous_states.items() if state.state in ("on", "off")}

    def on_presence(self, carrier: str, *, present: bool) -> list[PendingAct]:
        """Note that a carrier runs, or has ended. Return the acts that have failed by that."""
        known_carrier = self._carriers.setdefault(carrier, _Carrier())
        known_carrier.is_present = present
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
        failed: list[PendingAct] = []
        for act in list(self._pending.values()):
            if carrier not in act.waits_for:
                continue
            text = f"{carrier} has ended before it began: start it again"
            if carrier in act.begun:
                text = (
                    f"{carrier} has ended before it told the result: look if it is done, and start it again"
                )
            if self._end(act, carrier, ("unavailable", text)) is not None:
                failed.append(act)
        return failed

    def expire(self, now_ns: int, speed: float) -> list[PendingAct]:
        """Return the acts whose carriers have not reported in time. `speed`: of the site's time."""
        self._follow_clock(now_ns, speed)
        doctor = advised_commands().command("pointit doctor")
        late: list[PendingAct] = []
        for act in list(self._pending.values()):
            act.began_ns = act.began_ns or now_ns
            passed_s = (now_ns - act.began_ns) / NS_PER_S / speed
            if passed_s > BEGIN_WITHIN_S and self._end_unbegun(act, doctor):
                late.append(act)
            elif passed_s > MARGIN_S + self._limit_s(act):
                self._end_late(act, doctor)
                late.append(act)
        return late

    def _end_unbegun(self, act: PendingAct, doctor: str) -> bool:
        """End a late act for the carriers that have not begun it. Return True if none is left."""
        unbegun = [name for name in act.waits_for if name not in act.begun]
        for name in unbegun:
            text = f"{name} did not begin in time: look at {doctor}"
            if self._end(act, name, ("no_answer", text)) is not None:
                return True
        return False

    def _end_late(self, act: PendingAct, doctor: str) -> None:
        """End an act whose carriers have not reported its result in time."""
        self._end_where_done(act)
        names = ", ".join(sorted(act.waits_for))
        if names:
            act.problem = ("no_answer", f"{names} did not report the result in time: look at {doctor}")
        self._pending.pop(act.key, None)

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
