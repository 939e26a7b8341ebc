"""Each promise of recognisers is broken by a recogniser that has this one fault."""

import asyncio
import time
from collections.abc import AsyncIterator
from dataclasses import replace
from typing import Any

import pytest

from pointit.plugins import Audio, Speech, Vocabulary
from pointit.testing import RecogniserHarness, checks, run_checks
from pointit.testing.templates.recogniser import RECOGNISER, LoudSounds, RecogniserConfig
from pointit.testing.templates.recogniser.fake import DEVICE

left: list[Any] = []


class Deaf(LoudSounds):
    async def hear(self, audio: Audio, vocabulary: Vocabulary) -> AsyncIterator[Speech]:
        async for speech in super().hear(audio, vocabulary):
            if not speech.words:
                yield speech


class ShortSighted(LoudSounds):
    """Drops what does not fill its step."""

    async def hear(self, audio: Audio, vocabulary: Vocabulary) -> AsyncIterator[Speech]:
        class Cut:
            async def blocks(self) -> AsyncIterator[tuple[int, bytes]]:
                async for stamp_ns, block in audio.blocks():
                    yield stamp_ns, block if len(block) < 32_000 else bytes(len(block))

        async for speech in super().hear(Cut(), vocabulary):
            yield speech


class ByClock(LoudSounds):
    async def hear(self, audio: Audio, vocabulary: Vocabulary) -> AsyncIterator[Speech]:
        async for speech in super().hear(audio, vocabulary):
            now_ns = time.time_ns()
            words = tuple(replace_times(word, now_ns) for word in speech.words)
            yield speech.model_copy(update={"words": words, "stamp_ns": now_ns})


def replace_times(word: Any, now_ns: int) -> Any:
    return word.model_copy(update={"start_ns": now_ns, "end_ns": now_ns})


class Imagining(LoudSounds):
    async def hear(self, audio: Audio, vocabulary: Vocabulary) -> AsyncIterator[Speech]:
        count = 0
        async for speech in super().hear(audio, vocabulary):
            count += 1
            yield speech
        if not count:
            yield (await anext(LoudSounds(RecogniserConfig()).hear(_Loud(), vocabulary)))


class _Loud:
    async def blocks(self) -> AsyncIterator[tuple[int, bytes]]:
        yield 1, b"\x00\x70" * 1600


class Stubborn(LoudSounds):
    async def hear(self, audio: Audio, vocabulary: Vocabulary) -> AsyncIterator[Speech]:
        try:
            async for speech in super().hear(audio, vocabulary):
                yield speech
        except asyncio.CancelledError:
            await asyncio.sleep(3.0)


class Slow(LoudSounds):
    async def hear(self, audio: Audio, vocabulary: Vocabulary) -> AsyncIterator[Speech]:
        time.sleep(0.6)  # noqa: ASYNC251 - the fault
        async for speech in super().hear(audio, vocabulary):
            yield speech


class Littering(LoudSounds):
    async def hear(self, audio: Audio, vocabulary: Vocabulary) -> AsyncIterator[Speech]:
        left.append(asyncio.create_task(asyncio.sleep(5.0)))
        async for speech in super().hear(audio, vocabulary):
            yield speech


@pytest.mark.parametrize(
    ("fault", "check"),
    [
        (Deaf, "recognises"),
        (ShortSighted, "takes_any_blocks"),
        (ByClock, "states_times"),
        (Imagining, "ignores_silence"),
        (Stubborn, "cancels"),
        (Slow, "does_not_block"),
        (Littering, "leaves_nothing"),
    ],
)
def test_fault_breaks_the_promise_about_it(fault: type[LoudSounds], check: str) -> None:
    harness: RecogniserHarness = replace(DEVICE, plugin=replace(RECOGNISER, make=fault))
    (chosen,) = (each for each in checks(harness) if each.name == check)
    ((_, problem),) = run_checks([chosen])
    assert problem.startswith(f"{check}: ")
    assert "the harness raised" not in problem


def test_summary_and_parameters_are_checked() -> None:
    harness = replace(
        DEVICE, plugin=replace(RECOGNISER, summary="two\nlines"), wrong_parameters=({"gap_s": 1},)
    )
    found = {each.name: problem for each, problem in run_checks(checks(harness)) if problem}
    assert set(found) == {"parameters", "config_errors"}
