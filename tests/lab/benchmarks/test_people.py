"""Costs of the services in the benchmark: of what was delivered, compared where both trees tell them."""

import asyncio
import contextlib
import subprocess
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from pointit_lab.benchmarks import against
from pointit_lab.benchmarks.__main__ import main
from pointit_lab.benchmarks.our_chain import carried, costs
from tests.support.buses import free_port


def rows(us_per_sample: float, *, driver_us: float = 40.0, is_old: bool = False) -> list[dict[str, Any]]:
    """Return rows of a site that takes 3 % of a core, and of 80 people, of whose samples half were lost."""
    made: list[dict[str, Any]] = []
    for users in (1, 10, 20, 60, 80):
        samples = 100.0 * users
        share = 0.03 + samples * us_per_sample / 1e6
        total = share + samples * driver_us / 1e6
        made.append(
            {
                "users": users,
                "cpu_share_of_a_core": total if users < 80 else 0.1,
                "cpu_us_per_sample": total / samples * 1e6,
                "delivered": 1.0 if users < 80 else 0.5,
            }
        )
        if not is_old:
            made[-1] |= {"services_share_of_a_core": share, "services_us_per_sample": share / samples * 1e6}
    return made


def test_costs_are_those_of_the_rows_that_delivered() -> None:
    found = costs(rows(100.0), "services_share_of_a_core")
    assert found["fixed"].value == pytest.approx(3.0)
    assert found["sample"].value == pytest.approx(100.0)
    assert costs(rows(100.0, is_old=True), "cpu_share_of_a_core")["sample"].value == pytest.approx(140.0)


def test_commit_with_older_figures_is_compared_by_those_it_has(monkeypatch: pytest.MonkeyPatch) -> None:
    ratios = {"ratio_to_direct": {"p50": 2.0, "p99": 3.0}}
    latency = {"one_process": ratios, "separate_processes": ratios}
    here: dict[str, Any] = {"latency": latency, "users": rows(100.0), "users_apart": rows(120.0)}
    there: dict[str, Any] = {"latency": latency, "users": rows(60.0, is_old=True)}

    def checked_out(_commit: str) -> contextlib.nullcontext[Path]:
        return contextlib.nullcontext(Path("there"))

    def measured(tree: Path, _duration_s: float) -> dict[str, Any]:
        return there if tree == Path("there") else here

    monkeypatch.setattr(against, "_checked_out", checked_out)
    monkeypatch.setattr(against, "_measured", measured)
    figures = against.compare("a commit", 1.0, 2)["figures"]
    assert figures["CPU with the driver's, fit, µs a sample"]["ratio"] == [1.4, 1.4]
    assert not [name for name in figures if name.startswith("CPU of services")]
    there |= here
    figures = against.compare("a commit", 1.0, 2)["figures"]
    assert figures["CPU of services, wrists apart, fit, µs a sample"]["ratio"] == [1.0, 1.0]


def test_another_commit_runs_its_own_modules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("pointit", "lab/pointit_lab"):
        (tmp_path / package).mkdir(parents=True)
        for name in ("__init__.py", "old.py"):
            (tmp_path / package / name).touch()
    (tmp_path / "lab/pointit_lab/benchmarks.py").write_text(
        "import json, sys, pointit.old, pointit_lab.old\n"
        "json.dump({'ran': True}, open(sys.argv[-1], 'w', encoding='utf-8'))\n"
    )
    git = ("git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b")
    for command in (("init", "--quiet"), ("add", "."), ("commit", "--quiet", "-m", "old")):
        subprocess.run([*git, *command], check=True)
    monkeypatch.setattr(against, "ROOT", tmp_path)
    with against._checked_out("HEAD") as tree:
        assert against._measured(tree, 1.0) == {"ran": True}


@pytest.mark.usefixtures("own_state")
@pytest.mark.parametrize("is_apart", [False, True])
def test_the_drivers_cost_is_not_the_services(*, is_apart: bool) -> None:
    row = asyncio.run(carried(1, 0.5, f"tcp/127.0.0.1:{free_port()}" if is_apart else ""))
    assert row["people_sent"] > 0
    assert row["cpu_us_per_sample"] > 0
    driver_us = row["driver_us_per_sample"]
    assert (driver_us is None) == is_apart
    assert driver_us is None or driver_us > 0
    share = row["cpu_share_of_a_core"] * row["services_us_per_sample"] / row["cpu_us_per_sample"]
    assert row["services_share_of_a_core"] == pytest.approx(share, rel=0.05, abs=0.002)
    parts = row["services_us_per_sample"] + (driver_us or 0.0)
    assert parts == pytest.approx(row["cpu_us_per_sample"], abs=0.2)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--against", "nowhere"], "this repository has no commit nowhere"),
        (["--duration", "-1"], "-1.0 is not in the range"),
        (["--rate", "0"], "0.0 is not in the range"),
    ],
)
def test_impossible_options_are_refused_in_one_sentence(arguments: list[str], sentence: str) -> None:
    ended = CliRunner().invoke(main, arguments)
    assert (ended.exit_code, sentence in ended.output) == (2, True), ended.output
