"""Recognisers with one fault each, made from the template, and the test that must catch it."""

import asyncio
import time
from collections.abc import AsyncIterator
from typing import Any

from pointit.plugins import Audio, Speech, Vocabulary
from pointit.testing.templates.recogniser import LoudSounds, RecogniserConfig
from pointit.testing.templates.recogniser.promises import RecogniserPromises
from tests.unit.testing_kit.faults import CaughtBy

caught_by = CaughtBy(RecogniserPromises)
left: list[Any] = []


@caught_by("recognises", "it recognised ''")
class Deaf(LoudSounds):
    async def hear(self, audio: Audio, vocabulary: Vocabulary) -> AsyncIterator[Speech]:
        async for speech in super().hear(audio, vocabulary):
            if not speech.words:
                yield speech


@caught_by("recognises", "in blocks of .* it recognised")
class ShortSighted(LoudSounds):
    """Drops what does not fill its step."""

    async def hear(self, audio: Audio, vocabulary: Vocabulary) -> AsyncIterator[Speech]:
        class Cut:
            async def blocks(self) -> AsyncIterator[tuple[int, bytes]]:
                async for stamp_ns, block in audio.blocks():
                    yield stamp_ns, block if len(block) < 32_000 else bytes(len(block))

        async for speech in super().hear(Cut(), vocabulary):
            yield speech


@caught_by("recognises", "not in order within the audio")
class ByClock(LoudSounds):
    async def hear(self, audio: Audio, vocabulary: Vocabulary) -> AsyncIterator[Speech]:
        async for speech in super().hear(audio, vocabulary):
            now_ns = time.time_ns()
            words = tuple(replace_times(word, now_ns) for word in speech.words)
            yield speech.model_copy(update={"words": words, "stamp_ns": now_ns})


def replace_times(word: Any, now_ns: int) -> Any:
    return word.model_copy(update={"start_ns": now_ns, "end_ns": now_ns})


@caught_by("ignores_silence", "words in silence")
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


@caught_by("ends", "did not end within")
class Stubborn(LoudSounds):
    async def hear(self, audio: Audio, vocabulary: Vocabulary) -> AsyncIterator[Speech]:
        try:
            async for speech in super().hear(audio, vocabulary):
                yield speech
        except asyncio.CancelledError:
            await asyncio.sleep(3.0)


@caught_by("does_not_block", "stood still")
class Slow(LoudSounds):
    async def hear(self, audio: Audio, vocabulary: Vocabulary) -> AsyncIterator[Speech]:
        time.sleep(0.6)  # noqa: ASYNC251 - the fault
        async for speech in super().hear(audio, vocabulary):
            yield speech


@caught_by("ends", "task <coroutine")
class Littering(LoudSounds):
    async def hear(self, audio: Audio, vocabulary: Vocabulary) -> AsyncIterator[Speech]:
        left.append(asyncio.create_task(asyncio.sleep(5.0)))
        async for speech in super().hear(audio, vocabulary):
            yield speech


caught_by("parameters", "is no line", summary="two\nlines")(LoudSounds)
