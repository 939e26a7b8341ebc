"""Results of a load test: figures, verdict, and search for the largest number of people."""

from typing import Any

import pytest

from pointit_lab.loadtest.figures import CapacitySearch, LoadResult, Usage, quantile_ms
from pointit_lab.loadtest.layout import Load, groups
from pointit_lab.loadtest.usage import read_usage


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


def test_what_is_carried_fails_for_nothing() -> None:
    assert not measured().failure
    row = measured().row()
    assert (row["users"], row["light_p50_ms"], row["light_p99_ms"]) == (10, 2.0, 2.0)
    assert (row["cpu_percent"], row["memory_mb"], row["busiest"]) == (120, 140, "users 1 70 %")
    assert row["carried"] == "yes"
    record = measured().record()
    assert record["light_max_ms"] == 20.0
    assert record["lacking"] == ""
    assert measured(lacking="no root").record()["lacking"] == "no root"
    assert record["processes"][1] == {"name": "users 1", "cpu": 0.7, "memory_mb": 60.0}


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
def test_what_is_too_much_says_why(fields: dict[str, Any], why: str) -> None:
    assert why in measured(**fields).failure
    assert measured(**fields).row()["carried"] == measured(**fields).failure


def test_quantiles_are_values_and_of_nothing_there_is_none() -> None:
    values = [0.001 * n for n in range(1, 101)]
    assert quantile_ms(values, 0.5) == pytest.approx(50.0)
    assert quantile_ms(values, 0.99) == pytest.approx(99.0)
    assert quantile_ms(values, 1.0) == pytest.approx(100.0)
    assert quantile_ms([], 0.5) is None


@pytest.mark.parametrize("limit", [0, 1, 4, 5, 37, 79, 80, 333])
def test_the_search_ends_near_the_limit_and_never_above_it(limit: int) -> None:
    search = CapacitySearch(5, 1000)
    tried: list[int] = []
    for count in search.counts():
        tried.append(count)
        search.report(count, carried=count <= limit)
    assert search.carried <= limit
    assert len(tried) == len(set(tried)) <= 12
    assert limit - search.carried <= max(1, limit // 8)


def test_the_search_stops_at_the_most() -> None:
    search = CapacitySearch(5, 30)
    tried: list[int] = []
    for count in search.counts():
        tried.append(count)
        search.report(count, carried=True)
    assert tried == [5, 10, 20, 30]
    assert search.carried == 30


def load(layout: Any, *connect: str) -> Load:
    return Load(
        rate_hz=100.0,
        duration_s=1.0,
        layout=layout,
        shards=2,
        router=None,
        secured=False,
        site="lab",
        connect=connect,
    )


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


def test_what_this_process_takes_is_known() -> None:
    before = read_usage()
    assert before is not None
    sum(range(3_000_000))
    after = read_usage()
    assert after is not None
    assert after.cpu_s > before.cpu_s
    assert 5 < after.memory_mb < 10_000
    assert read_usage(2**22 + 1) is None
