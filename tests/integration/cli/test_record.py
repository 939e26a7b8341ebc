"""`pointit record` on a real site: two people in real time, whatever ends the recording."""

import os
import signal
from pathlib import Path

import pytest

from pointit.launch.plan.launches import Choices, site_launches, user_launches
from pointit.launch.plan.plan import read_scenario
from pointit.recording.entries import Entry
from pointit.recording.reader import Recording
from pointit.schemas import NS_PER_S, Health, ImuSample
from pointit.schemas.topics import CURSOR, HEALTH, IMU, RAY, SET_METHOD, STRIPS_FRAME, Topic
from tests.support import there
from tests.support.bench import until
from tests.support.cli_site import Site, interrupt, next_line
from tests.support.commands import PATIENCE_S
from tests.support.pace import within

PEOPLE = ("anna", "ben")


def entries(path: Path) -> tuple[list[Entry], str]:
    with Recording.open(path) as recording:
        found = list(recording.entries())
        assert (recording.invalid, recording.unknown) == (0, {})
        return found, recording.problem


def numbers(found: list[Entry], topic: Topic[ImuSample], user: str) -> list[int]:
    return [
        each.body.seq
        for each in found
        if each.row is topic and each.name == user and isinstance(each.body, ImuSample)
    ]


@pytest.mark.slow
async def test_recording_that_is_killed_has_all_but_the_last_second(site: Site, tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    scenario = read_scenario("scenario_4")
    choices = Choices(seed=1)
    launches = site_launches(scenario, choices)
    for index, user in enumerate(PEOPLE):
        launches += user_launches(scenario, choices, user, index)
    site.launch(*launches)
    seen: dict[str, list[int]] = {user: [] for user in PEOPLE}
    site.bus.subscribe(IMU, lambda sample, user: seen[user].append(sample.stamp_ns), queue_all=True)
    async with site.command("record", str(path)) as process:
        assert "recording to" in await next_line(process.stderr)
        await site.arrived("recorder")
        await site.bus.call(SET_METHOD, SET_METHOD.query(method="fraction"))
        began = {user: len(seen[user]) for user in PEOPLE}
        await until(lambda: all(len(seen[user]) > began[user] + 150 for user in PEOPLE), PATIENCE_S)

        os.kill(process.pid, signal.SIGKILL)
        last_ns = {user: seen[user][-1] for user in PEOPLE}
        await process.wait()

    found, problem = entries(path)
    assert "it ends in the middle" in problem
    for user in PEOPLE:
        sampled = numbers(found, IMU, user)
        assert sampled == list(range(sampled[0], sampled[-1] + 1))
        newest = [each.body for each in found if each.key == IMU.at(user)][-1]
        assert isinstance(newest, ImuSample)
        late_s = (last_ns[user] - newest.stamp_ns) / NS_PER_S
        assert within(late_s, 5.0), "a busy machine takes more than a second"
        assert {RAY.at(user), CURSOR.at(user)} <= {each.key for each in found}
    assert {STRIPS_FRAME.key, "selector/method", "map", "configuration/selector"} <= {
        each.key for each in found
    }


async def test_interrupted_recording_is_whole_and_says_where_it_is(site: Site, tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    site.feed_imu("anna")
    recorded: list[float] = []

    def on_health(health: Health, _instance: str) -> None:
        recorded.extend(figure.value for figure in health.figures if figure.name == "recorded")

    site.bus.subscribe(HEALTH, on_health, "recorder")
    async with site.command("record", str(path), "--without", "health") as process:
        assert "recording to" in await next_line(process.stderr)
        await until(lambda: bool(recorded) and recorded[-1] > 50, PATIENCE_S)
        code, _ = await interrupt(process)
        told = (await there(process.stderr).read()).decode()
    assert code == 0
    assert f"in {path}" in told
    found, problem = entries(path)
    assert problem == ""
    assert numbers(found, IMU, "anna")
    assert not [each for each in found if each.key.startswith("health/")]


async def test_site_on_which_nothing_runs_is_said_and_fails(site: Site, tmp_path: Path) -> None:
    ended = await site.pointit(
        "record", str(tmp_path / "session.mcap"), "--site", "nosuch", "--duration", "0.5", code=1
    )
    assert "nothing of site nosuch is in the recording: name the right site" in ended.err
