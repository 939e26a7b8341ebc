"""The terminal asks until it has an answer, and keys become commands of the experimenter."""

import asyncio
from dataclasses import replace

import pytest

from pointit.cli.study import TerminalView
from pointit.study.model import Scale, StudyStep
from pointit.study.view import StudyCommand, StudyStatus

STATUS = StudyStatus(
    participant="P01", trial=3, block=1, condition="hold", left=9, target="", state="pointing"
)


async def typed(view: TerminalView, *lines: str) -> None:
    for line in lines:
        await asyncio.sleep(0.01)
        view.on_bytes(line.encode())


async def test_keys_are_commands_and_a_skip_pauses_until_its_reason_is_typed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    view = TerminalView()
    view.status(STATUS)
    view.on_bytes(b"rxs")
    view.status(STATUS)  # does not overwrite what is typed
    view.on_bytes(b"slippd\x7fed, q\nq")
    commands = [view.command() for _ in range(5)]
    assert commands == [
        StudyCommand("repeat"),
        StudyCommand("pause"),
        StudyCommand("skip", "slipped, q"),
        StudyCommand("stop"),
        None,
    ]
    assert "P01  trial 3, 9 left  hold  pointing" in capsys.readouterr().out


async def test_skip_during_a_pause_does_not_end_the_pause() -> None:
    view = TerminalView()
    view.status(replace(STATUS, state="paused"))
    view.on_bytes(b"sslipped\n")
    assert [view.command() for _ in range(2)] == [StudyCommand("skip", "slipped"), None]


async def test_participant_is_asked_until_the_answer_is_one(capsys: pytest.CaptureFixture[str]) -> None:
    view = TerminalView()
    scale = Scale(name="own", items=("Easy?", "Fast?"), points=(1, 5))
    async with asyncio.TaskGroup() as group:
        asked = group.create_task(view.ask(scale, "block 1 of 2"))
        await typed(view, "9\n", "yes\n", "4\n", "1\n")
    assert asked.result() == [4, 1]
    assert "Questions on block 1 of 2:" in capsys.readouterr().out
    differential = Scale(name="own", items=("Mood?",), points=(-4, 4), step=2)
    async with asyncio.TaskGroup() as group:
        asked = group.create_task(view.ask(differential))
        await typed(view, "3\n", "-2\n")
    assert asked.result() == [-2]
    for answer, agrees in (("n\n", False), ("y\n", True)):
        async with asyncio.TaskGroup() as group:
            told = group.create_task(view.tell(StudyStep(text="Do you agree?"), go="agree"))
            await typed(view, "\n", answer)
        assert told.result() is agrees
    assert view.command() is None
