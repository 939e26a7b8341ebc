"""Put that there: a simulated person points at the rover and at a place, a synthetic voice says so, it goes.

The times of the voice's words are moved to those of the person's gestures: simulated people do not speak.
"""

import asyncio
import contextlib
import shutil
import subprocess
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
import yaml

import pointit
from pointit.api.site import Site
from pointit.launch.plan.scenario import read_scenario
from pointit.schemas import NS_PER_S, Goal, Speech, Understood, topics
from pointit.speech.grammar import names_of
from pointit.speech.interpreter import Interpreter
from pointit.speech.recogniser import RATE_HZ
from pointit.speech.sphinx import Sphinx, SphinxConfig
from pointit.speech.typed_words import TimedWord, speech

USER = "user1"
VOICES = ("en-us", "en-gb")


class Recorded:
    """A voice without waiting for it."""

    def __init__(self, samples: bytes) -> None:
        self._samples = samples

    async def blocks(self) -> AsyncIterator[tuple[int, bytes]]:
        for index in range(0, len(self._samples), 1600):
            yield NS_PER_S + index // 2 * NS_PER_S // RATE_HZ, self._samples[index : index + 1600]


def voice(text: str, name: str, folder: Path) -> bytes:
    """Return samples of a synthetic voice; the test is skipped where its tools are missing."""
    espeak, sox = shutil.which("espeak-ng"), shutil.which("sox")
    if espeak is None or sox is None:
        pytest.skip("no espeak-ng or sox here: `apt-get install espeak-ng sox`")
    raw = folder / f"{name}.wav"
    subprocess.run([espeak, "-v", name, "-s", "130", "-w", raw, text], check=True)
    form = ["-t", "raw", "-r", str(RATE_HZ), "-b", "16", "-e", "signed", "-c", "1", "-"]
    command: list[str | Path] = [sox, "-q", raw, *form, "pad", "0.4", "0.5", "gain", "-3"]
    done = subprocess.run(command, check=True, capture_output=True)
    return done.stdout


async def recognised(samples: bytes, names: list[str]) -> Speech:
    """Return the last utterance in `samples`."""
    last: Speech | None = None
    async for said in Sphinx(SphinxConfig()).hear(Recorded(samples), names_of(names)):
        last = said
    assert last is not None, "nothing was recognised"
    return last


def scenario(folder: Path) -> Path:
    """Return scenario 6 with a listener."""
    found = read_scenario("scenario_6")
    path = folder / "rover.yaml"
    path.write_text(yaml.safe_dump({
        "about": found.about, "explained": found.explained, "duration_s": 120,
        "places": [{"position_m": [3.0, 0.0, 0.0], "yaw_deg": 20.0}],
        "site": dict(found.site), "user": {**found.user, "listener": {}},
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


@pytest.mark.parametrize("name", VOICES)
def test_a_synthetic_voice_puts_the_rover_where_the_person_points(name: str, tmp_path: Path) -> None:
    samples = voice("put that there", name, tmp_path)
    with contextlib.closing(asyncio.new_event_loop()) as loop:
        said = loop.run_until_complete(recognised(samples, ["rover", "quad"]))
    words = [word.text for word in said.words]
    assert words == ["put", "that", "there"]
    times = [word.start_ns for word in said.words]
    assert times == sorted(times)

    async def play() -> None:
        async with pointit.run(str(scenario(tmp_path)), virtual=True, seed=3) as site:
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
