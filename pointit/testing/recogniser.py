"""Checks of recognisers of speech: samples in, words with their times out."""

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import aclosing
from dataclasses import dataclass, field
from typing import Any

from pointit.plugins import NS_PER_S, RecogniserPlugin, Speech, Vocabulary
from pointit.runtime.clock import START_NS
from pointit.testing.requirements import (
    CLOSE,
    require_nothing_left,
    require_parameters,
    require_refusals,
    require_responsive,
)
from pointit.testing.trial import CANCEL_S, CheckFailedError, Harness, Suite, called

RATE_HZ = 16_000
"""Rate of the samples, each of 16 bits, signed, little endian, one channel."""
BLOCK_S = 0.1
SILENCE_S = 2.0
"""Length of the silence in which no word is recognised, s."""


@dataclass(frozen=True, kw_only=True)
class RecogniserHarness(Harness[RecogniserPlugin]):
    """A recogniser, with samples of speech and its words."""

    samples: bytes
    """Speech with silence around it: 16 kHz, 16 bits, signed, little endian, one channel."""
    words: tuple[str, ...]
    """Words of the samples, in their order."""
    names: Mapping[tuple[str, ...], str] = field(default_factory=dict[tuple[str, ...], str])
    """Names of the room by their words, if `words` has some."""
    parameters: Mapping[str, object] = field(default_factory=dict[str, object])
    """Parameters with which it is checked."""

    def make(self) -> Any:
        """Return a new recogniser."""
        config = self.plugin.config.model_validate(dict(self.parameters))
        with called("make"):
            return self.plugin.make(config)


class SampleAudio:
    """Samples in blocks of one size, as fast as they are taken. `is_endless`: then it waits for ever."""

    def __init__(self, samples: bytes, block_s: float = BLOCK_S, *, is_endless: bool = False) -> None:
        self._samples, self._is_endless = samples, is_endless
        self._block_bytes = 2 * round(block_s * RATE_HZ)
        self.is_waiting = asyncio.Event()

    async def blocks(self) -> AsyncIterator[tuple[int, bytes]]:
        """Yield blocks of samples, each with the time of its first one, Unix ns."""
        for start in range(0, len(self._samples), self._block_bytes):
            yield START_NS + start * NS_PER_S // (2 * RATE_HZ), self._samples[start:][: self._block_bytes]
            await asyncio.sleep(0)
        if self._is_endless:
            self.is_waiting.set()
            await asyncio.get_running_loop().create_future()


RECOGNISER_SUITE: Suite[RecogniserHarness] = Suite()


async def recognised(harness: RecogniserHarness, audio: SampleAudio) -> list[Speech]:
    """Return the final utterances of `audio`."""
    vocabulary = Vocabulary(names=harness.names)
    with called("hear"):
        async with aclosing(harness.make().hear(audio, vocabulary)) as utterances:
            return [speech async for speech in utterances if speech.is_final]


def _require_words(harness: RecogniserHarness, speech: list[Speech], audio: str) -> None:
    words = tuple(word.text for each in speech for word in each.words)
    if words != harness.words:
        raise CheckFailedError(
            f"of {audio} it recognised {' '.join(words) or 'nothing'!r}, expected {' '.join(harness.words)!r}"
        )


@RECOGNISER_SUITE.check("Operators see the summary in `pointit plugin list`; give each Field a description")
async def parameters(harness: RecogniserHarness) -> None:
    """Has a summary of one line, and a description for each parameter."""
    require_parameters(harness.plugin)


@RECOGNISER_SUITE.check(
    "Limit parameters by `Field(gt=…, le=…)`, or raise pointit.plugins.ConfigError from `make`"
)
async def config_errors(harness: RecogniserHarness) -> None:
    """Refuses parameters that cannot work, with ConfigError and nothing else."""
    require_refusals(harness, harness.plugin.make)


@RECOGNISER_SUITE.check("Yield a `Speech` when an utterance has ended, and when the audio ends")
async def recognises(harness: RecogniserHarness) -> None:
    """Recognises the words of the samples, and ends when the audio ends."""
    _require_words(harness, await recognised(harness, SampleAudio(harness.samples)), "the samples")


@RECOGNISER_SUITE.check("Buffer samples yourself: a microphone chooses the size of its blocks")
async def takes_any_blocks(harness: RecogniserHarness) -> None:
    """Recognises the same words in blocks of 10 ms and of one second."""
    for block_s in (0.01, 1.0):
        audio = SampleAudio(harness.samples, block_s)
        _require_words(harness, await recognised(harness, audio), f"blocks of {block_s:g} s")


@RECOGNISER_SUITE.check("Compute the times of words from those of the blocks, not from a clock")
async def states_times(harness: RecogniserHarness) -> None:
    """States the times of words, in order and within the audio, and the end of the last as the stamp."""
    end_ns = START_NS + len(harness.samples) * NS_PER_S // (2 * RATE_HZ)
    last_ns = START_NS
    for speech in await recognised(harness, SampleAudio(harness.samples)):
        for word in speech.words:
            if not last_ns <= word.start_ns <= word.end_ns <= end_ns:
                times = f"{(word.start_ns - START_NS) / 1e9:.2f} to {(word.end_ns - START_NS) / 1e9:.2f} s"
                raise CheckFailedError(f"{word.text!r} is at {times} of {(end_ns - START_NS) / 1e9:.2f} s")
            last_ns = word.start_ns
        if speech.words and speech.stamp_ns != speech.words[-1].end_ns:
            raise CheckFailedError(f"`stamp_ns` is {speech.stamp_ns}, expected {speech.words[-1].end_ns}")


@RECOGNISER_SUITE.check("Yield nothing that is no speech")
async def ignores_silence(harness: RecogniserHarness) -> None:
    """Recognises no words in silence, nor in audio of no length."""
    for samples in (bytes(2 * round(SILENCE_S * RATE_HZ)), b""):
        if any(speech.words for speech in await recognised(harness, SampleAudio(samples))):
            raise CheckFailedError("it recognised words in silence")


@RECOGNISER_SUITE.check("Await what you start, and do not catch CancelledError")
async def cancels(harness: RecogniserHarness) -> None:
    """Ends within 1 s of being cancelled while it waits for audio."""
    audio = SampleAudio(harness.samples, is_endless=True)
    task = asyncio.create_task(recognised(harness, audio))
    waiting = asyncio.create_task(audio.is_waiting.wait())
    await asyncio.wait({task, waiting}, return_when=asyncio.FIRST_COMPLETED)
    waiting.cancel()
    if task.done():
        task.result()
        raise CheckFailedError("`hear` ended before the audio")
    task.cancel()
    if (await asyncio.wait({task}, timeout=CANCEL_S))[1]:
        raise CheckFailedError(f"it did not end within {CANCEL_S:g} s of being cancelled")


@RECOGNISER_SUITE.check("Call what takes long in a thread, `asyncio.to_thread`", alone=True)
async def does_not_block(harness: RecogniserHarness) -> None:
    """Does not hold up the event loop."""

    async def act() -> None:
        await recognised(harness, SampleAudio(harness.samples))

    await require_responsive(act)


@RECOGNISER_SUITE.check(CLOSE, alone=True)
async def leaves_nothing(harness: RecogniserHarness) -> None:
    """Leaves no task, thread or file when the audio has ended."""

    async def round_trip() -> None:
        await recognised(harness, SampleAudio(harness.samples))

    await require_nothing_left(round_trip)
