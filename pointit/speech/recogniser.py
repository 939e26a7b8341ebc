"""Recognisers of speech as plug-ins, from audio to words with their times: PocketSphinx, or lines of text."""

import asyncio
import importlib
import math
import re
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from pydantic import Field

from pointit.errors import ConfigError
from pointit.runtime.config.config import Config
from pointit.runtime.config.plugins import Plugin, PluginGroup
from pointit.runtime.host.extras import remedy
from pointit.schemas import NS_PER_S, Speech, Word
from pointit.schemas.person import MAX_WORDS
from pointit.speech.grammar import Vocabulary

RATE_HZ = 16_000
"""Rate of the samples, each of 16 bits, signed, little endian, one channel."""

WORD_S = 0.3
"""Length of a word, s."""
PAUSE_S = 1.5
"""Time between two words that ends an utterance, s."""
LATEST_S = 86_400.0
MAX_WORD_CHARACTERS = 64
"""Largest length of `Word.text`."""
TEXT = "text"
"""Name of this recogniser in messages."""

FRAMES_PER_S = 100
"""Frames of the decoder's times."""
NOISE = re.compile(r"[<\[(+].*|.*\(NULL\).*")
"""Silence and fillers among the decoder's words."""
VARIANT = re.compile(r"\(\d+\)\Z")
"""Number of a pronunciation behind a word."""
NAME = "pocketsphinx"


class Audio(Protocol):
    """Samples with their time."""

    def blocks(self) -> AsyncIterator[tuple[int, bytes]]:
        """Yield blocks of samples, each with the time of its first one, Unix ns of the site's time."""
        ...


class Recogniser(Protocol):
    """Recognises one person's words."""

    def hear(self, audio: Audio, vocabulary: Vocabulary) -> AsyncIterator[Speech]:
        """Yield utterances until the audio ends.

        Args:
            audio: samples of 16 kHz.
            vocabulary: words of the room.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class RecogniserPlugin(Plugin):
    """A way to recognise speech, chosen by `pointit listen --recogniser NAME`."""

    make: Callable[[Any], Recogniser]
    """Makes one with parameters of the class `config`."""


RECOGNISERS = PluginGroup("pointit.recognisers", RecogniserPlugin, "recogniser")


def make(name: str, settings: Mapping[str, Any]) -> Recogniser:
    """Return the recogniser `name` with `settings`.

    Raises:
        ConfigError: If it is not installed, or a setting is wrong.
    """
    plugin = RECOGNISERS.get(name)
    return plugin.make(plugin.config.model_validate(dict(settings)))


class TimedWord(NamedTuple):
    """A word and the time of its onset since the beginning, s, or None if it comes with its line."""

    text: str
    time_s: float | None


def words_in(line: str) -> list[TimedWord]:
    """Return the words of a line: one with its time before it, or some without, or none.

    A time that is not finite or negative, or later than a day, is no time but a word.
    """
    texts = line.partition("#")[0].split()
    if len(texts) == 2:
        time_s = _time(texts[0])
        if time_s is not None:
            return [TimedWord(texts[1], time_s)]
    return [TimedWord(text, None) for text in texts if text != "."]


def _time(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    is_plausible = math.isfinite(value) and 0.0 <= value <= LATEST_S
    return value if is_plausible else None


def speech(words: Sequence[TimedWord], start_ns: int, now_ns: int) -> Speech:
    """Return an utterance; `start_ns` is the beginning of times, and words without one end at `now_ns`."""
    spoken_words: list[Word] = []
    words = words[:MAX_WORDS]
    untimed = sum(word.time_s is None for word in words)
    for word in words:
        if word.time_s is None:
            begin_ns = now_ns - round(untimed * WORD_S * NS_PER_S)
            untimed -= 1
        else:
            begin_ns = start_ns + round(word.time_s * NS_PER_S)
        end_ns = begin_ns + round(WORD_S * NS_PER_S)
        text = word.text.lower()[:MAX_WORD_CHARACTERS]
        spoken_words.append(Word(text=text, start_ns=begin_ns, end_ns=end_ns))
    stamp_ns = spoken_words[-1].end_ns if spoken_words else now_ns
    return Speech(stamp_ns=stamp_ns, words=tuple(spoken_words), recogniser=TEXT)


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
        frame_bytes = int(ends.frame_bytes)
        rest = b""
        origin_ns = 0
        """Time of the first sample, ns, or 0 before it is there. The decoder's times begin there."""
        async for stamp_ns, block in audio.blocks():
            rest_ns = stamp_ns - _length_ns(len(rest))
            rest += block
            # One frame at least stays for the end, which the endpointer wants to be told.
            while len(rest) > frame_bytes:
                if not origin_ns:
                    origin_ns = rest_ns
                frame = rest[:frame_bytes]
                rest = rest[frame_bytes:]
                utterance = await asyncio.to_thread(self._step, decoder, ends, frame, origin_ns)
                if utterance is not None:
                    yield utterance
        last = await asyncio.to_thread(self._step, decoder, ends, rest, origin_ns, is_last=True)
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
        # The endpointer returns the samples of speech, also some before it was sure, else None.
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
        words = self._words(decoder)
        if not words:
            return None
        return Speech(stamp_ns=words[-1].end_ns, words=tuple(words[:MAX_WORDS]), recogniser=NAME)

    def _words(self, decoder: Any) -> list[Word]:
        """Return the words of the utterance that has ended, without noises."""
        if decoder.hyp() is None:
            return []
        words: list[Word] = []
        for segment in decoder.seg() or ():
            if NOISE.fullmatch(segment.word):
                continue
            text = VARIANT.sub("", segment.word)[:MAX_WORD_CHARACTERS]
            start_ns = self._begin_ns + segment.start_frame * NS_PER_S // FRAMES_PER_S
            end_ns = self._begin_ns + (segment.end_frame + 1) * NS_PER_S // FRAMES_PER_S
            words.append(Word(text=text, start_ns=start_ns, end_ns=end_ns))
        return words


def _length_ns(size: int) -> int:
    return size // 2 * NS_PER_S // RATE_HZ


POCKETSPHINX = RecogniserPlugin(
    summary="offline, English, a grammar of the room's names (extra `speech`)",
    config=SphinxConfig,
    make=Sphinx,
)
