"""Speed of this tree beside another commit's, measured by each tree's own benchmark, in turns."""

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

from rich.table import Table

ROOT = Path(__file__).parents[3]
PEOPLE = 20
"""People in the run whose CPU time per sample is compared."""


def _latency(layout: str, quantile: str) -> Callable[[dict[str, Any]], float]:
    return lambda result: float(result["latency"][layout]["ratio_to_direct"][quantile])


def _cpu_us(result: dict[str, Any]) -> float:
    return next(float(row["cpu_us_per_sample"]) for row in result["users"] if row["users"] == PEOPLE)


FIGURES: dict[str, Callable[[dict[str, Any]], float]] = {
    "one process, p50 to bare Zenoh": _latency("one_process", "p50"),
    "one process, p99 to bare Zenoh": _latency("one_process", "p99"),
    "separate processes, p50 to bare Zenoh": _latency("separate_processes", "p50"),
    "separate processes, p99 to bare Zenoh": _latency("separate_processes", "p99"),
    f"CPU per sample, {PEOPLE} people, µs": _cpu_us,
}
"""Figures that are compared, less is better, each read from the JSON that a tree's benchmark writes."""


def compare(commit: str, duration_s: float, rounds: int) -> dict[str, Any]:
    """Return each figure here and at `commit`, and the ratio here / there, as one number a round.

    Raises:
        subprocess.CalledProcessError: There is no such commit, or a benchmark failed.
    """
    here: list[dict[str, Any]] = []
    there: list[dict[str, Any]] = []
    with _checked_out(commit) as other:
        for _ in range(rounds):
            here.append(_measured(ROOT, duration_s))
            there.append(_measured(other, duration_s))
    figures: dict[str, Any] = {}
    for name, read in FIGURES.items():
        ours, theirs = [read(result) for result in here], [read(result) for result in there]
        ratios = [round(a / b, 3) for a, b in zip(ours, theirs, strict=True)]
        figures[name] = {"here": ours, "there": theirs, "ratio": ratios}
    return {"commit": commit, "rounds": rounds, "figures": figures}


def table(result: dict[str, Any]) -> Table:
    """Return medians and the ratio's spread over the rounds."""
    shown = Table(title=f"This tree and {result['commit']}, median of {result['rounds']} rounds")
    for column in ("figure", "here", "there", "here / there", "least, most"):
        shown.add_column(column, justify="left" if column == "figure" else "right")
    for name, values in result["figures"].items():
        medians = [f"{statistics.median(values[key]):.2f}" for key in ("here", "there", "ratio")]
        ratios = values["ratio"]
        shown.add_row(name, *medians, f"{min(ratios):.2f}, {max(ratios):.2f}")
    return shown


@contextmanager
def _checked_out(commit: str) -> Generator[Path]:
    """Have `commit` in a git worktree of its own for a while."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        git = ("git", "-C", str(ROOT), "worktree")
        subprocess.run([*git, "add", "--quiet", "--detach", str(tree), commit], check=True)
        try:
            yield tree
        finally:
            subprocess.run([*git, "remove", "--force", str(tree)], check=True)


def _measured(tree: Path, duration_s: float) -> dict[str, Any]:
    """Run the benchmark of `tree` with this interpreter and its packages. Return its results."""
    roots = [str(package.parent) for package in sorted(tree.glob("*/pointit*"))]
    benchmark = "pointit_lab.benchmarks" if (tree / "lab").is_dir() else "benchmarks"  # of older commits
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "result.json"
        command = [sys.executable, "-m", benchmark, "--only", "latency", "--only", "users"]
        subprocess.run(
            [*command, "--duration", str(duration_s), "--json", str(path)],
            cwd=tree,
            env=os.environ | {"PYTHONPATH": os.pathsep.join([str(tree), *roots])},
            stdout=subprocess.DEVNULL,
            check=True,
        )
        result: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return result
