"""Vosk as a recogniser of `pointit listen`: better than PocketSphinx, with a model of your language.

Its models are separate downloads: https://alphacephei.com/vosk/models. Unpack one, and set VOSK_MODEL to its
folder.
"""

import asyncio
import importlib
import json
import os
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from pydantic import Field

from pointit.runtime.config.config import Config
from pointit.runtime.errors import ConfigError
from pointit.schemas import NS_PER_S, Speech, Word
from pointit.speech.grammar import Vocabulary
from pointit.speech.recogniser import RATE_HZ, Audio, RecogniserPlugin


class VoskConfig(Config):
    """Folder of the model."""

    model: str = Field(default_factory=lambda: os.environ.get("VOSK_MODEL", ""), description="its folder")


class Vosk:
    """Recognises the words of the room's commands, and nothing else."""

    def __init__(self, config: VoskConfig) -> None:
        """Load the model.

        Raises:
            ConfigError: If there is none.
        """
        has_model = bool(config.model) and Path(config.model).is_dir()
        if not has_model:
            raise ConfigError(f"VOSK_MODEL: no folder {config.model!r}; unpack a model, and name its folder")
        self._vosk: Any = importlib.import_module("vosk")  # without types
        self._model = self._vosk.Model(config.model)

    async def hear(self, audio: Audio, vocabulary: Vocabulary) -> AsyncIterator[Speech]:
        """Yield utterances."""
        words = json.dumps([*sorted(vocabulary.words), "[unk]"])
        recogniser = self._vosk.KaldiRecognizer(self._model, RATE_HZ, words)
        recogniser.SetWords(True)
        start_ns = 0
        async for stamp_ns, block in audio.blocks():
            start_ns = start_ns or stamp_ns
            if await asyncio.to_thread(recogniser.AcceptWaveform, block):  # an utterance has ended
                for said in _speech(recogniser.Result(), start_ns):
                    yield said
        for said in _speech(recogniser.FinalResult(), start_ns):
            yield said


def _speech(result: str, start_ns: int) -> list[Speech]:
    """Return the utterance, if there is one; Vosk counts times from the start of the audio."""
    words: list[Word] = []
    for entry in json.loads(result).get("result", ()):
        if entry["word"] == "[unk]":
            continue
        word_start_ns = start_ns + round(entry["start"] * NS_PER_S)
        word_end_ns = start_ns + round(entry["end"] * NS_PER_S)
        word = Word(text=entry["word"], start_ns=word_start_ns, end_ns=word_end_ns, confidence=entry["conf"])
        words.append(word)
    if not words:
        return []
    return [Speech(stamp_ns=words[-1].end_ns, words=tuple(words), recogniser="vosk")]


VOSK = RecogniserPlugin(summary="offline, any language with a model", config=VoskConfig, make=Vosk)
