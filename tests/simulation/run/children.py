"""Runs each seed in a forked child, which ends without any `finally` of killed processes."""

import asyncio
import gc
import importlib
import os
import select
import signal
import tempfile
import time
import traceback
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from pointit.schemas.base import SchemaModel
from tests.simulation.faults.drawing import draw_plan
from tests.simulation.faults.fault import Fault
from tests.simulation.kernel.disks import install_disks
from tests.simulation.kernel.loop import SimulationLoop
from tests.simulation.kernel.simulation import Simulation
from tests.simulation.mistakes import MISTAKES
from tests.simulation.promises import promise
from tests.simulation.promises.breaches import Breach
from tests.simulation.run.result import Result
from tests.simulation.run.seed_run import SeedRun
from tests.simulation.world.world import Plan

CPU_LIMIT_S = 20.0
"""CPU that a seed may take, s. One that takes more stands still in virtual time."""
MEMORY_FOLDER = Path("/dev/shm")  # noqa: S108 - of the system, in memory
SERVICES = (
    "conveyor_sim",
    "keeper",
    "led_driver",
    "localizer",
    "pointing",
    "pui",
    "reactions",
    "selector",
    "supervisor",
    "user_sim",
)


@dataclass(frozen=True)
class Job:
    """A seed, and what it is to have instead of its own."""

    seed: int
    plan: Plan | None = None
    faults: Sequence[Fault] | None = None
    mistake: str = ""
    """Name of a planted mistake."""
    trace_file: str = ""
    ends_at: str = ""
    """Name of the promise at whose breach the run ends."""


def preload() -> None:
    """Import once what all seeds need, and leave it out of garbage collections."""
    for name in SERVICES:
        importlib.import_module(f"pointit.services.{name}.service")
    with _state_folder() as folder, asyncio.Runner(loop_factory=SimulationLoop) as runner:
        SeedRun(Simulation(runner.get_loop(), 0), Path(folder), draw_plan(0))
    Simulation.current = None
    _complete_models(SchemaModel)
    gc.collect()
    gc.freeze()


def _complete_models(model: type[SchemaModel]) -> None:
    """Build the validators of a model and its subclasses, else built in each child."""
    model.model_rebuild(raise_errors=False)
    for each in model.__subclasses__():
        _complete_models(each)


def _state_folder() -> tempfile.TemporaryDirectory[str]:
    folder = MEMORY_FOLDER if MEMORY_FOLDER.is_dir() else None
    return tempfile.TemporaryDirectory(prefix="pointit-simulation-", dir=folder)


class Child:
    """A process that runs one seed."""

    def __init__(self, job: Job) -> None:
        """Fork it."""
        self.job = job
        self.pipe, writing = os.pipe()
        self._folder = _state_folder()
        self._pid = os.fork()
        if self._pid == 0:
            os.close(self.pipe)
            try:
                _run(job, Path(self._folder.name), writing)
            except BaseException:  # noqa: BLE001 - the parent goes on
                traceback.print_exc()
            os._exit(1)
        os.close(writing)

    def result(self) -> Result:
        """Return its result. Call this when `pipe` can be read."""
        with os.fdopen(self.pipe) as pipe:
            text = pipe.read()
        os.waitpid(self._pid, 0)
        self._folder.cleanup()
        return Result.from_json(text) if text else Result(self.job.seed, error="the child process died")

    def kill(self) -> None:
        """End it."""
        with suppress(ProcessLookupError):
            os.kill(self._pid, signal.SIGKILL)
        os.waitpid(self._pid, 0)
        os.close(self.pipe)
        self._folder.cleanup()


def _run(job: Job, folder: Path, pipe: int) -> None:
    """Run a seed in this process, which does nothing else, and end it."""
    gc.disable()  # a seed is short
    install_disks()
    if job.mistake:
        MISTAKES[job.mistake].plant()
    loop = SimulationLoop()
    asyncio.set_event_loop(loop)
    simulation = Simulation(loop, job.seed)
    if job.trace_file:
        simulation.full_trace = []
    run = SeedRun(simulation, folder, job.plan, job.faults)

    def end_at_breach(breach: Breach) -> None:
        if breach.promise == job.ends_at:
            _end(run, "", job.trace_file, pipe)

    run.breaches.on_first.append(end_at_breach)

    def stop(_number: int, frame: FrameType | None) -> None:
        stack = "".join(traceback.format_stack(frame, limit=6))
        run.breaches.add(promise.GOES_ON, f"{CPU_LIMIT_S:g} s of CPU: {stack}")
        _end(run, "", job.trace_file, pipe)

    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, CPU_LIMIT_S)
    error = ""
    try:
        loop.run_until_complete(run.run())
    except Exception:  # noqa: BLE001 - reported as that of the simulation
        error = traceback.format_exc(limit=-8)
    _end(run, error, job.trace_file, pipe)


def _end(run: SeedRun, error: str, trace_file: str, pipe: int) -> None:
    result = run.result()
    result.error = error
    result.cpu_s = time.process_time()
    if trace_file:
        Path(trace_file).write_text("\n".join([*(run.simulation.full_trace or ()), ""]))
    with os.fdopen(pipe, "w") as out:
        out.write(result.to_json())
    os._exit(0)  # without the end of the loop, at which tasks of killed processes would run


def run_job(job: Job) -> Result:
    """Run one seed and return its result."""
    return Child(job).result()


def run_jobs(jobs: Iterable[Job], processes: int = 1) -> Iterator[Result]:
    """Run seeds in up to `processes` processes at a time, and yield their results as they come."""
    waiting = iter(jobs)
    running: dict[int, Child] = {}
    try:
        while True:
            while len(running) < processes:
                job = next(waiting, None)
                if job is None:
                    break
                child = Child(job)
                running[child.pipe] = child
            if not running:
                return
            for pipe in select.select(list(running), [], [])[0]:
                yield running.pop(pipe).result()
    finally:
        for child in running.values():
            child.kill()
