"""Recognisers of speech as plug-ins, audio in, words with their times out; and words from lines of text."""

import math
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from pointit.runtime.config.plugins import Plugin, PluginGroup
from pointit.schemas import NS_PER_S, Speech, Word
from pointit.schemas.person import MAX_WORDS
from pointit.speech.grammar import Vocabulary

RATE_HZ = 16_000
"""Rate of the samples, each of 16 bits, signed, little endian, one channel."""


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


WORD_S = 0.3
"""Length of a word, s."""
PAUSE_S = 1.5
"""Time between two words that ends an utterance, s."""
LATEST_S = 86_400.0
TEXT = "text"
"""Name of this recogniser in messages."""


class TimedWord(NamedTuple):
    """A word and the time of its onset since the beginning, s, or None if it comes with its line."""

    text: str
    time_s: float | None


def words_in(line: str) -> list[TimedWord]:
    """Return the words of a line: one with its time before it, or some without, or none.

    A time that is not finite or negative, or later than a day, is no time but a word.
    """
    texts = line.partition("#")[0].split()
    if len(texts) == 2 and (time_s := _time(texts[0])) is not None:
        return [TimedWord(texts[1], time_s)]
    return [TimedWord(text, None) for text in texts if text != "."]


def _time(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) and 0.0 <= value <= LATEST_S else None


def speech(words: Sequence[TimedWord], start_ns: int, now_ns: int) -> Speech:
    """Return an utterance; `start_ns` is the beginning of times, and words without one end at `now_ns`."""
    found: list[Word] = []
    words = words[:MAX_WORDS]
    untimed = sum(word.time_s is None for word in words)
    for word in words:
        if word.time_s is None:
            begin_ns = now_ns - round(untimed * WORD_S * NS_PER_S)
            untimed -= 1
        else:
            begin_ns = start_ns + round(word.time_s * NS_PER_S)
        text = word.text.lower()[:64]
        found.append(Word(text=text, start_ns=begin_ns, end_ns=begin_ns + round(WORD_S * NS_PER_S)))
    return Speech(stamp_ns=found[-1].end_ns if found else now_ns, words=tuple(found), recogniser=TEXT)
