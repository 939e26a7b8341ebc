"""Acts on things with carriers: people are told of success after its outcome, failures are taken back."""

from typing import Any

import pytest

from pointit.schemas import (
    ActOutcome,
    ActResult,
    Feedback,
    SelectionEvent,
    SetThing,
    ThingState,
    ThingStates,
)
from pointit.schemas.selection import NOT_DONE, REPORTED
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.selection_engine import SelectionEngine
from pointit.services.selector.selection_publisher import OutgoingMessage
from tests.unit.selector.room import at
from tests.unit.selector.test_things import Things, thing

LAMP = ThingState(id="lamp", state="off")


class Home(Things):
    """A room with a lamp (switch), a crate (claim) and screws (button), and the carrier `home` of some."""

    def __init__(self, *states: ThingState, limit_s: float = 5.0) -> None:
        self.outcomes: list[ActOutcome] = []
        self.cues: list[tuple[str, str, str]] = []
        super().__init__(
            thing("lamp", mode="switch"), thing("screws", 1.0), thing("crate", -1.0, mode="claim")
        )
        self.point(80.0, 0.1)
        self.limit_s = limit_s
        self.report(*(states or (LAMP,)))
        self.take(self.engine.on_carrier("home", True, at(self.time_s)))

    def take(self, outputs: list[OutgoingMessage]) -> None:
        super().take(outputs)
        for user, message in outputs:
            if isinstance(message, ActOutcome):
                self.outcomes.append(message)
            elif isinstance(message, Feedback):
                self.cues.append((user, message.cue, message.text))

    def report(self, *states: ThingState, carrier: str = "home") -> None:
        limited = tuple(each.model_copy(update={"limit_s": self.limit_s}) for each in states)
        message = ThingStates(stamp_ns=at(self.time_s), things=limited)
        self.take(self.engine.on_states(carrier, message, at(self.time_s)))

    def tell(
        self, result: str, carrier: str = "home", event: SelectionEvent | None = None, **fields: Any
    ) -> None:
        act = event or self.acts[-1]
        message = ActResult.model_validate(
            {"stamp_ns": at(self.time_s), "object_id": act.object_id, "event_ns": act.stamp_ns,
             "result": result, **fields}
        )  # fmt: skip
        self.take(self.engine.on_result(carrier, message, at(self.time_s)))

    def set(self, name: str, user: str = "anna", *, on: bool | None = None) -> None:
        self.point(80.0, 0.02)
        self.take(self.engine.set_thing(user, SetThing(thing=name, on=on), at(self.time_s)))

    @property
    def acts(self) -> list[SelectionEvent]:
        return [event for event in self.events if event.carriers]

    @property
    def selected(self) -> list[tuple[str, bool]]:
        return [(one.id, one.is_pending) for one in self.engine.selection(at(self.time_s)).objects]


def test_switch_is_announced_when_its_carrier_reports() -> None:
    home = Home()
    assert home.point(0.0, 3.0) == [("selected", "lamp")]
    assert home.acts[0].carriers == ("home",)
    assert (home.selected, home.cues, home.outcomes) == ([("lamp", True)], [], [])
    home.tell("done", state="on")
    assert (home.selected, home.cues) == ([("lamp", False)], [("anna", "selected", "lamp selected")])
    (outcome,) = home.outcomes
    assert (outcome.result, outcome.user, outcome.event_ns) == ("done", "anna", home.acts[0].stamp_ns)
    home.tell("failed", code="error")
    assert len(home.outcomes) == 1, "it has one outcome"


def test_switch_goes_back_with_the_reason_when_its_carrier_refuses() -> None:
    home = Home()
    home.set("lamp")
    home.tell("failed", code="refused", text="the token may not", state="off")
    assert home.selected == []
    assert home.cues == [("anna", "refused", "lamp: the token may not")]
    assert (home.events[-1].event, home.events[-1].reason) == ("deselected", f"{NOT_DONE}the token may not")
    assert home.events[-1].carriers == ("home",), "one of its targets may have done it, or do it yet"
    assert home.events[-1].status == "done", "nothing more is told of it, so nobody waits"
    home.report(LAMP.model_copy(update={"state": "on"}))
    home.set("lamp")
    home.tell("failed", code="no_effect", text="it stays on", state="on")
    assert home.selected == [("lamp", False)], "a lamp that does not go off is on"


def test_switch_stays_on_when_it_went_on_despite_a_failure() -> None:
    home = Home()
    home.set("lamp")
    home.tell("failed", code="no_answer", text="no answer", state="on")
    assert home.selected == [("lamp", False)]
    assert home.cues[-1][1] == "refused"


def test_take_over_and_its_undo_switch_nothing() -> None:
    home = Home()
    home.set("lamp")
    home.tell("done", state="on")
    home.take(home.engine.release("bert", "lamp", True, at(home.time_s)))
    home.take(home.engine.undo("bert", at(home.time_s)))
    assert [event.user for event in home.events if event.event == "selected"] == ["anna", "bert", "anna"]
    assert len(home.acts) == 1
    assert home.selected == [("lamp", False)]


@pytest.mark.parametrize("is_dead", [False, True])
def test_act_fails_when_its_carrier_is_late_or_ends(*, is_dead: bool) -> None:
    home = Home()
    home.set("lamp")
    if is_dead:
        home.take(home.engine.on_carrier("home", False, at(home.time_s)))
    else:
        home.point(80.0, 5.9)
        assert home.outcomes == []
        home.point(80.0, 0.5)
    (outcome,) = home.outcomes

    assert (outcome.result, outcome.code) == ("failed", "unavailable" if is_dead else "no_answer")
    assert home.selected == []
    home.tell("done", state="on")
    assert len(home.outcomes) == 1, "what comes late is not told again"

    if is_dead:
        home.set("lamp")
        assert home.cues[-1] == ("anna", "refused", "home has ended: start it again")
        home.report(LAMP)
        home.take(home.engine.on_carrier("home", True, at(home.time_s)))
        home.set("lamp")
        assert home.selected == [("lamp", True)]


def test_unavailable_thing_is_refused_at_once_for_pointing_and_programs() -> None:
    home = Home(ThingState(id="lamp", state="unavailable", reason="no power: switch it on at the wall"))
    assert home.point(0.0, 0.5) == []
    assert home.hover.action == "refuse"
    assert home.point(0.0, 3.0) == [("refused", "lamp")]
    home.set("lamp", "bert")
    assert home.cues == [(user, "refused", "no power: switch it on at the wall") for user in ("anna", "bert")]
    assert (home.acts, home.selected) == ([], [])


def test_ended_carrier_blocks_no_others_thing_and_reports_no_state() -> None:
    home = Home()
    home.report(LAMP, carrier="other")
    home.take(home.engine.on_carrier("other", True, at(home.time_s)))
    home.set("lamp")
    home.tell("done", "other", state="on")
    home.take(home.engine.on_carrier("other", False, at(home.time_s)))
    home.tell("failed", code="error", text="no power", state="off")
    assert home.selected == []
    home.set("lamp", "bert")
    assert home.acts[-1].carriers == ("home",)


def test_failure_cue_of_an_undo_goes_to_its_caller() -> None:
    home = Home()
    home.set("lamp")
    home.tell("done", state="on")
    home.set("lamp", "bert")
    home.tell("done", state="off")
    home.take(home.engine.undo("bert", at(home.time_s)))
    home.tell("failed", code="error", text="no power", state="off")
    assert home.cues[-1] == ("bert", "refused", "lamp: no power")


def test_newest_act_on_a_switch_counts_for_any_person() -> None:
    home = Home()
    for user in ("anna", "bert", "carl"):
        home.set("lamp", user)
    on, off, again = home.acts
    assert [(each.event_ns, each.code) for each in home.outcomes] == [
        (on.stamp_ns, "replaced"), (off.stamp_ns, "replaced"),
    ]  # fmt: skip

    home.tell("failed", event=on, code="replaced", state="off")
    assert home.selected == [("lamp", True)]
    home.tell("done", event=again, state="on")
    assert home.selected == [("lamp", False)]

    late = "lamp: it was switched again before it was done"
    assert home.cues == [
        ("anna", "refused", late), ("bert", "refused", late), ("carl", "selected", "lamp selected"),
    ]  # fmt: skip


def test_person_gets_only_the_newer_cue_when_they_switch_again() -> None:
    home = Home()
    home.set("lamp")
    home.set("lamp")
    home.tell("done", state="off")
    assert home.cues == [("anna", "deselected", "lamp deselected")]


def with_two_carriers() -> Home:
    """Return a home where two carriers act on the lamp, which is switched on."""
    home = Home()
    home.report(ThingState(id="lamp"), carrier="reactions")
    home.take(home.engine.on_carrier("reactions", True, at(home.time_s)))
    home.set("lamp")
    return home


def test_carrier_that_succeeded_goes_back_when_another_fails() -> None:
    home = with_two_carriers()
    home.tell("done", "reactions")
    home.tell("failed", code="no_answer", text="no answer", state="off")
    assert (home.events[-1].event, home.events[-1].carriers) == ("deselected", ("home", "reactions"))
    assert home.selected == []
    home.set("lamp")
    assert home.events[-1].event == "selected", "nobody waits for the one that goes back"


def test_carrier_reports_count_when_its_clock_was_set_back() -> None:
    home = Home()
    home.set("lamp")
    home.tell("done", state="on", stamp_ns=at(home.time_s + 3600.0))
    home.set("lamp")
    home.tell("done", state="off")
    assert home.point(80.0, 0.5) == []
    assert home.selected == []
    home.report(LAMP.model_copy(update={"state": "on"}))
    assert [(each.event, each.reason) for each in home.events[-2:]] == [
        ("deselected", ""), ("selected", ""),
    ]  # fmt: skip


@pytest.mark.parametrize("result", ["done", "failed"])
def test_missed_result_is_read_once_with_the_states(result: str) -> None:
    is_on = result == "done"
    home = Home()
    home.set("lamp")
    for event_ns in (1, home.acts[0].stamp_ns, home.acts[0].stamp_ns):
        last = ActResult.model_validate(
            {"stamp_ns": at(home.time_s), "object_id": "lamp", "event_ns": event_ns, "result": result}
        )
        home.report(ThingState(id="lamp", state="on" if is_on else "off", last=last))
    assert [each.result for each in home.outcomes] == [result]
    assert home.selected == [("lamp", False)] * is_on
    assert home.point(80.0, 60.0) == []
    home.report(ThingState(id="lamp", state="off" if is_on else "on", last=last))
    assert home.selected == [("lamp", False)] * (not is_on), "the state counts, the result is from before"


def test_late_act_is_done_when_a_restarted_carrier_reports_its_state() -> None:
    home = Home()
    home.set("lamp")
    home.report(LAMP.model_copy(update={"state": "on"}))
    home.point(80.0, 7.0)
    assert [(each.result, each.code) for each in home.outcomes] == [("done", "")]
    assert home.selected == [("lamp", False)]


@pytest.mark.parametrize("step_s", [3600.0, -3600.0])
def test_act_times_follow_a_clock_that_is_set(step_s: float) -> None:
    home = Home()
    home.set("lamp")
    home.point(80.0, 1.0)
    home.time_s += step_s
    home.point(80.0, 1.0)
    assert home.outcomes == []
    home.point(80.0, 6.0)
    assert [each.code for each in home.outcomes] == ["no_answer"]


def test_act_with_two_carriers_needs_both_and_fails_with_one() -> None:
    home = with_two_carriers()
    assert set(home.acts[0].carriers) == {"home", "reactions"}
    home.tell("done", state="on")
    assert home.outcomes == []
    home.tell("failed", "reactions", code="error", text="exit code 3")
    assert [(each.result, each.text) for each in home.outcomes] == [("failed", "exit code 3")]
    assert home.selected == [("lamp", False)], "the lamp itself is on"


def test_failure_is_reported_once_while_another_carrier_runs() -> None:
    home = with_two_carriers()
    home.tell("failed", code="error", text="no power", state="off")
    home.tell("started", "reactions")
    assert home.outcomes == []
    home.tell("done", "reactions")
    assert [(each.result, each.text) for each in home.outcomes] == [("failed", "no power")]


def test_long_act_is_announced_at_its_start_and_failure() -> None:
    home = Home(ThingState(id="screws"), limit_s=60.0)
    home.set("screws")
    home.tell("started")
    assert home.cues == [("anna", "selected", "screws started")]
    home.point(80.0, 30.0)
    home.tell("failed", code="error", text="exit code 3")
    assert [each.result for each in home.outcomes] == ["started", "failed"]
    assert home.cues[1:] == [("anna", "refused", "screws: exit code 3")]
    home.set("screws", "bert")
    home.tell("started")
    home.tell("done")
    assert [cue for user, cue, _text in home.cues if user == "bert"] == ["selected"], "the success once"


def test_button_fires_again_while_its_first_act_runs() -> None:
    home = Home(ThingState(id="screws"))
    home.set("screws")
    home.point(80.0, 1.0)
    home.set("screws", "bert")
    first, second = home.acts
    home.tell("done", event=second)
    home.tell("failed", event=first, code="error", text="exit code 3")
    assert [(each.user, each.result) for each in home.outcomes] == [("bert", "done"), ("anna", "failed")]


def test_end_of_a_claim_needs_no_carrier() -> None:
    home = Home(ThingState(id="crate"))
    assert home.point(-21.0, 3.0) == [("selected", "crate")]
    home.tell("done")
    home.take(home.engine.on_carrier("home", False, at(home.time_s)))
    home.take(home.engine.clear("anna", at(home.time_s)))
    assert (home.events[-1].event, home.events[-1].carriers) == ("deselected", ())


def test_switch_follows_its_target_with_a_reason_at_first_only() -> None:
    home = Home(LAMP.model_copy(update={"state": "on"}))
    assert (home.selected, home.events[-1].reason) == ([("lamp", False)], REPORTED)
    home.report(LAMP)
    assert (home.selected, home.events[-1].reason) == ([], "")
    assert (home.events[-1].user, home.events[-1].carriers) == ("home", ())


def test_older_result_does_not_switch_a_newer_report_back() -> None:
    home = Home()
    home.set("lamp")
    early_ns = at(home.time_s)
    home.point(80.0, 0.1)
    home.report(LAMP.model_copy(update={"state": "on"}))
    home.tell("failed", code="no_effect", text="it stays off", state="off", stamp_ns=early_ns)
    assert home.selected == [("lamp", False)], "it went on later"
    home.report(LAMP)
    assert home.selected == []


def test_older_report_does_not_switch_a_newer_result_back() -> None:
    home = Home()
    home.set("lamp")
    home.point(80.0, 0.1)
    before = ThingStates(stamp_ns=at(home.time_s - 0.05), things=(LAMP,))
    home.tell("done", state="on")
    home.take(home.engine.on_states("home", before, at(home.time_s)))
    assert home.selected == [("lamp", False)]


@pytest.mark.parametrize("was_present", [True, False])
def test_absent_carrier_is_forgotten(*, was_present: bool) -> None:
    home = Home()
    if not was_present:
        home.report(ThingState(id="screws"), carrier="gone")
    home.take(home.engine.on_carrier("home", False, at(home.time_s)))
    home.point(80.0, 50.0)
    home.set("lamp")
    assert home.cues[-1] == ("anna", "refused", "home has ended: start it again")
    home.point(80.0, 11.0)
    home.set("lamp")
    assert home.cues[-1] == ("anna", "selected", "lamp selected")
    assert home.engine._ownership.acts._carriers == {}


def restarted(home: Home) -> None:
    """Go on as a selector that was killed and finds the pending acts in its journal."""
    records = [(act.record, act.is_newest) for act in home.engine._ownership.acts._pending.values()]
    entries = dict(home.engine._ledger.entries)
    home.engine = SelectionEngine(SelectorConfig(), lambda _record: None)
    home.engine.on_map(home.room)
    home.engine.restore(entries, 100, at(home.time_s), pending=records)


def test_lamp_stays_on_after_a_restart_when_states_precede_presence() -> None:
    home = Home()
    home.set("lamp")
    (act,) = home.acts
    restarted(home)
    last = ActResult.model_validate(
        {"stamp_ns": at(home.time_s), "object_id": "lamp", "event_ns": act.stamp_ns, "result": "failed"}
    )
    home.report(ThingState(id="lamp", state="on", last=last))
    home.take(home.engine.on_carrier("home", True, at(home.time_s)))
    assert [each.result for each in home.outcomes] == ["failed"]
    assert (home.selected, len(home.events)) == ([("lamp", False)], 1)


@pytest.mark.parametrize("on", [True, False])
def test_restored_act_ends_with_the_result_of_its_carrier(*, on: bool) -> None:
    home = Home()
    if not on:
        home.set("lamp")
        home.tell("done", state="on")
    home.set("lamp")
    restarted(home)
    assert home.selected == [("lamp", True)] * on
    home.tell("done", state="on" if on else "off")
    assert [(each.result, each.user) for each in home.outcomes[-1:]] == [("done", "anna")]
    assert home.selected == [("lamp", False)] * on


@pytest.mark.parametrize("on", [True, False])
def test_restored_act_goes_back_when_its_carrier_does_not_answer(*, on: bool) -> None:
    home = Home(ThingState(id="lamp"))
    if not on:
        home.set("lamp")
        home.tell("done")
    home.set("lamp")
    restarted(home)
    home.point(80.0, 5.5)
    assert home.outcomes == home.outcomes[: 1 - on]
    home.point(80.0, 1.5)
    assert (home.outcomes[-1].code, home.cues[-1][1]) == ("no_answer", "refused")
    assert home.selected == [("lamp", False)] * (not on)


def test_restored_act_has_the_limit_of_its_carrier() -> None:
    home = Home(limit_s=30.0)
    home.set("lamp")
    restarted(home)
    home.report(LAMP)
    home.take(home.engine.on_carrier("home", True, at(home.time_s)))
    home.point(80.0, 20.0)
    home.tell("done", state="on")
    assert [each.result for each in home.outcomes] == ["done"]


def test_thing_without_carriers_is_done_at_once() -> None:
    home = Home()
    home.report(ThingState(id="screws", state="unavailable", reason="of a run before"), carrier="gone")
    home.set("screws")
    refusal = "whether gone runs is not known yet: try again in a second"
    assert (home.acts, home.cues) == ([], [("anna", "refused", refusal)])

    home.point(80.0, 3.0)
    home.set("screws")
    assert (home.acts, home.cues[1:]) == ([], [("anna", "selected", "screws selected")])


def test_acts_of_one_instant_have_numbers_of_their_own() -> None:
    """Clocks tick in steps: of 15.6 ms on Windows before Python 3.13; virtual time stands meanwhile."""
    home = Home()
    now_ns = at(home.time_s)
    for user in ("anna", "bert", "carl"):
        home.take(home.engine.set_thing(user, SetThing(thing="lamp"), now_ns))
    home.take(home.engine.undo("carl", now_ns))

    numbers = [act.stamp_ns for act in home.acts]
    assert len(numbers) == 4
    assert numbers == sorted(set(numbers))
    assert [outcome.event_ns for outcome in home.outcomes] == numbers[:-1], "each has an outcome: replaced"


@pytest.mark.parametrize("pressed_before", [True, False])
def test_button_goes_off_by_itself_after_the_clock_was_set_back(*, pressed_before: bool) -> None:
    """Stamps of one object only grow, so after that they are of a time that is yet to come."""
    home = Home()  # its button has no carrier
    home.time_s += 60.0
    home.set("screws")
    if pressed_before:
        home.point(80.0, 2.0)
        assert home.selected == []
    home.time_s -= 30.0
    home.point(80.0, 0.1)
    if pressed_before:
        home.set("screws")
    assert [name for name, _ in home.selected] == ["screws"]
    home.point(80.0, 3.0)
    assert home.selected == []
