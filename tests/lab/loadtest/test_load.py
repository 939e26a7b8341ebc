"""`pointit load` as it is typed: every layout, a running site, Ctrl-C."""

import json
import signal
from typing import Any

import pytest

from tests.support.bench import until
from tests.support.commands import Commands, Ended, onlooker
from tests.support.pace import within

SHORT = ("--users", "2", "--rate", "50", "--duration", "2")


def row_of(ended: Ended) -> dict[str, Any]:
    (row,) = json.loads(ended.out)["measured"]
    assert ended.code == (0 if row["carried"] else 1), ended.err
    return dict(row)


@pytest.mark.parametrize(
    ("options", "processes"),
    [
        ((), ["all"]),
        pytest.param(
            ("--layout", "users", "--shards", "1", "--router"),
            ["site", "users 1", "router"],
            marks=pytest.mark.long,  # as with --secured, but for certificates
        ),
        (("--layout", "users", "--shards", "2", "--secured"), ["site", "users 1", "users 2", "router"]),
        (
            ("--layout", "services"),
            ["wrists", "pui", "selector", "led-driver", "conveyor-sim", "keeper", "pointing", "localizer"],
        ),
    ],
)
async def test_every_layout(commands: Commands, options: tuple[str, ...], processes: list[str]) -> None:
    ended = await commands.pointit("load", *SHORT, "--json", *options)
    row = row_of(ended)
    assert [process["name"] for process in row["processes"]] == processes
    assert all(process["memory_mb"] > 10 for process in row["processes"])
    assert sum(process["cpu"] for process in row["processes"]) > 0
    assert 20 < row["sent"] <= 200, "a busy machine leaves some out"
    assert row["cursors"] > 20
    assert row["frames"] > 2
    assert 0 < row["light_p50_ms"] <= row["light_p99_ms"]
    assert "2 people at 50 Hz" in ended.err, "progress"


async def test_people_join_a_running_site(commands: Commands, endpoint: str) -> None:
    commands.start("run", "scenario_2", "--site-only", "--no-view", "--listen", endpoint)
    async with onlooker(endpoint) as seen:
        await seen.hears("led-driver")
        row = row_of(await commands.pointit("load", *SHORT, "--json", "--connect", endpoint))
        assert [process["name"] for process in row["processes"]] == ["all"]
        assert row["cursors"] > 20
        assert seen.people == set() or seen.people <= {"load0", "load1"}


async def test_who_joins_a_running_site_does_not_secure_it(commands: Commands, endpoint: str) -> None:
    ended = await commands.pointit("load", *SHORT, "--secured", "--connect", endpoint)
    assert ended.code == 2
    assert ended.sentence.startswith("--secured makes a site of its own; leave it out with --connect")


async def test_nobody_there_is_said_in_a_sentence(commands: Commands, endpoint: str) -> None:
    ended = await commands.pointit("load", *SHORT, "--connect", endpoint)
    assert ended.code == 1
    assert "nobody answers" in ended.sentence


@pytest.mark.parametrize("layout", [pytest.param("one", marks=pytest.mark.long), "users"])
async def test_ctrl_c_ends_it_at_once_with_all_its_processes(commands: Commands, layout: str) -> None:
    load = commands.start("load", "--duration", "600", "--layout", layout)
    await load.says("measuring")
    family = load.family()
    ended = await load.stop(signal.SIGINT)
    assert within(ended.took_s, 5.0)
    assert ended.code == 130
    await until(lambda: not any(process.is_running() for process in family), 5, "all to be gone")
