"""`pointit load` as it is typed: every layout, a running site, Ctrl-C."""

import json
import signal
from typing import Any

import pytest

from pointit_lab.loadtest.layout import LoadParameters, groups
from pointit_lab.loadtest.load_result import CapacitySearch, LinkUsage, LoadResult, Usage
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


async def test_secured_option_is_refused_when_the_load_joins_a_site(
    commands: Commands, endpoint: str
) -> None:
    ended = await commands.pointit("load", *SHORT, "--secured", "--connect", endpoint, code=2)
    assert ended.sentence.startswith("--secured makes a site of its own; leave it out with --connect")


async def test_nobody_there_is_said_in_a_sentence(commands: Commands, endpoint: str) -> None:
    ended = await commands.pointit("load", *SHORT, "--connect", endpoint, code=1)
    assert "nobody answers" in ended.sentence


async def test_ctrl_c_ends_it_at_once_with_all_its_processes(commands: Commands) -> None:
    load = commands.start("load", "--duration", "600", "--layout", "users")
    await load.says("measuring")
    family = load.family()
    ended = await load.stop(signal.SIGINT)
    assert within(ended.took_s, 5.0)
    assert ended.code == 130
    await until(lambda: not any(process.is_running() for process in family), 5, "all to be gone")


def measured(**fields: Any) -> LoadResult:
    values: dict[str, Any] = {
        "users": 10,
        "rate_hz": 100.0,
        "duration_s": 10.0,
        "layout": "one process",
        "sent": 10_000,
        "pointed": 10_000,
        "hovered": 10_000,
        "light_s": [0.002] * 99 + [0.02],
        "cursor_s": [0.001] * 100,
        "processes": [
            Usage(name="site", cpu=0.5, memory_mb=80.0),
            Usage(name="users 1", cpu=0.7, memory_mb=60.0),
        ],
        "load_average": 1.5,
        **fields,
    }
    return LoadResult(**values)


def test_load_within_limits_has_no_failure_and_reports_its_figures() -> None:
    assert not measured().failure
    row = measured().row()
    assert (row["users"], row["light_p50_ms"], row["light_p99_ms"]) == (10, 2.0, 2.0)
    assert (row["cpu_percent"], row["memory_mb"], row["busiest"]) == (120, 140, "users 1 70 %")
    assert row["carried"] == "yes"
    record = measured().record()
    assert (record["light_max_ms"], record["lacking"]) == (20.0, "")
    assert measured(lacking="no root").record()["lacking"] == "no root"
    assert record["processes"][1] == {"name": "users 1", "cpu": 0.7, "memory_mb": 60.0}
    assert measured().process_rows() == [
        {"process": "site", "us_per_sample": 500, "memory_mb": 80},
        {"process": "users 1", "us_per_sample": 700, "memory_mb": 60},
    ]


def test_bytes_of_a_link_are_counted_for_each_sample() -> None:
    link = LinkUsage(
        name="host 2 > host 1",
        up_bytes_hz=150_000.0,
        up_packets_hz=900.0,
        down_bytes_hz=50_000.0,
        down_packets_hz=300.0,
        up_hz={},
        down_hz={},
        counted_s=1.0,
    )
    assert [row["bytes_per_sample"] for row in measured(links=[link]).link_rows()] == [200]


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ({"pointed": 9_989}, "0.1% of the samples were dropped"),
        ({"light_s": [0.002] * 98 + [0.051] * 2}, "p99 is 51 ms, above 50 ms"),
        ({"light_s": []}, "no light"),
        ({"arrived": 9_980}, "0.2% of the cursors did not reach the lights"),
        ({"sent": 9_800, "pointed": 9_800}, "only 98% of the samples could be sent"),
        ({"sent": 0, "pointed": 0}, "only 0%"),
    ],
)
def test_load_beyond_a_limit_is_reported_with_the_reason(fields: dict[str, Any], why: str) -> None:
    assert why in measured(**fields).failure
    assert measured(**fields).row()["carried"] == measured(**fields).failure


@pytest.mark.parametrize("limit", [0, 4, 37, 333])
def test_the_search_ends_near_the_limit_and_never_above_it(limit: int) -> None:
    search = CapacitySearch(5, 1000)
    tried: list[int] = []
    for count in search.counts():
        tried.append(count)
        search.report(count, carried=count <= limit)
    assert search.carried <= limit
    assert len(tried) == len(set(tried)) <= 12
    assert limit - search.carried <= max(1, limit // 8)


def load(layout: Any, *connect: str) -> LoadParameters:
    return LoadParameters(
        rate_hz=100.0, duration_s=1.0, layout=layout, shards=2, router=None, secured=False, site="lab",
        connect=connect,
    )  # fmt: skip


@pytest.mark.parametrize("connect", [(), ("tcp/127.0.0.1:1",)])
@pytest.mark.parametrize("layout", ["one", "users", "services"])
def test_every_layout_runs_all_once_and_drives_everybody_once(layout: str, connect: tuple[str, ...]) -> None:
    here, elsewhere = groups(load(layout, *connect), 5)
    instances = sorted(launch.instance for group in (here, *elsewhere) for launch in group.launches)
    site: set[str] = set() if connect else {"pui", "selector", "led-driver", "conveyor-sim", "keeper"}
    people = {f"{name}.load{index}" for name in ("pointing", "localizer") for index in range(5)}
    assert instances == sorted(site | people)
    assert sorted(user for group in (here, *elsewhere) for user in group.wrists) == [
        f"load{index}" for index in range(5)
    ]
    assert len(elsewhere) == {"one": 0, "users": 2, "services": 2 if connect else 7}[layout]
