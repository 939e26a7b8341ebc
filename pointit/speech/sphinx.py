"""PocketSphinx: offline, with the English model of its wheel and a grammar of the room's names."""

import asyncio
import importlib
import re
from collections.abc import AsyncIterator
from typing import Any

from pydantic import Field

from pointit.errors import ConfigError
from pointit.runtime.config.config import Config
from pointit.runtime.host.extras import remedy
from pointit.schemas import NS_PER_S, Speech, Word
from pointit.speech.grammar import Vocabulary
from pointit.speech.recogniser import RATE_HZ, Audio, RecogniserPlugin

FRAMES_PER_S = 100
"""Frames of the decoder's times."""
NOISE = re.compile(r"[<\[(+].*|.*\(NULL\).*")
"""Silence and fillers among the decoder's words."""
VARIANT = re.compile(r"\(\d+\)\Z")
"""Number of a pronunciation behind a word."""
NAME = "pocketsphinx"


class SphinxConfig(Config):
    """Parameters of PocketSphinx."""

    window_s: float = Field(default=0.3, gt=0, le=2, description="time by which speech begins and ends, s")


class Sphinx:
    """PocketSphinx."""

    def __init__(self, config: SphinxConfig) -> None:
        """Load nothing yet.

        Raises:
            ConfigError: If the extra `speech` is not installed.
        """
        try:
            self._module: Any = importlib.import_module("pocketsphinx")  # an extra, without types
        except ImportError as error:
            raise ConfigError(f"PocketSphinx is missing: {remedy('speech')} installs it") from error
        self._config = config

    async def hear(self, audio: Audio, vocabulary: Vocabulary) -> AsyncIterator[Speech]:
        """Yield utterances; the decoder works in a thread."""
        decoder = await asyncio.to_thread(self._decoder, vocabulary)
        ends = self._module.Endpointer(window=self._config.window_s, sample_rate=RATE_HZ)
        size = int(ends.frame_bytes)
        kept, retained_ns, origin_ns = b"", 0, 0
        async for stamp_ns, block in audio.blocks():
            retained_ns = stamp_ns - _length_ns(len(kept))
            kept += block
            while len(kept) > size:
                if not origin_ns:
                    origin_ns = retained_ns
                frame, kept = kept[:size], kept[size:]
                if (
                    speech := await asyncio.to_thread(self._step, decoder, ends, frame, origin_ns)
                ) is not None:
                    yield speech
        last = await asyncio.to_thread(self._step, decoder, ends, kept, origin_ns, is_last=True)
        if last is not None:
            yield last

    def _decoder(self, vocabulary: Vocabulary) -> Any:
        decoder = self._module.Decoder(samprate=RATE_HZ, lm=None, loglevel="FATAL")
        known = {word for word in vocabulary.words if decoder.lookup_word(word)}
        decoder.add_jsgf_string(NAME, vocabulary.jsgf(known))
        decoder.activate_search(NAME)
        return decoder

    def _step(
        self, decoder: Any, ends: Any, frame: bytes, origin_ns: int, *, is_last: bool = False
    ) -> Speech | None:
        """Process one frame. Return the utterance that ends with it, or None."""
        was_speech = bool(ends.in_speech)
        samples = ends.end_stream(frame) if is_last else ends.process(frame)
        if samples is None:
            return None
        if not was_speech:
            decoder.start_utt()
            self._begin_ns = origin_ns + round(ends.speech_start * NS_PER_S)
        if samples:  # the decoder fails with none, as at the end of a stream
            decoder.process_raw(samples)
        if ends.in_speech and not is_last:
            return None
        decoder.end_utt()
        words = tuple(
            Word(
                text=VARIANT.sub("", segment.word)[:64],
                start_ns=self._begin_ns + segment.start_frame * NS_PER_S // FRAMES_PER_S,
                end_ns=self._begin_ns + (segment.end_frame + 1) * NS_PER_S // FRAMES_PER_S,
            )
            for segment in (decoder.seg() or () if decoder.hyp() is not None else ())
            if not NOISE.fullmatch(segment.word)
        )
        if not words:
            return None
        return Speech(stamp_ns=words[-1].end_ns, words=words[:64], recogniser=NAME)


def _length_ns(size: int) -> int:
    return size // 2 * NS_PER_S // RATE_HZ


POCKETSPHINX = RecogniserPlugin(
    summary="offline, English, a grammar of the room's names (extra `speech`)",
    config=SphinxConfig,
    make=Sphinx,
)
