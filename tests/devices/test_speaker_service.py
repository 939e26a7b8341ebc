"""Service `speaker`: names are counted once they could be heard, and health says why they are not."""

from pathlib import Path

import pytest

from pointit.bridges.speaker.service import Speaker, SpeakerConfig
from pointit.bridges.speaker.speech_synthesizer import PROGRAM
from pointit.runtime.errors import ConfigError
from pointit.schemas import Announced, Health
from pointit.schemas.problems import NAMES_SPOKEN, VOICE
from pointit.schemas.topics import ANNOUNCED, HEALTH
from tests.support.bench import memory_bench, until

NO_CARD = """\
ALSA lib confmisc.c:855:(parse_card) cannot find card '0'
ALSA lib pcm.c:2666:(snd_pcm_open_noupdate) Unknown PCM default
error: No such file or directory
"""
"""Output of espeak-ng 1.51 on a machine without a sound card; it ends with 0."""
NO_VOICE = "Error: The specified espeak-ng voice does not exist.\nerror: Invalid argument\n"

pytestmark = pytest.mark.wall_time


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the file of what a program in place of espeak-ng says."""
    file = tmp_path / PROGRAM
    says = tmp_path / "says"
    source = f"#!/bin/sh\ncat >/dev/null\necho $* >>{tmp_path}/asked\ncat {says} >&2\n"
    file.write_text(source, encoding="utf-8")
    file.chmod(0o755)
    says.write_text("", encoding="utf-8")
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    return says


def says(program: Path, text: str) -> None:
    program.write_text(text, encoding="utf-8")


def asked(program: Path) -> list[str]:
    file = program.parent / "asked"
    return file.read_text(encoding="utf-8").splitlines() if file.exists() else []


def spoken(health: list[Health]) -> list[float]:
    return [each.value for each in health[-1].figures if each.name == NAMES_SPOKEN] if health else []


def problem(health: list[Health]) -> str:
    return next((each.sentence for each in health[-1].problems if each.code == VOICE), "") if health else ""


async def test_missing_sound_card_is_reported_before_any_name_is_spoken(program: Path) -> None:
    says(program, NO_CARD)
    async with memory_bench() as bench:
        health = bench.collect(HEALTH)
        bench.start(Speaker)
        await until(lambda: "says 'No such file or directory'; does this machine" in problem(health))
        bench.put(ANNOUNCED, Announced(stamp_ns=1, object_id="a", label="lamp"), "anna")
        await until(lambda: len(asked(program)) == 2)
        await until(lambda: spoken(health) == [0.0])
        says(program, "")
        for count, label in enumerate(("kettle", "radio"), 3):
            bench.put(ANNOUNCED, Announced(stamp_ns=1, object_id=label, label=label), "anna")
            await until(lambda count=count: len(asked(program)) == count)  # type: ignore[misc]
            await until(lambda count=count: spoken(health) == [count - 2.0])  # type: ignore[misc]
        assert not problem(health)


async def test_a_language_without_a_voice_is_told(program: Path) -> None:
    says(program, NO_VOICE)
    async with memory_bench() as bench:
        health = bench.collect(HEALTH)
        bench.start(Speaker, SpeakerConfig(language="xx"))
        await until(lambda: "voice does not exist'; choose another language" in problem(health))
    assert asked(program) == ["-v xx --stdin"]


@pytest.mark.usefixtures("program")
def test_without_the_program_it_does_not_start(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    Speaker.validate_config(SpeakerConfig())
    monkeypatch.setenv("PATH", str(tmp_path / "nothing"))
    with pytest.raises(ConfigError, match=f"service speaker needs `{PROGRAM}`: install it"):
        Speaker.validate_config(SpeakerConfig())
