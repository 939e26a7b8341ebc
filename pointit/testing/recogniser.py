"""The contract of recognisers of speech: samples in, words with their times out."""

import asyncio
import itertools
from collections.abc import AsyncIterator, Mapping
from contextlib import aclosing
from types import MappingProxyType
from typing import Any

from pointit.plugins import NS_PER_S, Speech, Vocabulary
from pointit.testing.bench import START_NS
from pointit.testing.contract import (
    CANCEL_S,
    Contract,
    called,
    promise,
    require,
    require_nothing_left,
    require_parameters,
    require_responsive,
)

RATE_HZ = 16_000
"""Rate of the samples, each of 16 bits, signed, little endian, one channel."""
BLOCK_S = 0.1
SILENCE_S = 2.0
"""Length of the silence in which no word is recognised, s."""


class SampleAudio:
    """Samples in blocks of one size, as fast as they are taken. `is_endless`: then it waits for ever."""

    def __init__(self, samples: bytes, block_s: float = BLOCK_S, *, is_endless: bool = False) -> None:
        self._samples = samples
        self._is_endless = is_endless
        self._block_bytes = 2 * round(block_s * RATE_HZ)
        self.is_waiting = asyncio.Event()

    async def blocks(self) -> AsyncIterator[tuple[int, bytes]]:
        """Yield blocks of samples, each with the time of its first one, Unix ns."""
        for start in range(0, len(self._samples), self._block_bytes):
            stamp_ns = START_NS + start * NS_PER_S // (2 * RATE_HZ)
            yield stamp_ns, self._samples[start:][: self._block_bytes]
            await asyncio.sleep(0)
        if self._is_endless:
            self.is_waiting.set()
            await asyncio.get_running_loop().create_future()


class RecogniserContract(Contract):
    """Promises of a recogniser, with samples of speech and its words."""

    samples: bytes
    """Speech with silence around it: 16 kHz, 16 bits, signed, little endian, one channel."""
    words: tuple[str, ...]
    """Words of the samples, in their order."""
    names: Mapping[tuple[str, ...], str] = MappingProxyType({})
    """Names of the room by their words, if `words` has some."""
    parameters: Mapping[str, object] = MappingProxyType({})
    """Parameters with which it is tested."""

    def make(self) -> Any:
        """Return a new recogniser."""
        config = self.plugin.config.model_validate(dict(self.parameters))
        with called("make"):
            return self.plugin.make(config)

    async def recognise(self, audio: SampleAudio) -> list[Speech]:
        """Return the final utterances of `audio`."""
        with called("hear"):
            async with aclosing(self.make().hear(audio, Vocabulary(names=self.names))) as utterances:
                return [speech async for speech in utterances if speech.is_final]

    async def _recognise_samples(self) -> None:
        await self.recognise(SampleAudio(self.samples))

    @promise()
    async def test_parameters(self) -> None:
        """Describes itself and its parameters, and refuses those that cannot work, with ConfigError."""
        require_parameters(self, self.plugin.make)

    @promise()
    async def test_recognises(self) -> None:
        """Recognises the words of the samples in blocks of any size, and states their times."""
        end_ns = START_NS + len(self.samples) * NS_PER_S // (2 * RATE_HZ)
        for block_s in (BLOCK_S, 0.01, 1.0):
            utterances = await self.recognise(SampleAudio(self.samples, block_s))
            words = list(itertools.chain.from_iterable(speech.words for speech in utterances))
            result = " ".join(word.text for word in words)
            expected = " ".join(self.words)
            # Whatever the blocks, the words are the same
            require(
                result == expected,
                f"in blocks of {block_s:g} s it recognised {result!r}, expected {expected!r}",
                "Yield a `Speech` when an utterance or the audio has ended; buffer short blocks yourself",
            )
            times_ns = [START_NS, *(word.start_ns for word in words), end_ns]
            is_ordered = times_ns == sorted(times_ns)
            are_within = all(word.start_ns <= word.end_ns <= end_ns for word in words)
            spoken = [speech for speech in utterances if speech.words]
            have_ends = all(speech.stamp_ns == speech.words[-1].end_ns for speech in spoken)
            is_right = is_ordered and are_within
            require(
                is_right and have_ends,
                "the words are not in order within the audio, or `stamp_ns` is not the end of the last one",
                "Compute the times of words from those of the blocks, not from a clock",
            )

    @promise()
    async def test_ignores_silence(self) -> None:
        """Recognises no words in silence, nor in audio of no length."""
        for samples in (bytes(2 * round(SILENCE_S * RATE_HZ)), b""):
            utterances = await self.recognise(SampleAudio(samples))
            require(not any(speech.words for speech in utterances), "it recognised words in silence")

    @promise()
    async def test_does_not_block(self) -> None:
        """Does not hold up the event loop."""
        await require_responsive(self._recognise_samples)

    @promise()
    async def test_ends(self) -> None:
        """Ends within 1 s of being cancelled while it waits for audio, and leaves no task, thread or file."""
        # It is cancelled when it has taken all samples and waits for more, or has ended too early
        audio = SampleAudio(self.samples, is_endless=True)
        task = asyncio.create_task(self.recognise(audio))
        waiting = asyncio.create_task(audio.is_waiting.wait())
        await asyncio.wait({task, waiting}, return_when=asyncio.FIRST_COMPLETED)
        waiting.cancel()
        require(not task.done() or task.result() is None, "`hear` ended before the audio")
        task.cancel()
        _, late = await asyncio.wait({task}, timeout=CANCEL_S)
        require(not late, f"it did not end within {CANCEL_S:g} s of being cancelled", "Await what you start")
        await require_nothing_left(self._recognise_samples)
