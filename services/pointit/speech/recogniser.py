"""Recognisers of speech as plug-ins: audio in, words with their times out."""

from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from pointit.runtime.config.plugins import Plugin, PluginGroup
from pointit.schemas import Speech
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
