"""The command line of simulations."""

import argparse
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import yaml

from tests.simulation.faults.drawing import draw_plan
from tests.simulation.faults.fault import Fault, FaultFormatError, parse_fault
from tests.simulation.kernel.patched_python import real_time_s
from tests.simulation.mistakes import MISTAKES
from tests.simulation.run.children import Job, preload, run_job, run_jobs
from tests.simulation.run.kept import KeptFailure, read_kept
from tests.simulation.run.result import Result
from tests.simulation.run.shrinking import shrink

SHOWN_LINES = 60
PLANTED_SEED = 3
"""Seed that a mistake with faults of its own is tried in first."""


def main() -> int:
    """Run what the command line says. Return 1 if a promise was broken."""
    options = _parser().parse_args()
    try:
        jobs = _jobs(options)
    except (FaultFormatError, ValueError) as error:
        print(f"tests.simulation: {error}", file=sys.stderr)
        return 2
    preload()
    if options.mistakes:
        return _find_mistakes(jobs, options.processes)
    if options.shrink:
        return _shrink(jobs[0], options.promise)
    if len(jobs) == 1:
        result = run_job(jobs[0])
        _show(result, is_long=True)
        return int(bool(result.breaches or result.error))
    return _run_many(jobs, options)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.simulation", description=(
        "Run a whole site in simulated faults. A seed decides everything, and repeats exactly."
    ))  # fmt: skip
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--seed", type=int, help="run one seed and print all about it")
    which.add_argument("--seeds", metavar="FIRST-LAST", help="run these seeds")
    which.add_argument("--kept", type=Path, nargs="+", metavar="FILE", help="run kept failures")
    parser.add_argument("--processes", type=int, default=1, help="number of seeds that run at a time")
    parser.add_argument("--until-first", action="store_true", help="end at the first broken promise")
    parser.add_argument("--seconds", type=float, help="begin no seed after this time, s")
    parser.add_argument("--json", type=Path, help="append a line of JSON for each seed to this file")
    parser.add_argument("--trace", default="", metavar="FILE", help="write all lines of the trace of --seed")
    parser.add_argument("--shrink", action="store_true", help="leave out faults that --promise does not need")
    parser.add_argument("--promise", default="", help="name of the promise that is to be broken")
    parser.add_argument(
        "--fault", action="append", default=[], metavar="LINE",
        help="fault instead of those of the seed: at_s,kind,target,number,duration_s,detail",
    )  # fmt: skip
    parser.add_argument("--mistake", default="", choices=["", *MISTAKES], help="plant this mistake")
    parser.add_argument(
        "--mistakes", action="store_true", help="plant each mistake, and count the seeds until it is found"
    )
    return parser


def _jobs(options: argparse.Namespace) -> list[Job]:
    """Return the jobs of the command line.

    Raises:
        FaultFormatError: A fault cannot be read.
        ValueError: The seeds are not numbers.
    """
    if options.kept:
        return [_kept_job(read_kept(path), options.mistake) for path in options.kept]
    faults: list[Fault] | None = [parse_fault(line) for line in options.fault] or None
    if options.seed is not None:
        return [Job(options.seed, None, faults, options.mistake, options.trace)]
    first, _, last = options.seeds.partition("-")
    return [Job(seed, None, faults, options.mistake) for seed in range(int(first), int(last or first) + 1)]


def _kept_job(kept: KeptFailure, mistake: str) -> Job:
    return Job(kept.plan.seed, kept.plan, kept.faults, mistake)


def _run_many(jobs: Sequence[Job], options: argparse.Namespace) -> int:
    began_s = real_time_s()
    results = run_jobs(_until(jobs, options.seconds, began_s), options.processes)
    count = 0
    broken = Counter[str]()
    cpu_s = 0.0
    simulated_s = 0.0
    for result in results:
        count += 1
        cpu_s += result.cpu_s
        simulated_s += result.simulated_s
        if options.json:
            with options.json.open("a") as out:
                out.write(result.to_json() + "\n")
        if not result.breaches and not result.error:
            continue
        _show(result, is_long=False)
        broken.update(result.broken or ["error"])
        if options.until_first and (not options.promise or options.promise in result.broken):
            break
    for name, number in broken.most_common():
        print(f"{number:4d} seeds broke: {name}")
    rate = 60 * count / max(cpu_s, 0.01)
    if count:
        print(f"first seed {jobs[0].seed}")
    speed = simulated_s / max(cpu_s, 0.01)
    print(f"{count} seeds, {simulated_s:.0f} simulated s in {cpu_s:.0f} s of CPU")
    print(f"{rate:.0f} seeds a minute of CPU, {speed:.0f} times real time")
    return int(bool(broken))


def _find_mistakes(jobs: Sequence[Job], processes: int) -> int:
    """Print a row for each mistake. Return 1 if the seeds do not find all of them."""
    missed = 0
    for name, mistake in MISTAKES.items():
        others = Counter[str]()
        planted = [replace(job, mistake=name, ends_at=mistake.breaks.name) for job in jobs]
        if mistake.faults:
            faults = [parse_fault(line) for line in mistake.faults]
            planted.insert(0, replace(planted[0], seed=PLANTED_SEED, faults=faults))
        for count, result in enumerate(run_jobs(planted, processes), 1):
            if mistake.breaks.name in result.broken:
                how = "with its faults" if count == 1 and mistake.faults else "with faults of a seed"
                print(f"{name}: run {count}, {how}, broke `{mistake.breaks.name}`", flush=True)
                break
            others.update(result.broken or ([result.error[-300:]] if result.error else []))
        else:
            missed += 1
            print(f"{name}: NOT FOUND in {len(planted)} runs, which broke {dict(others)}", flush=True)
    print(f"{len(MISTAKES) - missed} of {len(MISTAKES)} mistakes found")
    return int(missed > 0)


def _until(jobs: Sequence[Job], seconds: float | None, began_s: float) -> Iterator[Job]:
    for job in jobs:
        if seconds is None or real_time_s() - began_s < seconds:
            yield job


def _shrink(job: Job, promise: str) -> int:
    first = run_job(job)
    if not first.breaches:
        _show(first, is_long=False)
        return 0
    promise = promise or first.broken[0]

    def breaks(faults: Sequence[Fault]) -> bool:
        is_broken = promise in run_job(replace(job, faults=faults, ends_at=promise)).broken
        print(f"{len(faults)} faults: {'broken' if is_broken else 'holds'}", flush=True)
        return is_broken

    faults = shrink([parse_fault(line) for line in first.faults], breaks)
    _show(run_job(replace(job, faults=faults)), is_long=True)
    kept = KeptFailure(f"What it found. Seed {job.seed}.", promise, job.plan or draw_plan(job.seed), faults)
    print(yaml.safe_dump(kept.to_yaml(), sort_keys=False, width=110))
    return 1


def _show(result: Result, *, is_long: bool) -> None:
    times = f"{result.simulated_s:.0f} s in {result.cpu_s:.1f} s of CPU"
    print(f"seed {result.seed}: {times}, digest {result.digest}")
    if result.error:
        print(f"  ERROR {result.error}")
    for breach in result.breaches:
        print(f"  BROKEN {breach.promise}: {breach.text} (at {breach.at_s:.3f} s) {breach.where}")
        if is_long:
            for line in breach.trace[-SHOWN_LINES:]:
                print(f"    {line}")
    if is_long:
        print(f"  plan {result.plan}")
        print(f"  {result.counts}")
        for line in result.faults:
            print(f"  fault {parse_fault(line)}   --fault {line!r}")
    sys.stdout.flush()
