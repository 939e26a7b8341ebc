"""What phones are told."""

from pointit.bridges.web.cues import Cues
from pointit.schemas import Feedback, Interaction, Localization


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
