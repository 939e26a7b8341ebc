"""A turn that is waited for is shown and counted; what others ask for is followed; robots are named once."""

import itertools

import pytest

from pointit.schemas import Feedback
from pointit.schemas.cues import SIGNS
from pointit.services.supervisor import transitions
from pointit.services.supervisor.life_cycle import InteractionPublisher, Output
from tests.unit.supervisor.played import (
    Gesture,
    S,
    life_cycle,
    localizing,
    news,
    pose,
    press,
    sample,
    shown,
    told,
)


def targets(outputs: list[Output]) -> list[str]:
    return [output.target_id for output in outputs if isinstance(output, Feedback) and output.cue == "target"]


@pytest.mark.parametrize(
    ("ahead", "sentence"),
    [
        (("anna",), "Wait: anna is pointing at the lamps. You are second. Press the button to cancel."),
        (
            ("anna", "ben"),
            "Wait: anna is pointing at the lamps, then comes ben. You are third. Press the button to cancel.",
        ),
    ],
)
def test_queue_is_shown_as_the_next_step(ahead: tuple[str, ...], sentence: str) -> None:
    cycle = localizing()
    outputs = cycle.localization(*news(11, "sampling", ahead=ahead))
    assert told(outputs) == ["localizing"]  # they wait already: no cue
    assert (shown(outputs).ahead, shown(outputs).next_step) == (ahead, sentence)
    assert cycle.localization(*news(12, "sampling", ahead=ahead)) == []
    outputs = cycle.localization(*news(13, "sampling", target_id="led_0", target_count=2))
    assert (targets(outputs), shown(outputs).ahead) == (["led_0"], ())


def test_cues_say_whether_to_wait_or_to_go_on() -> None:
    cycle = life_cycle(localize=True)
    cycle.begin(0)
    outputs = [*cycle.button(*press(10))]
    cycle.on_start_accepted(cycle.run)
    outputs += cycle.localization(*news(11, "sampling", target_id="led_0"))
    outputs += cycle.localization(*news(12, "sampling", ahead=("anna",)))  # the lamp is left to her
    outputs += cycle.localization(*news(13, "sampling", target_id="led_0"))
    cycle.pose(*pose(14))
    outputs += cycle.localization(*news(14, "solved"))
    cues = [output for output in outputs if isinstance(output, Feedback)]

    assert [(cue.cue, cue.target_id, cue.waits) for cue in cues] == [
        ("started", "", True),
        ("target", "led_0", False),
        ("target", "", True),
        ("target", "led_0", False),
        ("localized", "", False),
        ("started", "", False),
    ]


def test_timeout_counts_from_the_end_of_the_queue() -> None:
    cycle = localizing()
    for now_s in range(11, 200):
        assert cycle.tick(now_s * S) == []
        cycle.imu(*sample(now_s))
        cycle.localization(*news(now_s, "sampling", ahead=("anna",)))
    cycle.localization(*news(199.5, "sampling", target_id="led_0"))
    for now_s in range(200, 259):
        cycle.imu(*sample(now_s))
        assert cycle.tick(now_s * S) == []
    cycle.imu(*sample(258.9))
    assert told(cycle.tick(259 * S)) == ["cancel", "idle", "cue refused"]


@pytest.mark.parametrize("gesture", ["press", "double", "hold"])
def test_press_cancels_while_waiting(gesture: Gesture) -> None:
    cycle = localizing()
    cycle.localization(*news(11, "sampling", ahead=("anna",)))
    outputs = cycle.button(*press(12, gesture))
    assert told(outputs) == ["cancel", "idle", "cue stopped"]
    assert shown(outputs).ahead == ()
    late = news(12.1, "sampling", target_id="led_0", since_ns=round(10.1 * S))
    assert cycle.localization(*late) == []


def test_robot_is_announced_once_when_candidates_change() -> None:
    cycle = localizing()
    assert cycle.localization(*news(11, "sampling")) == []
    named = list[str]()
    candidates = tuple({"object_id": robot, "probability": 0.5} for robot in ("r1", "r2"))
    for robot in ("r1", "r2", "r1"):
        more = {"target_id": robot, "target_count": 2, "candidates": candidates}
        outputs = cycle.localization(*news(12, "sampling", **more))
        named += targets(outputs)
        assert shown(outputs).next_step == f"Point at {robot} and stay on it."
    assert named == ["r1"]


@pytest.mark.parametrize("back", ["pointing", "idle"])
def test_localization_of_another_client_is_followed(back: str) -> None:
    cycle = life_cycle()
    cycle.begin(0)
    cycle.pose(*pose())
    if back == "pointing":
        cycle.button(*press(5))
    assert cycle.localization(*news(10, "sampling", ahead=("anna",), since_ns=10 * S)) == []  # not yet
    outputs = cycle.localization(*news(11, "sampling", target_id="led_0", since_ns=10 * S))
    assert told(outputs) == ["localizing", "cue target"]
    assert shown(outputs).reason == transitions.POSE_ASKED_FOR
    ends = ["pointing", "cue started"] if back == "pointing" else ["idle", "cue stopped"]
    assert told(cycle.localization(*news(13, "solved", since_ns=10 * S))) == ["cue localized", *ends]


def test_localization_of_another_client_is_cancelled_by_gestures_alone() -> None:
    cycle = life_cycle()
    cycle.begin(0)
    robot = {"target_id": "r1", "since_ns": 10 * S}
    cycle.localization(*news(10, "sampling", **robot))
    assert told(cycle.tick(13 * S)) == ["idle", "cue refused"]  # the wrist is silent; no cancel
    assert cycle.localization(*news(14, "sampling", **robot)) == []
    assert "localizing" in told(cycle.localization(*news(20, "sampling", target_id="r1", since_ns=20 * S)))
    assert told(cycle.button(*press(21))) == ["cancel", "idle", "cue stopped"]
    assert cycle.localization(*news(21.1, "sampling", target_id="r1", since_ns=22 * S)) == []  # in between
    cycle.on_cancel_reply(22 * S)
    assert "localizing" in told(cycle.localization(*news(23, "sampling", target_id="r1", since_ns=23 * S)))


def test_cues_differ_in_each_sense_alone() -> None:
    signs = list(SIGNS.values())
    for senses in ([s.chime for s in signs], [s.haptic_ms for s in signs], [s.color for s in signs]):
        assert len(set(senses)) == len(signs)
    lightness = sorted(0.2126 * r + 0.7152 * g + 0.0722 * b for r, g, b in (s.color for s in signs))
    assert all(high - low > 8.0 for low, high in itertools.pairwise(lightness))


def test_lamps_flash_at_most_three_times_a_second() -> None:
    voice = InteractionPublisher()
    cues = [voice.cue(round(tick * 0.1 * S), "target", "x") for tick in range(40)]
    lit = [cue.stamp_ns for cue in cues if cue.color is not None]
    assert len(lit) == 12
    assert all(late - early >= S for early, late in zip(lit, lit[3:], strict=False))
