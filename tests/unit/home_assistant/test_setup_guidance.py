"""What a person is told while lamps are placed: the step of the card, and why a press does not count."""

import asyncio
import math
from pathlib import Path

import pytest

from pointit.runtime.errors import RefusedError
from pointit.schemas import ButtonEvent, Done, HomeSetup, PointingRay, Say
from pointit.schemas.topics import BUTTON, RAY, SAY
from tests.support.bench import Bench, repeated
from tests.unit.home_assistant.test_setup_session import (
    DESK,
    DOOR,
    at_place,
    cards,
    home_of_two,
    pointing,
    press,
    watch,
    with_token,
)


class Told:
    """A supervisor of anna: what she was told, and her next step."""

    def __init__(self, bench: Bench) -> None:
        self.texts: list[str] = []
        self.step: Say | None = None
        bench.bus.serve(SAY, self._say, "anna")

    async def _say(self, query: Say, _user: str) -> Done:
        if query.is_over:
            self.step = None
        elif query.guides:
            self.step = query
        else:
            self.texts.append(query.text)
        return Done(message="")


async def test_person_is_told_the_sentence_and_choices_of_the_card(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_token(tmp_path)
    async with cards(home_of_two(), tmp_path, monkeypatch) as (bench, shown):
        told = Told(bench)
        await at_place(shown)

        async def compare(words: str) -> HomeSetup:
            await asyncio.sleep(1.0)
            setup = await shown.act()
            assert words in setup.next_step
            assert told.step is not None
            assert (told.step.text, told.step.choices) == (setup.next_step, setup.choices)
            return setup

        await compare("(1 of 2), which is lit")
        await press(bench, 0.3)
        await press(bench, 0.3)
        setup = await compare("Or is it right beside")
        assert (setup.beside, setup.target) == (DESK, DOOR)
        await press(bench, -0.3)
        await compare("Walk about two metres")
        await shown.act(choice="stay", user="anna")
        await shown.until("try")
        await compare("Did it switch?")
        await shown.act(choice="met", user="anna")
        await compare(f"then at {DOOR}")
        await shown.act(choice="skip", user="anna")
        await compare("Your home is ready")
        await shown.act(choice="finish", user="anna")
        await asyncio.sleep(1.0)
        assert told.step is None


async def test_choice_of_another_person_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with_token(tmp_path)
    async with cards(home_of_two(), tmp_path, monkeypatch) as (_bench, shown):
        await at_place(shown)
        with pytest.raises(RefusedError, match="ben does not set up this home now"):
            await shown.act(choice="skip", user="ben")


async def test_press_while_the_arm_turns_does_not_count_and_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_token(tmp_path)
    async with cards(home_of_two(), tmp_path, monkeypatch) as (bench, shown):
        told = Told(bench)
        await at_place(shown)
        azimuth_rad = 0.0

        def turning() -> None:
            nonlocal azimuth_rad
            azimuth_rad += math.radians(90.0) * 0.05
            direction = (math.cos(azimuth_rad), math.sin(azimuth_rad), 0.0)
            ray = PointingRay(stamp_ns=bench.clock.now_ns(), origin_m=(0, 0, 1.6), direction=direction)
            bench.put(RAY, ray, "anna")

        async with repeated(0.05, turning):
            await asyncio.sleep(1.0)
            bench.put(BUTTON, ButtonEvent(stamp_ns=bench.clock.now_ns()), "anna")
            await asyncio.sleep(0.5)
        setup = await shown.act()
        sentence = "your arm moved: hold it still on the lamp, then press"
        assert (setup.problem, setup.target, told.texts) == (sentence, DESK, [sentence])
        await press(bench, 0.3)
        setup = await shown.act()
        assert (setup.problem, setup.target) == ("", DOOR)


async def test_missing_movement_is_no_problem_any_more_once_it_arrives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_token(tmp_path)
    async with cards(home_of_two(), tmp_path, monkeypatch) as (bench, shown):
        await at_place(shown)
        with pytest.raises(RefusedError, match="no movement of anna"):
            await shown.act("press")
        assert "no movement" in (await shown.act()).problem
        async with pointing(bench, 0.3):
            await asyncio.sleep(0.5)
        assert (await shown.act()).problem == ""


async def test_lost_home_is_waited_for_and_presses_wait_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = home_of_two()
    with_token(tmp_path)
    async with cards(home, tmp_path, monkeypatch) as (bench, shown):
        told = Told(bench)
        await at_place(shown)
        await asyncio.sleep(1.0)
        assert (await shown.act()).is_lit
        home.disconnect()
        await asyncio.sleep(1.0)
        setup = await shown.act()
        assert (setup.is_waiting, setup.is_lit, setup.is_connected) == (True, False, False)
        assert setup.next_step == "Wait: your home does not answer. It goes on by itself."
        assert told.step is not None
        assert told.step.text == setup.next_step
        await press(bench, 0.3)
        assert (await shown.act()).target == DESK

        setup = await watch(shown, 15.0)
        assert (setup.is_waiting, setup.problem) == (False, "")
        assert "Point at" in setup.next_step
