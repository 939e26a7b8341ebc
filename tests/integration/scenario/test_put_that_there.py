"""Put that there: a simulated person points at the rover and at a place, a synthetic voice says so, it goes.

The times of the voice's words are moved to those of the person's gestures: simulated people do not speak.
"""

import asyncio
import contextlib
import json
import shutil
import subprocess
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

import pointit
from pointit.api.site import Site
from pointit.launch.plan.plan import read_scenario
from pointit.schemas import NS_PER_S, Goal, Speech, Understood, topics
from pointit.speech.grammar import Vocabulary, names_of
from pointit.speech.interpreter import Interpreter
from pointit.speech.recogniser import RATE_HZ, Sphinx, SphinxConfig, TimedWord, speech
from tests.support.bench import background

USER = "user1"
VOICES = ("en-us", "en-gb", "en-gb-x-rp")
SENTENCES = ("put that there", "take that", "turn that on", "turn the rover off", "send that there", "stop")
NOISE = 0.02
"""Amplitude of pink noise; that of the voice is 0.5."""


class Recorded:
    """A voice without waiting for it."""

    def __init__(self, samples: bytes) -> None:
        self._samples = samples

    async def blocks(self) -> AsyncIterator[tuple[int, bytes]]:
        for index in range(0, len(self._samples), 1600):
            yield NS_PER_S + index // 2 * NS_PER_S // RATE_HZ, self._samples[index : index + 1600]


def voice(text: str, name: str, folder: Path, noise: float = 0.0) -> bytes:
    """Return samples of a voice in pink noise, always the same (-R); skips where tools are missing."""
    espeak = shutil.which("espeak-ng")
    sox = shutil.which("sox")
    if espeak is None or sox is None:
        pytest.skip("no espeak-ng or sox here: `apt-get install espeak-ng sox`")
    raw, clean, hiss = (folder / f"{kind}.wav" for kind in ("raw", "clean", "hiss"))
    form = ["-r", str(RATE_HZ), "-b", "16", "-e", "signed", "-c", "1"]

    def run(*command: str | Path) -> bytes:
        return subprocess.run(command, check=True, capture_output=True).stdout

    run(espeak, "-v", name, "-s", "130", "-w", raw, text)
    run(sox, "-q", "-R", raw, *form, clean, "pad", "0.5", "0.6", "gain", "-n", "-6")
    run(sox, "-q", "-R", clean, hiss, "synth", "pinknoise", "vol", str(noise))
    return run(sox, "-q", "-R", "-m", "-v", "1", clean, "-v", "1", hiss, "-t", "raw", *form, "-")


async def recognised(samples: bytes, names: list[str]) -> Speech:
    """Return the last utterance in `samples`."""
    last: Speech | None = None
    async for said in Sphinx(SphinxConfig()).hear(Recorded(samples), Vocabulary(names=names_of(names))):
        last = said
    assert last is not None, "nothing was recognised"
    return last


def scenario(folder: Path, name: str, places: list[dict[str, object]], **site: object) -> Path:
    """Return a scenario with a listener."""
    found = read_scenario(name)
    path = folder / "spoken.yaml"
    path.write_text(json.dumps({
        "about": found.about, "explained": found.explained, "duration_s": 120, "places": places,
        "site": {**found.site, **site}, "user": {**found.user, "listener": {}},
    }), encoding="utf-8")  # fmt: skip
    return path


async def put_there(site: Site, words: list[str]) -> tuple[Understood, Goal | None]:
    """Say `words` about the rover and the first place to which the person points. Return what came of it."""
    understood = asyncio.get_running_loop().create_future()
    interpreter = Interpreter(site._bus, site._clock, USER)

    def on_understood(news: Understood) -> None:
        if not understood.done():
            understood.set_result(news)

    interpreter.on_understood = on_understood
    following = asyncio.create_task(interpreter.run())
    goals = site.messages(topics.GOAL, USER)
    start_ns = site.now_ns()
    times_s: list[float] = []
    async for steering in site.messages(topics.STEERING, USER):
        if steering.robot == "rover" and not times_s:
            times_s.append((site.now_ns() - start_ns) / NS_PER_S - 1.0)  # they pressed after they had arrived
        if times_s and steering.waypoints_m:
            times_s.append((site.now_ns() - start_ns) / NS_PER_S - 0.8)  # they have stayed for a second
            break
    timed = [TimedWord(words[0], max(times_s[0] - 0.4, 0.0))]
    timed += [TimedWord(word, time_s) for word, time_s in zip(words[-2:], times_s, strict=True)]
    site._bus.publisher(topics.SPEECH, USER).put(speech(timed, start_ns, site.now_ns()))
    news: Understood = await understood
    following.cancel()
    await asyncio.wait({following})
    sent = [goal async for goal in goals.during(0.5)]
    return news, sent[0] if sent else None


@pytest.mark.slow
@pytest.mark.parametrize(("name", "noise"), [(VOICES[0], 0.0), *((each, NOISE) for each in VOICES)])
async def test_most_sentences_of_three_voices_are_recognised_in_noise_too(
    name: str, noise: float, tmp_path: Path
) -> None:
    heard = [
        " ".join(
            word.text for word in (await recognised(voice(each, name, tmp_path, noise), ["rover"])).words
        )
        for each in SENTENCES
    ]
    right = [said for said, meant in zip(heard, SENTENCES, strict=True) if said == meant]
    assert {"put that there", "stop"} <= set(right), heard
    assert len(right) >= 4, heard


async def test_a_stream_that_ends_while_somebody_speaks_is_no_error(tmp_path: Path) -> None:
    samples = voice("put that there", VOICES[0], tmp_path)
    said = await recognised(samples[: len(samples) // 2 // 960 * 960], [])
    assert said.words[0].text == "put"


def test_a_synthetic_voice_puts_the_rover_where_the_person_points(tmp_path: Path) -> None:
    samples = voice("put that there", VOICES[0], tmp_path)
    with contextlib.closing(asyncio.new_event_loop()) as loop:
        said = loop.run_until_complete(recognised(samples, ["rover", "quad"]))
    words = [word.text for word in said.words]
    assert words == ["put", "that", "there"]
    times = [word.start_ns for word in said.words]
    assert times == sorted(times)

    places: list[dict[str, object]] = [{"position_m": [3.0, 0.0, 0.0], "yaw_deg": 20.0}]
    rover = scenario(tmp_path, "scenario_6", places)

    async def play() -> None:
        async with pointit.run(str(rover), virtual=True, seed=3) as site:
            news, goal = await put_there(site, words)
            assert (news.result, news.command) == ("done", "put"), news
            that, there = news.referents
            assert (that.kind, that.name, there.kind) == ("robot", "rover", "place")
            assert goal is not None
            assert goal.robot == "rover"
            assert goal.position_m == there.place_m
            async for state in site.messages(topics.ROBOT_STATE, "rover"):
                if state.goal_ns == goal.stamp_ns and state.phase == "moving":
                    break

    pointit.run_virtually(play())


@pytest.mark.slow
def test_package_selected_by_speech_goes_to_the_bay_for_selections(tmp_path: Path) -> None:
    places: list[dict[str, object]] = [{"position_m": [-1.3, -1.9, 0.0], "yaw_deg": 20.0}]
    slowly = {"method": "fraction", "window_s": 4.0}  # words are faster than staying
    sorter = scenario(tmp_path, "scenario_4", places, selector=slowly)

    async def play() -> None:
        async with pointit.run(str(sorter), virtual=True, seed=3) as site:
            understood: list[Understood] = []
            interpreter = Interpreter(site._bus, site._clock, USER)
            interpreter.on_understood = understood.append
            async with background(interpreter.run()):
                async for hover in site.messages(topics.HOVER, USER):
                    if understood and understood[-1].result == "done":
                        break
                    if hover.progress > 0.2 and interpreter._idle.is_set():
                        words = [TimedWord(each, None) for each in ("take", "that")]
                        site._bus.publisher(topics.SPEECH, USER).put(speech(words, 0, site.now_ns()))
            (taken,) = understood[-1].referents

            assert understood[-1].message.endswith(f"{taken.name} is {USER}'s")
            async for selection in site.messages(topics.SELECTION):
                if taken.name in {one.id for one in selection.objects if one.user == USER}:
                    break
            async for listed in site.messages(topics.OBJECTS, "conveyor"):
                if {"1"} == {one.bay for one in listed.objects if one.id == taken.name}:
                    break

    pointit.run_virtually(play())
