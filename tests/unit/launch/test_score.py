"""The score of a run, of its robots and of what its monitor tells."""

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pointit.cli.summary import summary_lines
from pointit.geometry.vector import Vec3
from pointit.launch.robots import RobotsScore, goal_lines, score_lines
from pointit.launch.run.monitor import MAX_OBJECTS, MAX_TRACKERS, Latency, Monitor, RunScore
from pointit.schemas import (
    ActOutcome,
    Cursor,
    Environment,
    Goal,
    RobotState,
    SelectedObject,
    Selection,
    SelectionEvent,
    StripsFrame,
    TrackedObject,
    TrackedObjects,
)
from pointit.schemas.environment import Fence
from pointit.schemas.selection import NOT_DONE
from pointit.schemas.topics import OUTCOMES, SELECTION_EVENTS
from tests.support.bench import ManualClock, memory_bench
from tests.unit.robot.flight import goal_at

MS = 1_000_000


def things(*pairs: tuple[str, str]) -> TrackedObjects:
    objects = tuple(TrackedObject(id=name, kind=kind, position_m=(0.0, 0.0, 0.0)) for name, kind in pairs)
    return TrackedObjects(stamp_ns=1, objects=objects)


def event(what: str, object_id: str, kind: str = "", user: str = "") -> SelectionEvent:
    return SelectionEvent.model_validate(
        {"stamp_ns": 1, "event": what, "object_id": object_id, "kind": kind, "user": user}
    )


def of_reds(*messages: TrackedObjects | SelectionEvent, kinds: tuple[str, ...] = ("red",)) -> dict[str, int]:
    score = RunScore(kinds)
    for message in messages:
        if isinstance(message, TrackedObjects):
            score.on_objects("conveyor", message)
        else:
            score.on_event(message)
    return score.counts()


NONE = {"selected": 0, "missed": 0, "pending": 0, "wrong": 0, "corrected": 0}
TWO = things(("a", "red"), ("b", "blue"))


def dispatched(object_id: str, kind: str, bay: str, user: str = "") -> SelectionEvent:
    return event("dispatched", object_id, kind, user).model_copy(update={"bay": bay})


SELECTED, DESELECTED, LEFT = (event(what, "a") for what in ("selected", "deselected", "left"))
WRONG = event("selected", "b")
CORRECTED = event("deselected", "b")
TO_ANNA = dispatched("b", "blue", "1", "anna")
TO_NOBODY = dispatched("b", "blue", "3")
PENDING = {"pending": 1}


@pytest.mark.parametrize(
    ("messages", "counts"),
    [
        pytest.param((TWO,), PENDING, id="a target is pending"),
        pytest.param((TWO, SELECTED), {"selected": 1}, id="until it is selected"),
        pytest.param((TWO, SELECTED, DESELECTED), PENDING, id="and deselected"),
        pytest.param((TWO, LEFT), {"missed": 1}, id="one that left is missed"),
        pytest.param((TWO, SELECTED, LEFT), {"selected": 1}, id="unless it was selected"),
        pytest.param((TWO, WRONG), {**PENDING, "wrong": 1}, id="another kind is wrong"),
        pytest.param((TWO, WRONG, CORRECTED), {**PENDING, "corrected": 1}, id="until it is taken back"),
        pytest.param((TWO, event("dispatched", "a")), {"missed": 1}, id="dispatched for nobody"),
        pytest.param((TWO, event("dispatched", "a", user="anna")), {"selected": 1}, id="dispatched for anna"),
        pytest.param((TWO, SELECTED, dispatched("a", "red", "3")), {"missed": 1}, id="selected too late"),
        pytest.param((TWO, WRONG, CORRECTED, TO_ANNA), {**PENDING, "wrong": 1}, id="corrected too late"),
        pytest.param((TWO, WRONG, CORRECTED, TO_NOBODY), {**PENDING, "corrected": 1}, id="corrected in time"),
        pytest.param((event("selected", "a", "red"), TWO), {"selected": 1}, id="an event before the list"),
        pytest.param((event("selected", "b", "blue"),), {"wrong": 1}, id="wrong without a list"),
        pytest.param((TWO, things(("c", "red"))), PENDING, id="what vanished is not missed"),
    ],
)
def test_counts_of_red_targets(
    messages: Sequence[TrackedObjects | SelectionEvent], counts: dict[str, int]
) -> None:
    assert of_reds(*messages) == {**NONE, **counts}


def test_refusals_count_as_such_alone() -> None:
    score = RunScore(("red",))
    for reason in ("it is too late", "anna has it"):
        score.on_event(event("refused", "a").model_copy(update={"reason": reason}))
    assert (score.refused, score.refusal) == (2, "anna has it")


def test_dispatched_object_counts_by_its_person_whatever_was_selected() -> None:
    score = RunScore(("red",))
    for message in (SELECTED, dispatched("a", "red", "3"), SELECTED):  # the selector's may come later
        score.on_event(message)
    score.on_selection(selection("a"))
    assert score.counts() == {**NONE, "missed": 1}
    assert score.dispatched() == {"3": {"red": 1}}


def test_dispatched_object_counts_while_the_selector_is_down() -> None:
    score = RunScore(("red",))
    score.on_objects("conveyor", things(("a", "red"), ("b", "red"), ("c", "blue")))
    for name in ("a", "c"):
        score.on_event(event("selected", name))
    for told in (
        dispatched("a", "red", "1", "anna"),
        dispatched("b", "red", "3"),
        dispatched("c", "blue", "1", "anna"),
    ):
        score.on_event(told)
    score.on_selection(selection("a", "c"))  # it is back, and does not know yet
    score.on_selection(selection())
    assert score.counts() == {**NONE, "selected": 1, "missed": 1, "wrong": 1}


def test_package_reported_twice_as_dispatched_is_counted_once() -> None:
    score = RunScore(("red",))
    for told in (dispatched("a", "red", "1", "anna"), dispatched("b", "blue", "3")):
        score.on_event(told)
        score.on_event(told)  # the conveyor was killed between telling and noting that it had told
    assert score.dispatched() == {"1": {"red": 1}, "3": {"blue": 1}}
    assert score.counts() == {**NONE, "selected": 1}
    missed = dispatched("c", "red", "3")
    assert of_reds(missed, missed) == {**NONE, "missed": 1}


def selection(*names: str) -> Selection:
    objects = tuple(SelectedObject(id=name, user="anna", since_ns=1) for name in names)
    return Selection(stamp_ns=1, objects=objects)


def test_a_selector_that_begins_anew_has_nothing_selected() -> None:
    score = RunScore(("red",))
    score.on_objects("conveyor", things(("a", "red"), ("b", "red"), ("c", "blue")))
    for message in (event("selected", "a"), event("selected", "b"), event("selected", "c")):
        score.on_event(message)
    score.on_selection(selection("a", "b", "c"))
    score.on_event(event("left", "a", user="anna"))
    score.on_selection(selection("b", "c"))
    assert score.counts() == {**NONE, "selected": 2, "wrong": 1}
    score.on_selection(selection())  # restarted
    assert score.counts() == {**NONE, "selected": 1, "pending": 1}


def test_names_without_number_are_counted_and_not_remembered() -> None:
    score = RunScore(("red",))
    for number in range(MAX_OBJECTS + 30):
        score.on_objects(f"t{number}", things((f"x{number}", "red" if number % 3 else "blue")))
        score.on_event(event("selected" if number % 2 else "left", f"x{number}"))
    assert len(score.kinds) == MAX_OBJECTS
    assert len(score.selected) + len(score.left) <= MAX_OBJECTS
    assert len(score.listed) == MAX_TRACKERS
    assert sum(score.counts().values()) == MAX_OBJECTS + 30 - (MAX_OBJECTS + 30 + 5) // 6  # blue, only left


KINDS = {"a": "red", "b": "red", "c": "blue", "d": "blue"}
happenings = st.lists(
    st.tuples(
        st.sampled_from(["selected", "deselected", "left", "dispatched for anna", "dispatched"]),
        st.sampled_from([*KINDS]),
    ),
    max_size=30,
)


@settings(max_examples=200)
@given(happenings)
@example([("selected", "c"), ("deselected", "c"), ("dispatched for anna", "c"), ("deselected", "c")])
def test_any_history_counts_each_object_by_its_last_state(history: list[tuple[str, str]]) -> None:
    expected = Counter(NONE)
    for name, kind in KINDS.items():
        is_selected = has_left = is_final = False
        corrected = 0
        for what in (what for what, other in history if other == name):
            if what.startswith("dispatched"):  # the bay is final, and tells for whom it went there
                is_selected = what == "dispatched for anna"
                corrected = 0 if is_selected else corrected
                has_left = is_final = True
            elif what == "left":
                has_left = True
            elif not is_final:
                is_selected = what == "selected"
                corrected += what == "deselected" and kind == "blue"
        if kind == "red":
            expected["selected" if is_selected else "missed" if has_left else "pending"] += 1
        else:
            expected["wrong"] += is_selected
            expected["corrected"] += corrected
    messages = [
        event(what.partition(" ")[0], name, user="anna" if what == "dispatched for anna" else "")
        for what, name in history
    ]

    assert of_reds(things(*KINDS.items()), *messages) == expected


def cursor(stamp_ms: float, surface: str = "strip") -> Cursor:
    return Cursor.model_validate({"stamp_ns": round(stamp_ms * MS), "surface": surface, "surface_id": "0"})


def frame(stamp_ms: float) -> StripsFrame:
    return StripsFrame(stamp_ns=round(stamp_ms * MS), strips=())


def test_only_the_first_frame_of_a_capture_counts() -> None:
    latency = Latency()
    latency.on_cursor(cursor(100))
    latency.on_frame(frame(100), 108 * MS, 1.0)
    latency.on_frame(frame(100), 150 * MS, 1.0)  # the same capture, drawn again for something else
    assert latency.count == 1
    assert latency.quantiles_ms()["p50"] == pytest.approx(8, rel=0.003)


def test_unknown_captures_and_cursors_on_nothing_have_no_latency() -> None:
    latency = Latency()
    latency.on_cursor(cursor(100, surface="none"))
    latency.on_frame(frame(100), 108 * MS, 1.0)
    latency.on_frame(frame(99), 108 * MS, 1.0)
    assert latency.count == 0
    assert latency.quantiles_ms() == {"p50": None, "p99": None}


def test_latency_includes_the_wire_at_the_walls_speed() -> None:
    latency = Latency()
    latency.on_cursor(cursor(100))
    latency.on_frame(frame(100).model_copy(update={"light_s": 0.1}), 140 * MS, 4.0)
    assert latency.quantiles_ms()["p50"] == pytest.approx(110, rel=0.003)


@given(st.lists(st.floats(0.01, 5000), min_size=1, max_size=300))
def test_quantiles_are_the_nearest_ranks(values_ms: list[float]) -> None:
    latency = Latency()
    for value in values_ms:
        latency.on_cursor(cursor(1))
        latency.on_frame(frame(1), round((1 + value) * MS), 1.0)
    ordered = sorted(values_ms)
    for name, share in (("p50", 0.5), ("p99", 0.99)):
        expected = ordered[math.ceil(share * len(ordered)) - 1]
        assert latency.quantiles_ms()[name] == pytest.approx(expected, rel=0.004, abs=0.0006)


def test_summary_says_how_many_frames_each_controllers_link_carries() -> None:
    assert summary_lines({**SUMMARY, "light_hz": {"/dev/leds": 8.71}})[-1] == (
        "/dev/leds carries 8.7 frames a second."
    )


SUMMARY = {
    "scenario": "scenario_3",
    "duration_s": 60.04,
    "speed": 1.0,
    "services": ["pui", "pointing.anna"],
    "target_kinds": ["red"],
    "selected": 3,
    "missed": 1,
    "pending": 2,
    "wrong": 4,
    "corrected": 5,
    "latency_ms": {"p50": 8.04, "p99": 20.26},
    "cursors": 7,
    "frames": 9,
}


def test_a_summary_reads_well() -> None:
    assert summary_lines(SUMMARY) == [
        "scenario_3 ran 60 s with 2 services.",
        "Selected 3 of 6 red objects, missed 1, still to do 2, wrong 4 (corrected 5).",
        "Wrist to light: p50 8.0 ms, p99 20.3 ms; 7 cursors on surfaces, 9 frames.",
    ]
    bare = {**SUMMARY, "target_kinds": [], "speed": 2.5, "latency_ms": {"p50": None, "p99": None}}
    assert summary_lines(bare) == [
        "scenario_3 ran 60 s at 2.5 times the speed with 2 services.",
        "Wrist to light: not measured; 7 cursors on surfaces, 9 frames.",
    ]


def test_summary_reports_refusals_and_people_who_were_not_located() -> None:
    refused = {**SUMMARY, "refused": 1, "last_refusal": "red 7 is past its last way", "not_found": ["ben"]}
    assert summary_lines(refused)[2:4] == [
        "Refused once: red 7 is past its last way.",
        "ben was not found in that time; --duration gives more.",
    ]
    more = {**refused, "refused": 3, "not_found": ["ben", "eve"]}
    assert summary_lines(more)[2:4] == [
        "Refused 3 times, at last: red 7 is past its last way.",
        "ben, eve were not found in that time; --duration gives more.",
    ]


def test_summary_has_found_positions_and_their_errors() -> None:
    found = {"position_m": [2.031, -0.48], "position_sigma_m": 0.123, "yaw_sigma_deg": 2.06}
    people = {
        "anna": {**found, "position_error_m": 0.087, "yaw_error_deg": 2.13},
        "ben": {**found, "position_error_m": None},
    }
    assert summary_lines({**SUMMARY, "people": people})[2:4] == [
        "anna was found at 2.03, -0.48 m ±0.12 m, yaw ±2.1°, 0.09 m from the true place, yaw 2.1° off.",
        "ben was found at 2.03, -0.48 m ±0.12 m, yaw ±2.1°.",
    ]


SQUARE = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0))
RACK = ((3.0, 3.0), (4.0, 3.0), (4.0, 4.0), (3.0, 4.0))
ROOM = Environment(
    stamp_ns=0,
    name="arena",
    fences=(
        Fence(id="area", kind="keep_in", outline_m=SQUARE, high_m=2.0),
        Fence(id="rack", kind="keep_out", outline_m=RACK),
    ),
)


def state(position_m: Vec3, phase: Any = "moving", **fields: Any) -> RobotState:
    usual: dict[str, Any] = {
        "stamp_ns": 0,
        "kind": "quadrotor",
        "yaw_rad": 0.0,
        "velocity_mps": (0.0, 0.0, 0.0),
        "radius_m": 0.2,
    }
    return RobotState(phase=phase, position_m=position_m, **(usual | fields))


def test_a_landing_counts_with_its_distance_from_the_nearest_spot() -> None:
    score = RobotsScore([(1.0, 1.0, 0.0), (3.0, 1.0, 0.0)])
    score.on_state("quad", state((1.0, 1.0, 0.2)))
    score.on_state("quad", state((1.0, 1.1, 0.1), "landing", target_m=(1.0, 1.2, 0.0)))
    score.on_state("quad", state((1.0, 1.1, 0.0), "landed"))
    score.on_state("quad", state((1.0, 1.1, 0.0), "landed"))
    assert score.as_dict()["quad"]["landed_off_m"] == [0.1]
    assert score_lines(score.as_dict()) == ["quad landed once, 0.10 m from the place."]


def test_a_goal_is_reached_where_the_robot_ends_near_it() -> None:
    score = RobotsScore()
    for goal_ns, end_m in ((5, 2.0), (7, 1.0)):
        score.on_state("rover", state((0.5, 0.5, 0.0), "idle"))
        score.on_goal(sent(goal_ns=goal_ns))
        score.on_state("rover", state((0.6, 0.5, 0.0), goal_ns=goal_ns))
        score.on_state("rover", state((end_m, 0.5, 0.0), "idle"))
    assert score_lines(score.as_dict()) == ["rover reached 1 of 2 goals."]


def sent(robot: str = "rover", goal_ns: int = 5, x_m: float = 2.0) -> Goal:
    return goal_at((x_m, 0.5, 0.0), stamp_ns=goal_ns, robot=robot)


def test_summary_has_person_and_distance_of_each_landing_and_goal() -> None:
    score = RobotsScore([(1.0, 1.0, 0.0)])
    for user, y in (("anna", 1.1), ("anna", 1.05), ("ben", 1.2)):
        score.on_state("quad", state((1.0, y, 0.2), user=user))
        score.on_state("quad", state((1.0, y, 0.1), "landing", user=user))
        score.on_state("quad", state((1.0, y, 0.0), "landed"))  # it is free then
    score.on_state("rover", state((0.5, 0.5, 0.0), "idle"))
    for goal_ns, end_m in ((5, 2.0), (7, 1.9)):
        score.on_goal(sent(goal_ns=goal_ns), "ben")
        score.on_state("rover", state((0.6, 0.5, 0.0), goal_ns=goal_ns))
        score.on_state("rover", state((end_m, 0.5, 0.0), "idle"))
    anna = "landed 2 times for anna, 0.10 and 0.05 m"
    ben = "landed once for ben, 0.20 m"

    assert score_lines(score.as_dict()) == [
        f"quad {anna} from the place; {ben} from the place.",
        "rover reached 2 of 2 goals of ben, 0.00 and 0.10 m from them.",
    ]
    assert score.as_dict()["quad"]["people"]["anna"]["landed_off_m"] == [0.1, 0.05]
    assert score.goals_without_robot == {}


def test_summary_has_goals_without_a_robot_by_person() -> None:
    score = RobotsScore()
    score.on_goal(sent("", x_m=1.0), "anna")
    score.on_goal(sent("", x_m=2.0), "anna")
    assert goal_lines(score.goals_without_robot) == [
        "anna sent a robot 2 times, last to 2.00, 0.50 m (1 sigma 0.10 m at most); none drives here."
    ]
    score.on_state("rover", state((0.5, 0.5, 0.0), "idle"))
    assert score.goals_without_robot == {}


def test_each_crossing_of_a_fence_counts_once() -> None:
    score = RobotsScore()
    score.on_map(ROOM)
    for place_m in ((1.0, 1.0, 0.2), (3.5, 3.5, 0.2), (3.6, 3.5, 0.2), (1.0, 1.0, 0.2), (1.0, 1.0, 2.1)):
        score.on_state("quad", state(place_m))
    assert score.as_dict()["quad"]["fences_crossed"] == 2
    assert score_lines(score.as_dict()) == ["quad crossed fences 2 times."]


@pytest.mark.parametrize(
    ("event", "cause", "line"),
    [
        ("selected", "dwell", "screws selected by anna"),
        ("deselected", "dwell", "screws deselected by anna"),
        ("deselected", "", None),
    ],
    ids=["fired", "switched off", "a button is over"],
)
async def test_a_button_that_is_over_is_not_printed(event: str, cause: str, line: str | None) -> None:
    told: list[str] = []
    async with memory_bench(ManualClock()) as bench:
        Monitor(RunScore(()), bench.clock, tell=told.append).attach(bench.bus)
        await bench.settle()
        fields = {"stamp_ns": 1, "event": event, "object_id": "screws", "user": "anna", "cause": cause}
        bench.put(SELECTION_EVENTS, SelectionEvent.model_validate(fields | {"kind": "screws"}))
        await bench.settle()
    assert [each for each in told if "screws" in each] == ([line] if line else [])


@pytest.mark.parametrize(
    ("results", "lines", "count", "acts"),
    [
        (["done"], ["screws selected by anna"], 1, {"started": 0, "done": 1}),
        (
            ["started", "failed"],
            ["screws selected by anna", "screws refused for anna: no power"],
            1,
            {"started": 0, "failed": 1},
        ),
    ],
)
async def test_an_act_is_told_and_counted_by_its_outcome(
    results: list[str], lines: list[str], count: int, acts: dict[str, int]
) -> None:
    told: list[str] = []
    async with memory_bench(ManualClock()) as bench:
        monitor = Monitor(RunScore(()), bench.clock, tell=told.append)
        monitor.attach(bench.bus)
        await bench.settle()
        usual = {"stamp_ns": 1, "event": "selected", "object_id": "screws", "user": "anna", "kind": "screws"}
        bench.put(SELECTION_EVENTS, SelectionEvent.model_validate(usual | {"carriers": ("reactions",)}))
        for result in results:
            text = "no power" if result == "failed" else ""
            bench.put(
                OUTCOMES, ActOutcome.model_validate(usual | {"event_ns": 1, "result": result, "text": text})
            )
        if "failed" in results:
            back = {"event": "deselected", "reason": f"{NOT_DONE}no power"}
            bench.put(SELECTION_EVENTS, SelectionEvent.model_validate(usual | back))
        await bench.settle()
    assert [each for each in told if "screws" in each] == lines
    assert (monitor.score.counts()["selected"], dict(monitor.acts)) == (count, acts)
