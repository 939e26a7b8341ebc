"""Acts that carriers have not told the result of yet, and the states that they report. Pure."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

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


MAX_LATE_NS = 10 * NS_PER_S
"""Time by which a report of a carrier may be overtaken by its next one, ns."""


@dataclass
class PendingAct:
    """An act whose carriers have not all told a final result."""

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
        return "failed" if self.problem[0] else "started" if self.waits_for else "done"

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
        if 0 < self.newest_ns.get(thing, 0) - stamp_ns <= MAX_LATE_NS:
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

    def is_pending(self, object_id: str) -> bool:
        """Return True if the result of an act on the object is not known yet."""
        return any(name == object_id and not act.is_reported for (name, _), act in self._pending.items())

    def refusal(self, object_id: str, event: str, mode: ThingMode) -> str:
        """Return the reason for which an act on the object would fail now, or `""`."""
        for name, carrier in self._carriers.items():
            state = carrier.states.get(object_id)
            if state is None or not _is_act(event, mode, state):
                continue
            if reason := self._reason(name, carrier, state):
                return reason
        return ""

    def carrier_warnings(self) -> dict[str, str]:
        """Return a sentence on each carrier that cannot carry out the acts on one of its things."""
        return {
            name: f"acts on {state.id} are refused: {reason}"
            for name, carrier in self._carriers.items()
            for state in carrier.states.values()
            if (reason := self._reason(name, carrier, state))
        }

    def _reason(self, name: str, carrier: _Carrier, state: ThingState) -> str:
        if carrier.is_present is False and not self._is_carried(state.id):
            return f"{name} has ended: start it again"
        is_refused = carrier.is_present and state.state == "unavailable"
        return (state.reason or f"{name} tells that it is unavailable") if is_refused else ""

    def _is_carried(self, object_id: str) -> bool:
        return any(each.is_present and object_id in each.states for each in self._carriers.values())

    def replace(self, object_id: str, mode: ThingMode) -> list[PendingAct]:
        """Note that an object changes. Return the acts on a switch that this replaces."""
        acts = [act for act in self._pending.values() if act.record.object_id == object_id]
        for act in acts:
            act.is_newest = False
            if mode == "switch":
                act.problem = ("replaced", "it was switched again before it was done")
                del self._pending[act.key]
        return acts if mode == "switch" else []

    def begin(self, record: Record, mode: ThingMode) -> Record:
        """Return the record of an event with its carriers: all but the one whose report caused it."""
        if record.event not in ("selected", "deselected") or record.reason:  # it is so already
            return record
        names: list[str] = []
        for name, carrier in self._carriers.items():
            state = carrier.states.get(record.object_id)
            if state is None or not carrier.is_present or name == record.user:
                continue
            if _is_act(record.event, mode, state):
                names.append(name)
        record = record._replace(carriers=" ".join(names))
        if names:
            self.resume(record, is_newest=True)
        return record

    def resume(self, record: Record, *, is_newest: bool) -> None:
        """Wait for the carriers of `record`."""
        act = PendingAct(record, dict.fromkeys(record.carriers.split(), False), is_newest=is_newest)
        self._pending[act.key] = act

    def on_result(self, carrier: str, result: ActResult) -> PendingAct | None:
        """Note a result. Return the act if it is complete, or runs for long in all that are left."""
        known = self._carriers.get(carrier)
        state = None if known is None else known.states.get(result.object_id)
        is_final = result.result != "started"
        if is_final and known is not None and state is not None and known.is_newer(state.id, result.stamp_ns):
            known.states[state.id] = state.model_copy(update={"state": result.state})
        return self.settle(carrier, result)

    def settle(self, carrier: str, result: ActResult) -> PendingAct | None:
        """Give the act of a result its result, as `on_result` without a look at the state of the thing."""
        act = self._pending.get((result.object_id, result.event_ns))
        if act is None or carrier not in act.waits_for:
            return None
        if result.result != "started":
            is_failed = result.result == "failed"
            return self._end(act, carrier, (result.code or "error", result.text) if is_failed else None)
        act.waits_for[carrier] = True
        return self._advance(act)

    def on_states(self, carrier: str, states: ThingStates) -> set[str]:
        """Note what a carrier reports. Return the things whose state was known before."""
        known = self._carriers.setdefault(carrier, _Carrier())
        before = known.states
        known.states = {
            each.id: each if known.is_newer(each.id, states.stamp_ns) else before.get(each.id, each)
            for each in states.things
        }
        known.newest_ns = {name: known.newest_ns[name] for name in known.states}
        return {name for name, each in before.items() if each.state in ("on", "off")}

    def on_presence(self, carrier: str, *, present: bool) -> list[PendingAct]:
        """Note that a carrier runs, or has ended. Return the acts that have failed by that."""
        known = self._carriers.setdefault(carrier, _Carrier())
        known.is_present = present
        known.newest_ns.clear()
        if not present and not known.states:  # it took leave
            del self._carriers[carrier]
        if present:
            return []
        problem: tuple[FailureCode, str] = (
            "unavailable",
            f"{carrier} has ended before it was done: start it again",
        )
        acts = [each for each in self._pending.values() if carrier in each.waits_for]
        return [act for act in acts if self._end(act, carrier, problem) is not None]

    def expire(self, now_ns: int, speed: float) -> list[PendingAct]:
        """Return the acts whose carriers have not told a result in time. `speed`: of the site's time."""
        self._follow_clock(now_ns, speed)
        for act in self._pending.values():
            act.began_ns = act.began_ns or now_ns
        late = [
            act
            for act in self._pending.values()
            if now_ns - act.began_ns > (MARGIN_S + self._limit_s(act)) * speed * NS_PER_S
        ]
        for act in late:
            wanted = "on" if act.event == "selected" else "off"
            for name in [*act.waits_for]:  # started again with the selector, a carrier has no last result
                carrier = self._carriers.get(name, _Carrier())
                state = carrier.states.get(act.record.object_id)
                if carrier.is_present and state is not None and (state.state, state.last) == (wanted, None):
                    self._end(act, name, None)
            if names := ", ".join(sorted(act.waits_for)):
                act.problem = (
                    "no_answer",
                    f"{names} did not tell the result in time: look at `pointit doctor`",
                )
            self._pending.pop(act.key, None)
        return late

    def _follow_clock(self, now_ns: int, speed: float) -> None:
        """Move the times of what runs with a clock that was set, or that stood still meanwhile."""
        passed_ns = now_ns - self._checked_ns
        if not 0 <= passed_ns <= MAX_LATE_NS * speed:
            for act in self._pending.values():
                act.began_ns += passed_ns if act.began_ns else 0
            for carrier in self._carriers.values():
                carrier.absent_ns += passed_ns if carrier.absent_ns else 0
        self._checked_ns = now_ns

    def forget_absent(self, now_ns: int) -> None:
        """Forget the carriers that have been absent for `MAX_ABSENCE_NS`."""
        for name, carrier in [*self._carriers.items()]:
            carrier.absent_ns = 0 if carrier.is_present else carrier.absent_ns or now_ns
            if carrier.absent_ns and now_ns - carrier.absent_ns > MAX_ABSENCE_NS:
                del self._carriers[name]

    def reported(self) -> Iterable[tuple[str, str, bool]]:
        """Return thing, carrier and state of all things without an act under way whose targets agree."""
        reports: dict[str, tuple[str, set[bool]]] = {}
        pending = {name for name, _stamp_ns in self._pending}
        for name, carrier in self._carriers.items():
            for thing, each in carrier.states.items() if carrier.is_present else ():
                if each.state in ("on", "off") and thing not in pending:
                    reports.setdefault(thing, (name, set()))[1].add(each.state == "on")
        return [(thing, name, True in is_on) for thing, (name, is_on) in reports.items() if len(is_on) == 1]

    def has_state(self, object_id: str, state: str) -> bool:
        """Return True if a target reports that the object is `on`, or `off`."""
        states = (
            each.states.get(object_id) for each in self._carriers.values() if each.is_present is not False
        )
        return any(each is not None and each.state == state for each in states)

    def _limit_s(self, act: PendingAct) -> float:
        """Return the limit that its carriers tell, which are not known just after a restart."""
        carriers = (self._carriers[name].states for name in act.waits_for if name in self._carriers)
        states = [states[act.record.object_id] for states in carriers if act.record.object_id in states]
        return max((each.limit_s for each in states), default=DEFAULT_LIMIT_S)

    def _end(
        self, act: PendingAct, carrier: str, problem: tuple[FailureCode, str] | None
    ) -> PendingAct | None:
        del act.waits_for[carrier]
        act.problem = act.problem if problem is None or act.problem[0] else problem
        return self._advance(act)

    def _advance(self, act: PendingAct) -> PendingAct | None:
        if not act.waits_for:
            del self._pending[act.key]
            return act
        if act.problem[0] or act.is_reported or not all(act.waits_for.values()):
            return None
        act.is_reported = True
        return act


def _is_act(event: str, mode: ThingMode, state: ThingState) -> bool:
    """Return True if a target has something to do. It has nothing to do when a button or a claim is over."""
    return event == "selected" or (event == "deselected" and (mode == "switch" or state.state != ""))
