"""Runs of seeds in processes of their own, since clocks are replaced before the product is imported."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.architecture.sources import ROOT
from tests.simulation.promises import promise
from tests.simulation.promises.promise import PROMISES
from tests.simulation.run.kept import KEPT_FOLDER, read_kept


def _run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tests.simulation", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def _results(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


@pytest.mark.slow
def test_a_seed_repeats_exactly(tmp_path: Path) -> None:
    out = tmp_path / "results"

    for _ in range(2):
        _run("--seeds", "3-4", "--json", str(out))

    digests = {(each["seed"], each["digest"]) for each in _results(out)}
    assert len(_results(out)) == 4
    assert len(digests) == 2
    assert all(not each["error"] and each["counts"]["events"] > 20 for each in _results(out))


def test_kept_failures_hold_all_promises() -> None:
    kept = [str(path) for path in sorted(KEPT_FOLDER.glob("*.yaml"))]

    done = _run("--kept", *kept)

    assert done.returncode == 0, done.stdout
    assert f"{len(kept)} seeds, " in done.stdout


def test_ten_seeds_hold_all_promises() -> None:
    done = _run("--seeds", "0-9")

    assert done.returncode == 0, done.stdout
    assert "10 seeds, " in done.stdout


@pytest.mark.slow
def test_a_planted_mistake_breaks_its_promise() -> None:
    done = _run("--seed", "3", "--mistake", "done-at-once")

    assert done.returncode == 1
    assert f"BROKEN {promise.DONE_IS_DONE.name}" in done.stdout


@pytest.mark.parametrize("path", sorted(KEPT_FOLDER.glob("*.yaml")), ids=lambda path: path.stem)
def test_a_kept_failure_names_a_promise_and_what_it_found(path: Path) -> None:
    kept = read_kept(path)

    assert kept.promise in {each.name for each in PROMISES}
    assert kept.found.endswith(".")


def test_a_fault_that_cannot_be_read_is_told_in_one_sentence() -> None:
    done = _run("--seed", "3", "--fault", "8,cut,far,0")

    assert done.returncode == 2
    fields = "at_s, kind, target, number, duration_s, detail"
    assert done.stderr == f"tests.simulation: '8,cut,far,0' has 4 fields, not these: {fields}\n"
