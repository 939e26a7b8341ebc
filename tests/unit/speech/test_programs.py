"""Programs that speak, and those of verbs."""

import asyncio
import os
from contextlib import nullcontext
from pathlib import Path

import pytest

from pointit.bridges.speaker.speech_synthesizer import PROGRAM, SpeechSynthesizer
from pointit.cli.things.listen import own_verbs
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.schemas import NS_PER_S, Speech, Understood, Word
from pointit.speech.grammar import Command, SpokenRoom
from pointit.speech.verbs import Packages, VerbContext
from tests.support.bench import ManualClock, memory_bench


def understood(message: str, result: str = "done") -> Understood:
    return Understood.model_validate(
        {"stamp_ns": 1, "text": "take that", "result": result, "message": message}
    )


def heard(clock: ManualClock, from_s: float, to_s: float) -> Speech:
    start_ns, end_ns = (clock.now_ns() + round(each * NS_PER_S) for each in (from_s, to_s))
    return Speech(stamp_ns=end_ns, words=(Word(text="yes", start_ns=start_ns, end_ns=end_ns),))


@pytest.mark.wall_time
async def test_synthesizer_speaks_messages_and_counts_words_meanwhile_as_echo(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / PROGRAM
    said = tmp_path / "said"
    program.write_text(f"#!/bin/sh\necho $1 $(cat) >>{said}\n", encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    clock = ManualClock()
    speaker = SpeechSynthesizer(clock)

    assert not speaker.is_echo(heard(clock, -1.0, 0.0)), "nothing was said yet"
    for each in (
        understood("--help"),
        understood(""),
        understood("Radio or nuts? Say yes, or press", "asked"),
    ):
        speaker.say(each)
        if each.message:
            clock.advance(1.0)
            assert speaker.is_echo(heard(clock, -0.9, -0.5))
        await speaker.close()
    assert said.read_text(encoding="utf-8").split("\n")[:2] == ["--stdin --help", "--stdin Radio or nuts?"]
    assert speaker.is_echo(heard(clock, 0.1, 0.5)), "it may still sound"
    assert not speaker.is_echo(heard(clock, 0.5, 1.0))

    monkeypatch.setenv("PATH", str(tmp_path / "nothing"))
    with pytest.raises(ConfigError, match=f"--speak needs `{PROGRAM}`: install it"):
        SpeechSynthesizer(clock)


@pytest.mark.wall_time
async def test_echo_continues_when_a_newer_sentence_interrupts_the_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / PROGRAM
    begun = tmp_path / "begun"
    os.mkfifo(begun)
    program.write_text(f"#!/bin/sh\necho >{begun}\nsleep 600\n", encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    clock = ManualClock()
    speaker = SpeechSynthesizer(clock)
    speaker.say(understood("one"))
    first = speaker._newest_task
    assert first is not None
    await asyncio.to_thread(begun.read_text)
    clock.advance(1.0)
    speaker.say(understood("two"))

    ended, _ = await asyncio.wait({first}, timeout=30.0)
    assert ended, "its program has started another, which must not hold it up"
    clock.advance(2.0)
    assert speaker.is_echo(heard(clock, -0.5, -0.1)), "the newer one is said"
    assert speaker.is_echo(heard(clock, -2.5, -2.4)), "words of the one before come late"
    assert speaker._newest_task is not None

    speaker._newest_task.cancel()
    async with asyncio.timeout(30.0):
        await speaker.close()


@pytest.mark.parametrize(
    ("program", "fails"), [("echo", ""), ("false", "heat kettle: false anna ended with")]
)
@pytest.mark.wall_time
async def test_verb_starts_its_program_and_reports_output_and_failure(
    program: str, fails: str, capfd: pytest.CaptureFixture[str]
) -> None:
    async with memory_bench() as bench:
        known = SpokenRoom()
        site = VerbContext(
            bench.bus, bench.clock, "anna", known, Packages(bench.bus, bench.clock, "anna", known)
        )
        verb = own_verbs([f"heat kettle={program} {{user}}"])[0]["heat"]
        with pytest.raises(RefusedError, match=fails) if fails else nullcontext():
            assert await verb.act(site, Command(verb="heat"), [known.named("kettle")]) == "heat kettle"
        assert capfd.readouterr().out == ("" if fails else "anna\n")
