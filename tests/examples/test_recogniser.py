"""The recogniser of the examples, installed as a package of its own, with a scripted Vosk."""

import json
import sys
from collections.abc import AsyncIterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from pointit.runtime.errors import ConfigError
from pointit.schemas import NS_PER_S
from pointit.speech.grammar import Vocabulary, names_of
from pointit.speech.recogniser import make
from tests.architecture.sources import ROOT
from tests.support import strangers

SOURCE = ROOT / "examples" / "vosk_recogniser" / "vosk_recogniser.py"
START_NS = 1_000 * NS_PER_S
SILENT = b"silent"
SPOKEN = b"spoken"


class Decoder:
    """As much of Vosk as is used: an utterance ends with each block that is not silent."""

    def __init__(self, _model: str, rate_hz: int, words: str) -> None:
        assert rate_hz == 16_000
        assert {"that", "rover", "heat", "[unk]"} <= set(json.loads(words))

    def SetWords(self, on: bool) -> None:  # noqa: N802 - Vosk's
        assert on

    def AcceptWaveform(self, block: bytes) -> bool:  # noqa: N802 - Vosk's
        return block == SPOKEN

    def Result(self) -> str:  # noqa: N802 - Vosk's
        words = [
            {"word": word, "conf": 0.9, "start": start_s, "end": start_s + 0.25}
            for word, start_s in (("take", 2.0), ("[unk]", 2.25), ("that", 2.5))
        ]
        return json.dumps({"result": words, "text": "take [unk] that"})

    def FinalResult(self) -> str:  # noqa: N802 - Vosk's
        return json.dumps({"text": ""})


class Blocks:
    async def blocks(self) -> AsyncIterator[tuple[int, bytes]]:
        for index, block in enumerate((SILENT, SPOKEN, SILENT)):
            yield START_NS + index, block


async def test_the_recogniser_is_found_and_gives_words_with_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    vosk: Any = SimpleNamespace(Model=str, KaldiRecognizer=Decoder)
    monkeypatch.setitem(sys.modules, "vosk", vosk)
    entry = "vosk = vosk_recogniser:VOSK"
    with strangers.installed(
        tmp_path, "vosk_recogniser", SOURCE.read_text(encoding="utf-8"), recognisers=entry
    ):
        with pytest.raises(ConfigError, match=r"VOSK_MODEL: no folder ''"):
            make("vosk", {})
        monkeypatch.setenv("VOSK_MODEL", str(tmp_path))
        vocabulary = Vocabulary(names=names_of(["rover"]), verbs=("heat",))
        (said,) = [each async for each in make("vosk", {}).hear(Blocks(), vocabulary)]

    assert [(word.text, word.start_ns - START_NS) for word in said.words] == [
        ("take", 2 * NS_PER_S),
        ("that", 5 * NS_PER_S // 2),
    ]
    assert (said.recogniser, said.stamp_ns) == ("vosk", said.words[-1].end_ns)
