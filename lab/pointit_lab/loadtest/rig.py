"""A site under load: its services in one process or several, wrists, and an observer."""

import asyncio
import contextlib
import os
import time
from collections.abc import AsyncGenerator, Sequence

from pointit.runtime.bus.contract import Bus
from pointit.runtime.clock import WallClock
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch, run_services
from pointit.schemas.topics import IMU
from pointit_lab.loadtest.load_result import LoadResult, Usage
from pointit_lab.loadtest.sight import DRAIN_S, LoadTestReceiver
from pointit_lab.loadtest.usage import read_usage
from pointit_lab.loadtest.workers import READY_S, Group, Worker
from pointit_lab.loadtest.wrist import LoadTestWrist, drive_wrists


class LoadTest:
    """A site under load, ready to be measured."""

    def __init__(self, bus: Bus, local_group: Group, workers: Sequence[Worker], router: int | None) -> None:
        self._bus = bus
        self._workers = workers
        self._router = router
        self._local_group = local_group
        self._users = list(local_group.wrists)
        for worker in workers:
            self._users += worker.group.wrists
        self._sight = LoadTestReceiver(frozenset(self._users))
        self._wrists: list[LoadTestWrist] = []
        for index, user in enumerate(local_group.wrists):
            publisher = bus.publisher(IMU, user)
            self._wrists.append(LoadTestWrist(publisher, index))
        self._sight.watch(bus)
        self._sight.watch_light(bus)

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
                problem = f"{len(missing)} of {len(self._users)} people were not ready within {READY_S:g} s"
                raise ConfigError(f"{problem}; try fewer --users, or another --layout")
            await asyncio.sleep(0.05)

    async def measure(self, rate_hz: float, duration_s: float, layout: str) -> LoadResult:
        """Drive all wrists for `duration_s` and return the result."""
        self._sight.clear()
        before = read_usage()
        sent_before = sum(wrist.sent for wrist in self._wrists)
        router_before = read_usage(self._router) if self._router else None

        # The workers start together with this process, and answer when their wrists are done.
        start_s = time.monotonic()
        for worker in self._workers:
            worker.send_line({"rate_hz": rate_hz, "duration_s": duration_s})
        await drive_wrists(self._wrists, rate_hz, duration_s)
        answers = [await worker.answer() for worker in self._workers]
        lasted_s = time.monotonic() - start_s
        after = read_usage()
        await asyncio.sleep(DRAIN_S)

        sent = sum(wrist.sent for wrist in self._wrists) - sent_before
        usages: list[Usage] = []
        if before is not None and after is not None:
            own_cpu = (after.cpu_s - before.cpu_s) / lasted_s
            usages.append(Usage(name=self._local_group.name, cpu=own_cpu, memory_mb=after.memory_mb))
        for worker, answer in zip(self._workers, answers, strict=True):
            sent += answer["sent"]
            cpu = answer["cpu_s"] / lasted_s
            usage = Usage(name=worker.group.name, cpu=cpu, memory_mb=answer["memory_mb"])
            usages.append(usage)

        # The router also carries what still travels, so its usage is read after that.
        if router_before is not None:
            router_after = read_usage(self._router)
            if router_after is not None:
                router_cpu = (router_after.cpu_s - router_before.cpu_s) / lasted_s
                usages.append(Usage(name="router", cpu=router_cpu, memory_mb=router_after.memory_mb))

        load_average = None
        if hasattr(os, "getloadavg"):  # not on Windows
            load_average = round(os.getloadavg()[0], 1)
        return LoadResult(
            users=len(self._users),
            rate_hz=rate_hz,
            duration_s=duration_s,
            layout=layout,
            sent=sent,
            pointed=len(self._sight.cursor_s),
            hovered=self._sight.hovers,
            light_s=self._sight.light_s(),
            cursor_s=list(self._sight.cursor_s),
            processes=usages,
            load_average=load_average,
        )


@contextlib.asynccontextmanager
async def start_load_test(
    bus: Bus, local_group: Group, remote_groups: Sequence[Group], connect: str, router: int | None = None
) -> AsyncGenerator[LoadTest]:
    """Yield a site with all services running; processes join it at `connect`.

    Raises:
        ConfigError: If a process ended, or they were not ready in time.
    """
    async with contextlib.AsyncExitStack() as stack:
        services: asyncio.Task[None] | None = None
        if local_group.launches:
            services = await stack.enter_async_context(running(local_group.launches, bus))
        workers: list[Worker] = []
        stack.push_async_callback(_end_all, workers)
        for group in remote_groups:
            worker = await Worker.start(group, bus.site, connect)
            workers.append(worker)  # one by one, so that started ones are ended if the next one fails
        load_test = LoadTest(bus, local_group, workers, router)
        await load_test.until_ready(services)
        yield load_test


@contextlib.asynccontextmanager
async def running(launches: Sequence[Launch], bus: Bus) -> AsyncGenerator[asyncio.Task[None]]:
    """Run services on `bus`. Yield their task."""
    services = asyncio.create_task(run_services(launches, bus, WallClock()))
    try:
        yield services
    finally:
        services.cancel()
        await asyncio.wait({services})


async def _end_all(workers: Sequence[Worker]) -> None:
    endings = [worker.end() for worker in workers]
    await asyncio.gather(*endings)
