"""A button pressed from the command line, and anchors that are given up."""

import asyncio
from typing import Literal

import pytest

import pointit.schemas as models
from pointit.api.inputs import press
from pointit.cli.people.anchor import AnchorRequester
from pointit.runtime.bus.site_clock import SiteClock
from pointit.runtime.errors import NoAnswerError
from pointit.schemas import topics
from pointit.services.supervisor.service import Supervisor
from tests.support.bench import memory_bench, until

ANNA = "anna"


async def test_it_presses_and_returns_what_followed() -> None:
    async with memory_bench() as bench:
        buttons: list[models.ButtonEvent] = bench.collect(topics.BUTTON, ANNA)
        bench.start(Supervisor, user=ANNA)
        pose = models.UserPose(stamp_ns=bench.clock.now_ns(), position_m=(0, 0, 0), yaw_rad=0)
        bench.put(topics.POSE, pose, ANNA)
        await bench.settle()
        assert (await press(bench.bus, SiteClock(bench.bus), ANNA, "press")).state == "pointing"
        assert "corrected" in (await press(bench.bus, SiteClock(bench.bus), ANNA, "double")).reason

        await bench.settle()  # there is no localizer that could: back to where they were
        after = await press(bench.bus, SiteClock(bench.bus), ANNA, "press")
        assert (after.state, after.reason) == ("idle", "You stopped.")
        assert [(event.gesture, event.source) for event in buttons] == [
            ("press", "keyboard"),
            ("double", "keyboard"),
            ("press", "keyboard"),
        ]


async def test_press_without_an_effect_has_an_answer() -> None:
    async with memory_bench() as bench:
        bench.start(Supervisor, user=ANNA)
        await bench.settle()
        first = await press(bench.bus, SiteClock(bench.bus), ANNA, "press")
        # for the same reason: only a cue
        second = await press(bench.bus, SiteClock(bench.bus), ANNA, "press")
        assert "not known" in first.reason
        assert first == second
        assert (await press(bench.bus, SiteClock(bench.bus), ANNA, "double", patience_s=0.1)).state == "idle"


async def test_a_cue_of_pointing_past_is_no_answer() -> None:
    async with memory_bench() as bench:
        bench.bus.announce(topics.SERVICE_ALIVE, "supervisor.anna")
        bench.put(topics.INTERACTION, models.Interaction(stamp_ns=1, state="pointing"), ANNA)
        past = models.Feedback(stamp_ns=2, cue="target", text="you point below", turn_rad=(0.0, 0.3))
        bench.bus.subscribe(topics.BUTTON, lambda _event, _user: bench.put(topics.FEEDBACK, past, ANNA))
        with pytest.raises(NoAnswerError, match="did not answer"):
            await press(bench.bus, SiteClock(bench.bus), ANNA, "press", patience_s=0.2)


async def test_nobody_who_answers_is_one_sentence() -> None:
    async with memory_bench() as bench:
        for present, told in (
            ("", r"anna has no supervisor: .* `pointit person add anna`"),
            ("ben", r"anna has no supervisor: there is ben; add them with"),
            ("anne", r"did you mean anne, or add them with .* add anna`\?"),
        ):
            if present:
                bench.bus.announce(topics.SERVICE_ALIVE, f"supervisor.{present}")
            with pytest.raises(NoAnswerError, match=told):
                await press(bench.bus, SiteClock(bench.bus), ANNA, "press", patience_s=0.05)


async def test_a_supervisor_that_hangs_is_one_sentence() -> None:
    async with memory_bench() as bench:
        bench.bus.announce(topics.SERVICE_ALIVE, "supervisor.anna")
        with pytest.raises(NoAnswerError, match="present but says nothing"):
            await press(bench.bus, SiteClock(bench.bus), ANNA, "press", patience_s=0.05)
        interaction = models.Interaction(stamp_ns=1, state="idle", next_step="Press.", reason="")
        bench.put(topics.INTERACTION, interaction, ANNA)
        for gesture in ("press", "double"):
            with pytest.raises(NoAnswerError, match=r"supervisor\.anna did not answer within 0\.05 s"):
                await press(bench.bus, SiteClock(bench.bus), ANNA, gesture, patience_s=0.05)


@pytest.mark.parametrize(("phase", "called_off"), [("idle", ["cancel"]), ("sampling", [])])
async def test_anchor_that_is_given_up_leaves_no_lamp_lit(
    phase: Literal["idle", "sampling"], called_off: list[str]
) -> None:
    asked: list[str] = []

    async def point(_query: models.PointAnchor, _user: str) -> models.Done:
        asked.append("anchor")
        await asyncio.Event().wait()
        return models.Done()

    async def cancel(_query: models.CancelLocalization, _user: str) -> models.Done:
        asked.append("cancel")
        return models.Done()

    async with memory_bench() as bench:
        bench.bus.serve(topics.POINT_ANCHOR, point, ANNA)
        bench.bus.serve(topics.CANCEL_LOCALIZATION, cancel, ANNA)
        bench.put(topics.LOCALIZATION, models.Localization(stamp_ns=1, phase=phase, since_ns=1), ANNA)
        pointing = asyncio.create_task(
            AnchorRequester(bench.bus, ANNA).point("led_1", 5.0, lambda _text: None)
        )
        await until(lambda: asked == ["anchor"])
        pointing.cancel()
        with pytest.raises(asyncio.CancelledError):
            await pointing
    assert asked == ["anchor", *called_off]
