"""What is known of each act, in the selection that all screens read, and its identity in the hover."""

from pointit.schemas import ActOutcome, Selection, ThingState
from pointit.schemas.selection import NOT_DONE
from pointit.services.selector.act_states import MAX_ACT_STATES, ActStates
from pointit.services.selector.selection_publisher import OutgoingMessage, Record
from tests.unit.selector.room import at
from tests.unit.selector.test_acts import Home

BELL = ThingState(id="screws")


class Screen(Home):
    """A home, and the states of acts that a screen can have read since."""

    def __init__(self, *states: ThingState) -> None:
        self.selections: list[Selection] = []
        super().__init__(*states)

    def take(self, outputs: list[OutgoingMessage]) -> None:
        super().take(outputs)
        self.selections += [item.message for item in outputs if isinstance(item.message, Selection)]

    @property
    def states(self) -> list[tuple[str, str, str, str]]:
        acts = self.selections[-1].acts
        return [(act.object_id, act.user, act.effect, act.status) for act in acts]


def test_act_is_asked_pending_and_done_in_published_selections() -> None:
    screen = Screen(BELL)
    screen.point(21.0, 3.0)
    assert screen.states == [("screws", "anna", "select", "asked")]
    screen.tell("started")
    assert screen.states == [("screws", "anna", "select", "pending")]
    screen.tell("done")
    assert screen.states == [("screws", "anna", "select", "done")]


def test_hover_names_the_act_until_its_object_is_left() -> None:
    screen = Screen(BELL)
    screen.point(21.0, 3.0)
    screen.tell("done")
    screen.point(21.0, 0.1)
    assert screen.hover.act_ns == screen.selections[-1].acts[0].asked_ns
    assert screen.selections[-1].acts[0].event_ns == screen.acts[0].stamp_ns
    screen.point(80.0, 0.5)
    screen.point(21.0, 0.2)
    assert (screen.hover.object_id, screen.hover.act_ns) == ("screws", None)


def test_button_that_failed_is_selected_in_no_selection_as_fired() -> None:
    screen = Screen(BELL)
    while not screen.acts:
        screen.point(21.0, 0.1)
    screen.tell("failed", code="error", text="no program")
    shown = [item for selection in screen.selections for item in selection.objects]
    assert shown
    assert all(item.is_pending for item in shown)
    assert screen.states == [("screws", "anna", "select", "failed")]
    assert screen.selections[-1].acts[0].text == "no program"
    assert screen.events[-1].reason == f"{NOT_DONE}no program"


def test_button_is_pending_until_the_last_of_its_acts_was_told() -> None:
    screen = Screen(BELL)
    for _ in range(2):
        screen.set("screws")
        screen.point(80.0, 1.3)
    screen.set("screws")
    screen.take(screen.engine.on_carrier("home", False, at(screen.time_s)))
    shown = [item for selection in screen.selections for item in selection.objects]
    assert len(screen.outcomes) == 3
    assert all(item.is_pending for item in shown), (
        "of the acts that end together none is told before its outcome"
    )


def test_act_without_an_answer_is_told_as_unanswered() -> None:
    screen = Screen(BELL)
    screen.point(21.0, 3.0)
    screen.point(80.0, 7.0)
    assert screen.states == [("screws", "anna", "select", "unanswered")]


def test_act_without_a_carrier_is_done_and_one_that_is_not_allowed_failed() -> None:
    screen = Screen()
    screen.point(-21.0, 3.0)
    screen.point(-21.0, 3.0, user="bert")
    assert screen.states == [("crate", "anna", "select", "done"), ("crate", "bert", "", "failed")]
    assert [event.status for event in screen.events] == ["done", "failed"]
    assert "only anna can deselect it" in screen.selections[-1].acts[-1].text


def test_undo_leaves_the_state_of_the_act_that_a_hover_names() -> None:
    screen = Screen()
    screen.point(-21.0, 3.0)
    screen.take(screen.engine.undo("anna", at(screen.time_s)))
    screen.point(-21.0, 0.1)
    acts = screen.selections[-1].acts
    assert [(act.effect, act.status) for act in acts] == [("select", "done"), ("deselect", "done")]
    assert screen.hover.act_ns == acts[0].asked_ns


def test_selection_names_who_has_something_to_undo() -> None:
    screen = Screen()
    screen.set("screws", "bert")  # a button, which cannot be undone
    assert screen.selections[-1].undoable == ()
    screen.set("lamp")
    assert screen.selections[-1].undoable == ("anna",)
    screen.tell("done", state="on")
    screen.take(screen.engine.undo("anna", at(screen.time_s)))
    assert screen.selections[-1].undoable == ()


def test_restarted_selector_tells_of_the_act_that_it_waits_for() -> None:
    screen = Screen(BELL)
    record = Record(
        at(1.0), "selected", "screws", "screws", "anna", "anna", at(1.0), "dwell", carriers="home"
    )
    screen.engine.restore({}, 1, at(screen.time_s), pending=[(record, True)])
    (act,) = screen.engine.selection(at(screen.time_s)).acts
    assert (act.object_id, act.event_ns, act.status) == ("screws", at(1.0), "asked")


def test_states_of_the_oldest_acts_go_first() -> None:
    states = ActStates()
    for number in range(MAX_ACT_STATES + 5):
        states.begin(Record(at(number), "selected", f"thing{number}", user="anna", owner="anna"), 0)
    kept = states.all()
    assert (len(kept), kept[0].object_id) == (MAX_ACT_STATES, "thing5")
    states.forget({"thing5"})
    assert states.all()[0].object_id == "thing6"


def replaced_outcome(event_ns: int, object_id: str = "lamp") -> ActOutcome:
    """Return the outcome of an act that the next one on its object has replaced."""
    return ActOutcome(
        stamp_ns=event_ns,
        event="selected",
        object_id=object_id,
        user="anna",
        event_ns=event_ns,
        result="failed",
        code="replaced",
        text="it was switched again",
    )


def test_outcome_of_before_a_restart_hides_no_newer_act() -> None:
    """A selector that is killed just after an act was replaced finds both in its journal."""
    states = ActStates()
    newer = Record(20, "deselected", "lamp", user="anna", owner="anna", cause="dwell", carriers="home")
    states.begin(newer, 20)
    states.restore(replaced_outcome(10))
    assert [(state.event_ns, state.status) for state in states.all()] == [(20, "asked")]


def test_states_of_before_a_restart_have_the_limit_of_all() -> None:
    states = ActStates()
    for number in range(2 * MAX_ACT_STATES):
        states.restore(replaced_outcome(number + 1, f"lamp{number}"))
    assert len(states.all()) == MAX_ACT_STATES
    assert states.all()[-1].object_id == f"lamp{2 * MAX_ACT_STATES - 1}"


def test_refused_acts_of_one_person_evict_no_act_of_another() -> None:
    """Ten claims a second on objects that are not there, as a broken shard sends them, take seconds."""
    states = ActStates()
    states.begin(Record(1, "selected", "bell", user="anna", owner="anna", cause="dwell", carriers="home"), 1)
    for number in range(2 * MAX_ACT_STATES):
        states.begin(Record(number + 2, "refused", f"gone{number}", user="ben", cause="dwell"), number + 2)
    assert len(states.all()) == MAX_ACT_STATES
    assert states.is_asked("bell")
    assert states.all()[-1].object_id == f"gone{2 * MAX_ACT_STATES - 1}"
