"""A site under load: its services in one process or several, wrists, and an observer."""

import asyncio
import contextlib
import json
import os
import signal
import sys
import time
from collections.abc import AsyncGenerator, Sequence
from dataclasses import dataclass, field
from typing import Any

from pointit.cli.loadtest.figures import LoadResult, Usage
from pointit.cli.loadtest.worker import dump_launches, read_usage
from pointit.cli.loadtest.wrist import Wrist, drive_wrists
from pointit.runtime.clock import WallClock
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch, run_services
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import NS_PER_S, Cursor, Hover, Message, StripsFrame, UserPose
from pointit.schemas.topics import CURSOR, HOVER, IMU, POSE, STRIPS_FRAME

READY_S = 60.0
"""Timeout until all poses are known and so all services run, for many processes on a busy machine."""

DRAIN_S = 0.3
STOP_S = 2.0


@dataclass(kw_only=True)
class Group:
    """Services that run together in one process, and the users whose wrists it drives."""

    name: str
    launches: Sequence[Launch] = ()
    wrists: Sequence[str] = ()


@dataclass
class _Sight:
    """Messages received in the measuring time."""

    users: frozenset[str]
    cursors: int = 0
    hovers: int = 0
    stamps: set[int] = field(default_factory=set[int])
    cursor_s: list[float] = field(default_factory=list[float])
    frames: dict[int, float] = field(default_factory=dict[int, float])
    """Age of each frame on arrival, by stamp."""
    poses: set[str] = field(default_factory=set[str])

    def on_cursor(self, cursor: Cursor, user: str) -> None:
        if user in self.users:
            self.cursors += 1
            self.stamps.add(cursor.stamp_ns)
            self.cursor_s.append(_age_s(cursor))

    def on_hover(self, _hover: Hover, user: str) -> None:
        self.hovers += user in self.users

    def on_frame(self, frame: StripsFrame, _name: str) -> None:
        self.frames.setdefault(frame.stamp_ns, _age_s(frame))

    def on_pose(self, _pose: UserPose, user: str) -> None:
        self.poses.add(user)

    def clear(self) -> None:
        self.cursors = self.hovers = 0
        for kept in (self.stamps, self.cursor_s, self.frames):
            kept.clear()

    def light_s(self) -> list[float]:
        """Return the ages of the frames that show one of our samples; others are drawn for other reasons."""
        return [age_s for stamp_ns, age_s in self.frames.items() if stamp_ns in self.stamps]


def _age_s(message: Message) -> float:
    return (time.time_ns() - message.stamp_ns) / NS_PER_S


class Worker:
    """A group in a process of its own."""

    def __init__(self, group: Group, process: asyncio.subprocess.Process) -> None:
        self.group = group
        self.process = process

    @classmethod
    async def start(cls, group: Group, site: str, connect: str) -> "Worker":
        """Start the process, and send it its launches."""
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "pointit.cli.loadtest.worker",
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            process_group=0,  # a terminal's Ctrl-C is for the parent, which ends its children
        )
        worker = cls(group, process)
        worker.send_line(
            {
                "site": site,
                "connect": connect,
                "launches": dump_launches(group.launches),
                "wrists": list(group.wrists),
            }
        )
        return worker

    def send_line(self, what: dict[str, Any]) -> None:
        """Send it `what` as a line of JSON."""
        if self.process.stdin is not None:
            self.process.stdin.write((json.dumps(what) + "\n").encode())

    async def answer(self) -> dict[str, Any]:
        """Return its next line.

        Raises:
            ConfigError: If it has ended.
        """
        line = b"" if self.process.stdout is None else await self.process.stdout.readline()
        if not line:
            raise ConfigError(f"the process of {self.group.name} has ended: see its output above")
        answer: dict[str, Any] = json.loads(line)
        return answer

    async def end(self) -> None:
        """End it."""
        if self.process.stdin is not None:
            self.process.stdin.close()
        try:
            async with asyncio.timeout(STOP_S):
                await self.process.wait()
        except TimeoutError:
            self.process.kill()
            await self.process.wait()


class LoadTest:
    """A site under load, ready to be measured."""

    def __init__(self, bus: ZenohBus, here: Group, workers: Sequence[Worker], router: int | None) -> None:
        self._bus = bus
        self._workers = workers
        self._router = router
        self._here = here
        self._users = [
            user for group in (here, *(worker.group for worker in workers)) for user in group.wrists
        ]
        self._sight = _Sight(frozenset(self._users))
        self._wrists = [Wrist(bus.publisher(IMU, user), index) for index, user in enumerate(here.wrists)]
        bus.subscribe(POSE, self._sight.on_pose)
        bus.subscribe(CURSOR, self._sight.on_cursor)
        bus.subscribe(HOVER, self._sight.on_hover)
        bus.subscribe(STRIPS_FRAME, self._sight.on_frame)

    async def until_ready(self, services: "asyncio.Task[None] | None") -> None:
        """Wait until all poses are known.

        Raises:
            ConfigError: If that exceeds `READY_S`.
        """
        end_s = time.monotonic() + READY_S
        while not self._sight.users <= self._sight.poses:
            if services is not None and services.done():
                services.result()
            missing = self._sight.users - self._sight.poses
            for worker in self._workers:
                if worker.process.returncode is not None:
                    await worker.answer()  # raises
            if time.monotonic() > end_s:
                raise ConfigError(
                    f"{len(missing)} of {len(self._users)} people were not ready within {READY_S:g} s; "
                    "try fewer --users, or another --layout"
                )
            await asyncio.sleep(0.05)

    async def measure(self, rate_hz: float, duration_s: float, layout: str) -> LoadResult:
        """Drive all wrists for `duration_s` and return the result."""
        self._sight.clear()
        before, sent = read_usage(), sum(wrist.sent for wrist in self._wrists)
        router = read_usage(self._router) if self._router else None
        began_s = time.monotonic()
        for worker in self._workers:
            worker.send_line({"rate_hz": rate_hz, "duration_s": duration_s})
        await drive_wrists(self._wrists, rate_hz, duration_s)
        answers = [await worker.answer() for worker in self._workers]
        lasted_s = time.monotonic() - began_s
        after = read_usage()
        await asyncio.sleep(DRAIN_S)
        sent = sum(wrist.sent for wrist in self._wrists) - sent + sum(answer["sent"] for answer in answers)
        processes: list[Usage] = []
        if before is not None and after is not None:
            cpu = (after.cpu_s - before.cpu_s) / lasted_s
            processes.append(Usage(name=self._here.name, cpu=cpu, memory_mb=after.memory_mb))
        processes += [
            Usage(name=worker.group.name, cpu=answer["cpu_s"] / lasted_s, memory_mb=answer["memory_mb"])
            for worker, answer in zip(self._workers, answers, strict=True)
        ]
        if router is not None and (now := read_usage(self._router)) is not None:
            cpu = (now.cpu_s - router.cpu_s) / lasted_s
            processes.append(Usage(name="router", cpu=cpu, memory_mb=now.memory_mb))
        return LoadResult(
            users=len(self._users),
            rate_hz=rate_hz,
            duration_s=duration_s,
            layout=layout,
            sent=sent,
            pointed=self._sight.cursors,
            hovered=self._sight.hovers,
            light_s=self._sight.light_s(),
            cursor_s=list(self._sight.cursor_s),
            processes=processes,
            load_average=round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        )


@contextlib.asynccontextmanager
async def start_load_test(
    bus: ZenohBus, here: Group, elsewhere: Sequence[Group], connect: str, router: int | None = None
) -> AsyncGenerator[LoadTest]:
    """Yield a site with all services running; processes join it at `connect`.

    Raises:
        ConfigError: If a process ended, or they were not ready in time.
    """
    async with contextlib.AsyncExitStack() as stack:
        services = await stack.enter_async_context(running(here.launches, bus)) if here.launches else None
        workers: list[Worker] = []
        stack.push_async_callback(_end_all, workers)
        for group in elsewhere:
            worker = await Worker.start(group, bus.site, connect)
            workers.append(worker)  # one by one, so that started ones are ended if the next one fails
        rig = LoadTest(bus, here, workers, router)
        await rig.until_ready(services)
        yield rig


@contextlib.asynccontextmanager
async def running(launches: Sequence[Launch], bus: ZenohBus) -> AsyncGenerator[asyncio.Task[None]]:
    """Run services on `bus`. Yield their task."""
    services = asyncio.create_task(run_services(launches, bus, WallClock()))
    try:
        yield services
    finally:
        services.cancel()
        await asyncio.wait({services})


async def _end_all(workers: Sequence[Worker]) -> None:
    await asyncio.gather(*(worker.end() for worker in workers))


@contextlib.asynccontextmanager
async def router_process(options: Sequence[str]) -> AsyncGenerator[int]:
    """Yield the process id of a listening `pointit router` with these options."""
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "pointit.cli",
        "router",
        *options,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        process_group=0,
    )
    try:
        if process.stdout is None or not await process.stdout.readline():
            raise ConfigError("the router has ended: see its output above")
        yield process.pid
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.send_signal(signal.SIGTERM)
        await process.wait()
