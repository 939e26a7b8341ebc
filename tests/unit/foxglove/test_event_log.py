"""Log lines from messages, each once."""

import pytest
from foxglove.messages import LogLevel

from pointit.bridges.foxglove.event_log import HISTORY, LogLine
from pointit.schemas import Feedback, Health, Interaction, Localization, RobotState, SelectionEvent
from pointit.schemas.problems import Problem
from pointit.schemas.system import KeyHealth
from tests.integration.foxglove.protobuf import read
from tests.unit.foxglove.site_scene import TOPIC_OF, SiteLog


def health(*warnings: str, errors: int = 0, lost: int = 0, invalid: int = 0) -> Health:
    keys = (KeyHealth(key="map", direction="in", rate_hz=1.0, lost=lost, invalid=invalid),)
    problems = tuple(Problem(code="silent", sentence=each) for each in warnings)
    return Health(
        stamp_ns=1, service="pui", instance="pui", pid=1, problems=problems, errors=errors, keys=keys
    )


def said(lines: list[LogLine]) -> list[tuple[LogLevel, str, str]]:
    return [(line.level, line.source, line.text) for line in lines]


def test_warning_is_logged_at_its_start_and_end() -> None:
    chronicle = SiteLog()
    first = chronicle.hear(health("nothing came for 3 s; start it"), "pui", 5)
    assert said(first) == [(LogLevel.Warning, "pui", "nothing came for 3 s; start it")]
    assert chronicle.hear(health("nothing came for 4.5 s; start it"), "pui", 6) == []
    assert said(chronicle.active_warnings(7)) == [
        (LogLevel.Warning, "pui", "nothing came for 4.5 s; start it")
    ]
    gone = chronicle.hear(health(), "pui", 8)
    assert said(gone) == [(LogLevel.Info, "pui", "no longer: nothing came for 4.5 s; start it")]
    assert chronicle.active_warnings(9) == []


def test_growing_counts_of_errors_and_losses_are_logged() -> None:
    chronicle = SiteLog()
    assert said(chronicle.hear(health(errors=1, lost=2, invalid=3), "pui", 5)) == [
        (LogLevel.Error, "pui", "1 handlers failed; see its log"),
        (LogLevel.Warning, "pui", "2 events were lost on their way to it"),
        (LogLevel.Warning, "pui", "3 messages to it could not be read"),
    ]
    assert chronicle.hear(health(errors=1, lost=2, invalid=3), "pui", 6) == []
    assert said(chronicle.hear(health(errors=3, lost=2, invalid=3), "pui", 7))[0][2].startswith("2 handlers")


def test_a_service_that_ended_begins_anew() -> None:
    chronicle = SiteLog()
    chronicle.hear(health("odd", errors=5), "pui", 5)
    chronicle.site.set_service("pui", present=False)
    assert said(chronicle.presence("pui", 6, present=False)) == [(LogLevel.Warning, "pui", "has ended")]
    assert chronicle.active_warnings(6) == []
    assert said(chronicle.presence("pui", 7, present=True)) == [(LogLevel.Info, "pui", "runs")]
    chronicle.site.set_service("pui", present=True)
    assert len(chronicle.hear(health("odd", errors=1), "pui", 8)) == 2


def test_selections_cues_and_states_are_sentences() -> None:
    chronicle = SiteLog()
    event = SelectionEvent(stamp_ns=1, event="selected", object_id="7", kind="red", user="anna")
    assert said(chronicle.hear(event, "", 5)) == [(LogLevel.Info, "selection", "anna selected red 7")]
    refused = SelectionEvent(stamp_ns=1, event="refused", object_id="7", user="bert", reason="anna has it")
    assert said(chronicle.hear(refused, "", 5)) == [
        (LogLevel.Warning, "selection", "bert refused 7: anna has it")
    ]
    out = SelectionEvent(stamp_ns=1, event="dispatched", object_id="7", kind="red", bay="3")
    assert said(chronicle.hear(out, "", 5))[0][2] == "dispatched red 7 to bay 3"
    cue = Feedback(stamp_ns=1, cue="target", text="point at led_1")
    assert said(chronicle.hear(cue, "anna", 5)) == [(LogLevel.Info, "anna", "cue target: point at led_1")]
    state = Interaction(stamp_ns=1, state="pointing", reason="localized")
    assert said(chronicle.hear(state, "anna", 5)) == [(LogLevel.Info, "anna", "is pointing: localized")]
    assert chronicle.hear(state, "anna", 6) == []


def test_localization_is_logged_by_phase_and_target() -> None:
    chronicle = SiteLog()

    def told(**fields: object) -> list[tuple[LogLevel, str, str]]:
        return said(chronicle.hear(Localization.model_validate({"stamp_ns": 1, **fields}), "anna", 5))

    assert told(phase="idle") == []
    assert told(phase="sampling", target_id="led_0")[0][2] == "localization sampling led_0"
    assert told(phase="sampling", target_id="led_0", samples=9) == []
    assert told(phase="sampling", target_id="led_1")[0][2] == "localization sampling led_1"
    assert told(phase="refused", reason="too close; step back") == [
        (LogLevel.Warning, "anna", "localization refused: too close; step back")
    ]


@pytest.mark.parametrize(
    ("state", "service", "line"),
    [
        (
            Localization(stamp_ns=1, phase="refused", reason="arm moved"),
            "localizer.anna",
            "localization refused: arm moved",
        ),
        (
            Interaction(stamp_ns=1, state="pointing", reason="located"),
            "supervisor.anna",
            "is pointing: located",
        ),
    ],
)
def test_unchanged_state_is_not_logged_when_its_service_returns(
    state: Localization | Interaction, service: str, line: str
) -> None:
    chronicle = SiteLog()
    chronicle.site.set_service(service, present=True)
    told = chronicle.hear(state, "anna", 5)
    chronicle.site.set_service(service, present=False)
    chronicle.site.set_service(service, present=True)  # adds to the lines of the last message, if any
    assert [each.text for each in told] == [line]
    assert len(chronicle.site.all(TOPIC_OF[type(state)])) == 1, "it is valid again"


def test_newcomers_read_the_last_lines_only() -> None:
    chronicle = SiteLog()
    for number in range(HISTORY + 5):
        chronicle.hear(Feedback(stamp_ns=1, cue="selected", text=str(number)), "anna", number)
    assert len(chronicle.history) == HISTORY
    assert chronicle.history[0].text == "cue selected: 5"


def test_a_line_is_a_log_message() -> None:
    line = LogLine(3_000_000_007, LogLevel.Warning, "pui", "odd")
    assert read(line.log()) == {
        "timestamp": {"seconds": 3, "nanos": 7},
        "level": 3,
        "message": "odd",
        "name": "pui",
    }


def test_steering_and_reason_of_a_robot_are_logged_once() -> None:
    chronicle = SiteLog()

    def told(**fields: object) -> list[tuple[LogLevel, str, str]]:
        at = {"position_m": (0, 0, 0), "velocity_mps": (0, 0, 0), "yaw_rad": 0.0, "radius_m": 0.2}
        state = RobotState.model_validate({"stamp_ns": 1, "kind": "ground", "phase": "idle", **at, **fields})
        return said(chronicle.hear(state, "cart", 5))

    assert told() == []
    assert told(user="anna") == [(LogLevel.Info, "cart", "anna steers it")]
    near = [(LogLevel.Warning, "cart", "stopped: ben is 0.9 m away")]
    assert told(user="anna", phase="stopped", reason="ben is 0.9 m away", reason_code="person") == near
    assert told(user="anna", phase="stopped", reason="ben is 0.8 m away", reason_code="person") == []
    assert told(user="anna") == []
    chronicle.site.set_service("robot.cart", present=True)
    chronicle.site.set_service("robot.cart", present=False)
    chronicle.site.set_service("robot.cart", present=True)
    assert told() == [(LogLevel.Info, "cart", "nobody steers it")]
    assert told() == []
