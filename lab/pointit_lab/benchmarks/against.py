"""Speed of this tree beside another commit's, measured by each tree's own benchmark, in turns."""

import contextlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
from rich.table import Table

from pointit_lab.benchmarks.our_chain import DELIVERED, costs
from pointit_lab.loadtest.slopes import fit

ROOT = Path(__file__).parents[3]
PEOPLE = (20, 60)
"""People in the runs whose CPU time per sample is compared."""


def _latency(layout: str, quantile: str) -> Callable[[dict[str, Any]], float]:
    def ratio(result: dict[str, Any]) -> float:
        ratios = result["latency"][layout]["ratio_to_direct"]
        return float(ratios[quantile])

    return ratio


def _cpu_us(part: str, column: str, people: int) -> Callable[[dict[str, Any]], float]:
    def cpu_us(result: dict[str, Any]) -> float:
        for row in result[part]:
            # a drop costs less
            if row["users"] == people and row["delivered"] >= DELIVERED:
                return float(row[column])
        raise KeyError(column)

    return cpu_us


def _cost(part: str, share: str, kind: str) -> Callable[[dict[str, Any]], float]:
    def cost(result: dict[str, Any]) -> float:
        return costs(result[part], share)[kind].value

    return cost


def _of_cpu(title: str, part: str, version: str) -> dict[str, Callable[[dict[str, Any]], float]]:
    """Return the figures of CPU in the columns of `version` of a part."""
    share = f"{version}_share_of_a_core"
    column = f"{version}_us_per_sample"
    figures: dict[str, Callable[[dict[str, Any]], float]] = {}
    for people in PEOPLE:
        figures[f"{title}, {people} people, µs a sample"] = _cpu_us(part, column, people)
    figures[f"{title}, fit, µs a sample"] = _cost(part, share, "sample")
    figures[f"{title}, fit, fixed, % of a core"] = _cost(part, share, "fixed")
    return figures


FIGURES: dict[str, Callable[[dict[str, Any]], float]] = {
    "one process, p50 to bare Zenoh": _latency("one_process", "p50"),
    "one process, p99 to bare Zenoh": _latency("one_process", "p99"),
    "separate processes, p50 to bare Zenoh": _latency("separate_processes", "p50"),
    "separate processes, p99 to bare Zenoh": _latency("separate_processes", "p99"),
    **_of_cpu("CPU with the driver's", "users", "cpu"),
    **_of_cpu("CPU of services", "users", "services"),
    **_of_cpu("CPU of services, wrists apart", "users_apart", "services"),
}
"""Figures that are compared, less is better, each read from the JSON that a tree's benchmark writes.

A figure that one of the trees does not write, or whose fit lacks rows, is left out.
"""


def resolved(commit: str) -> str:
    """Return `commit`.

    Raises:
        click.BadParameter: This repository has no such commit.
    """
    revision = f"{commit}^{{commit}}"
    command = ["git", "-C", str(ROOT), "rev-parse", "--quiet", "--verify", revision]
    code = subprocess.run(command, stdout=subprocess.DEVNULL, check=False).returncode
    if code != 0:
        sentence = f"this repository has no commit {commit}; `git log --oneline` lists them"
        raise click.BadParameter(sentence)
    return commit


def compare(commit: str, duration_s: float, rounds: int) -> dict[str, Any]:
    """Return each figure here and at `commit`, and the ratio here / there, as one number a round.

    Raises:
        subprocess.CalledProcessError: A benchmark failed.
    """
    here: list[dict[str, Any]] = []
    there: list[dict[str, Any]] = []
    with _checked_out(commit) as other:
        for _ in range(rounds):
            here.append(_measured(ROOT, duration_s))
            there.append(_measured(other, duration_s))

    # The other tree may lack a figure, or have too few rows for one: then it is not compared.
    figures: dict[str, Any] = {}
    for name, read in FIGURES.items():
        with contextlib.suppress(KeyError):
            own_values = [read(result) for result in here]
            other_values = [read(result) for result in there]
            ratios: list[float] = []
            for own, others in zip(own_values, other_values, strict=True):
                ratios.append(round(own / others, 3))
            figures[name] = {"here": own_values, "there": other_values, "ratio": ratios}
    return {"commit": commit, "rounds": rounds, "figures": figures}


def table(result: dict[str, Any]) -> Table:
    """Return medians, the ratio's mean with its 95 % interval, and its spread over the rounds."""
    title = f"This tree and {result['commit']}, median of {result['rounds']} rounds"
    shown = Table(title=title)
    shown.add_column("figure", justify="left")
    for column in ("here", "there", "here / there", "mean", "least, most"):
        shown.add_column(column, justify="right")
    for name, values in result["figures"].items():
        medians: list[str] = []
        for column in ("here", "there", "ratio"):
            median = statistics.median(values[column])
            medians.append(f"{median:.2f}")

        # a fit of a constant is a mean with its interval
        ratios = values["ratio"]
        constant = [1.0] * len(ratios)
        mean = fit({"mean": constant}, ratios).get("mean", "-")
        least = min(ratios)
        most = max(ratios)
        shown.add_row(name, *medians, str(mean), f"{least:.2f}, {most:.2f}")
    return shown


@contextmanager
def _checked_out(commit: str) -> Generator[Path]:
    """Create a git worktree of `commit`, and remove it at the end."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        git = ("git", "-C", str(ROOT), "worktree")
        add = [*git, "add", "--quiet", "--detach", str(tree), commit]
        subprocess.run(add, check=True)
        try:
            yield tree
        finally:
            remove = [*git, "remove", "--force", str(tree)]
            subprocess.run(remove, check=True)


def _measured(tree: Path, duration_s: float) -> dict[str, Any]:
    """Run the benchmark of `tree` with this interpreter and its packages. Return its results."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "result.json"
        command = [sys.executable, "-m", "pointit_lab.benchmarks", "--only", "latency", "--only", "users"]
        command += ["--duration", str(duration_s), "--json", str(path)]
        import_path = os.pathsep.join([str(tree), str(tree / "lab")])
        environment = os.environ | {"PYTHONPATH": import_path}
        subprocess.run(command, cwd=tree, env=environment, stdout=subprocess.DEVNULL, check=True)
        text = path.read_text(encoding="utf-8")
        result: dict[str, Any] = json.loads(text)
        return result
