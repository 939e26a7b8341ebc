"""Recognises one word, `this`: each loud sound is one."""

from collections.abc import AsyncIterator

import numpy as np
from pydantic import Field

from pointit.plugins import NS_PER_S, Audio, Config, RecogniserPlugin, Speech, Vocabulary, Word

RATE_HZ = 16_000
"""Rate of the samples, each of 16 bits, signed, little endian, one channel."""
STEP = 160
"""Samples whose loudness is computed at once."""


class RecogniserConfig(Config):
    """Parameters of the recogniser."""

    loudness: float = Field(
        default=0.1, gt=0, le=1, description="level of a sound that is a word; 1: the loudest"
    )
    gap_s: float = Field(default=0.2, gt=0, le=2, description="silence after which a word has ended, s")


class LoudSounds:
    """Recogniser of one person's loud sounds."""

    def __init__(self, config: RecogniserConfig) -> None:
        self._level = config.loudness * 32768.0
        self._gap_ns = round(config.gap_s * NS_PER_S)

    async def hear(self, audio: Audio, vocabulary: Vocabulary) -> AsyncIterator[Speech]:
        """Yield an utterance for each loud sound. A real one recognises words of `vocabulary`."""
        word = "this" if "this" in vocabulary.words else ""
        start_ns = end_ns = 0
        buffered = b""
        buffered_ns = 0
        async for stamp_ns, block in audio.blocks():
            buffered_ns = buffered_ns if buffered else stamp_ns
            buffered += block
            while len(buffered) >= 2 * STEP:
                step = buffered[: 2 * STEP]
                buffered = buffered[2 * STEP :]
                now_ns = buffered_ns
                buffered_ns = buffered_ns + STEP * NS_PER_S // RATE_HZ
                if np.abs(np.frombuffer(step, "<i2").astype(float)).max() >= self._level:
                    start_ns = start_ns or now_ns
                    end_ns = buffered_ns
                elif start_ns and now_ns - end_ns >= self._gap_ns:
                    yield utterance(word, start_ns, end_ns)
                    start_ns = 0
        if start_ns:
            yield utterance(word, start_ns, end_ns)


def utterance(word: str, start_ns: int, end_ns: int) -> Speech:
    """Return an utterance of one word."""
    words = (Word(text=word, start_ns=start_ns, end_ns=end_ns),) if word else ()
    return Speech(stamp_ns=end_ns, words=words)


RECOGNISER = RecogniserPlugin(summary="each loud sound is `this`", config=RecogniserConfig, make=LoudSounds)
