"""Cues of phones."""

from typing import Any

from pointit.bridges.web.wrists.phone_cues import STEPS, Cues
from pointit.schemas import Candidate, Feedback, Interaction, Localization


def test_feedback_chimes_and_vibrates_with_its_text() -> None:
    cues = Cues()
    cue = cues.feedback(Feedback(stamp_ns=0, cue="selected", text="taken", chime="tick", haptic_ms=(30, 40)))
    assert (cue.chime, cue.haptic_ms, cue.text) == ("tick", (30, 40), "taken")


def test_the_interactions_state_is_told_once_and_stays_in_every_cue() -> None:
    cues = Cues()
    state = Interaction(stamp_ns=0, state="pointing", next_step="hold on a package")
    cue = cues.interaction(state)
    assert cue is not None
    assert (cue.state, cue.next_step) == ("pointing", "hold on a package")
    assert cues.interaction(state) is None
    assert cues.current == cue
    assert cues.feedback(Feedback(stamp_ns=0, cue="selected")).state == "pointing"


def test_a_localization_tells_each_target_once_and_why_it_was_refused() -> None:
    def at(samples: int, index: int) -> Localization:
        return Localization(
            stamp_ns=0,
            phase="sampling",
            target_id=f"led_{index}",
            target_index=index,
            target_count=3,
            samples=samples,
        )

    cues = Cues()
    first = cues.localization(at(0, 0))
    assert first is not None
    assert first.text == "point at led_0, 1 of 3"
    assert cues.localization(at(5, 0)) is None
    second = cues.localization(at(5, 1))
    assert second is not None
    assert second.text == "point at led_1, 2 of 3"
    refused = cues.localization(Localization(stamp_ns=0, phase="refused", reason="hold more steadily"))
    assert refused is not None
    assert refused.text == "hold more steadily"
    assert cues.localization(Localization(stamp_ns=0, phase="idle")) is None


def test_whether_a_double_press_is_wanted_is_told_with_the_state() -> None:
    cues = Cues()
    sure = Interaction(stamp_ns=0, state="pointing", next_step="point")
    cues.interaction(sure)
    assert not cues.current.wants_double
    cue = cues.interaction(sure.model_copy(update={"is_unsure": True}))
    assert cue is not None
    assert cue.wants_double
    assert cues.feedback(Feedback(stamp_ns=0, cue="selected")).wants_double


def test_progress_is_told_in_steps_from_the_first_target_to_the_end() -> None:
    def at(progress: float, **fields: Any) -> Localization:
        fields = {"phase": "sampling", "target_id": "led_0", "progress": progress, **fields}
        return Localization.model_validate({"stamp_ns": 0, **fields})

    cues = Cues()
    told = [cues.localization(at(k / 1000.0)) for k in range(1001)]
    shares = [cue.progress for cue in told if cue is not None]
    assert shares[0] == 0.0
    assert shares[-1] == 1.0
    assert len(shares) == STEPS + 1
    assert [cue.text for cue in told if cue is not None and cue.text] == ["point at led_0"]
    ended = cues.localization(at(1.0, phase="solved"))
    assert ended is not None
    assert ended.progress is None
    assert ended.text == ""
    assert cues.localization(at(0.0, target_id="", ahead=("ben",))) is None  # who waits points at nothing
    assert cues.current.progress is None


def test_a_robot_that_may_be_one_of_several_is_no_step() -> None:
    cues = Cues()
    cue = cues.localization(
        Localization(
            stamp_ns=0,
            phase="sampling",
            target_id="r1",
            target_count=3,
            candidates=(
                Candidate(object_id="r1", probability=0.6),
                Candidate(object_id="r2", probability=0.4),
            ),
        )
    )
    assert cue is not None
    assert cue.text == "point at r1"


def test_who_has_lost_the_arm_is_told_whether_somebody_else_has_it() -> None:
    cues = Cues()
    taken, returned = cues.loss(), cues.loss(is_own=True)
    assert taken.has_lost_arm
    assert returned.has_lost_arm
    assert "another device" in taken.text
    assert "another device" not in returned.text
    assert "your own" in returned.text
    assert not cues.current.has_lost_arm
