"""A site over several hosts under load: people and their services at each, shared services at the first."""

import asyncio
import contextlib
import os
from collections.abc import AsyncGenerator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pointit.access.site_folder import SiteFolder
from pointit.runtime.errors import ConfigError
from pointit_lab.loadtest.load_result import LinkUsage, LoadResult, Usage
from pointit_lab.loadtest.network.counters import Contents, Counters
from pointit_lab.loadtest.network.namespaces import NamespaceNetwork, NamespaceTraffic
from pointit_lab.loadtest.network.routers import (
    Program,
    plain_configuration,
    router_process,
    secured_configuration,
)
from pointit_lab.loadtest.sight import LoadTestReceiver
from pointit_lab.loadtest.usage import UsageSample, read_usage
from pointit_lab.loadtest.workers import READY_S, Group, Worker

CONTENTS_S = 2.0
"""Time in which the messages on the links are counted, after the measurement: counting takes CPU."""
MARGIN_S = 0.5
"""Time that the wrists are driven longer, as the counters may be told a little later."""


@dataclass(frozen=True, kw_only=True)
class _Used:
    """Usage of routers and links so far, by machine."""

    at_s: float
    routers: Mapping[int, UsageSample]
    traffic: Mapping[int, NamespaceTraffic]


class HostsTest:
    """A site over several hosts, ready to be measured."""

    def __init__(
        self,
        network: NamespaceNetwork,
        groups: Mapping[int, Sequence[Group]],
        routers: Mapping[int, int],
    ) -> None:
        """Prepare. `groups` and the process ids of `routers` are by machine."""
        self._network = network
        self._groups = groups
        self._routers = routers
        self._workers: list[Worker] = []

    async def start(self, site: str) -> None:
        """Start all processes, and wait until they know all poses.

        Raises:
            ConfigError: If a process ended, or they were not ready in time.
        """
        for index, groups in self._groups.items():
            place = self._network.arguments(index)
            for group in groups:
                endpoint = self._network.endpoint(index)
                worker = await Worker.start(group, site, endpoint, place)
                self._workers.append(worker)
        try:
            async with asyncio.timeout(READY_S):
                await self._order({})
        except TimeoutError:
            problem = f"the hosts were not ready within {READY_S:g} s"
            raise ConfigError(f"{problem}; try fewer --users or --hosts") from None

    async def until_carried(self, rate_hz: float, duration_s: float) -> None:
        """Drive all wrists until cursors follow at each host, and light at the site.

        Raises:
            ConfigError: If that exceeds `READY_S`.
        """
        order = {"rate_hz": rate_hz, "duration_s": duration_s}
        is_carried = False
        try:
            async with asyncio.timeout(READY_S):
                while not is_carried:
                    answers = await self._order(order)
                    pairs = zip(self._workers, answers, strict=True)
                    is_carried = all(_has_seen_all(worker.group, answer["sight"]) for worker, answer in pairs)
        except TimeoutError:
            raise ConfigError(f"no light followed any sample within {READY_S:g} s") from None

    async def measure(self, rate_hz: float, duration_s: float, layout: str) -> LoadResult:
        """Drive all wrists for `duration_s` and return the result. Count then what the links carry.

        Raises:
            ConfigError: If a process has ended.
        """
        # Routers and links are read at both ends of the measuring time, while the workers drive the wrists.
        order = {"rate_hz": rate_hz, "duration_s": duration_s}
        before = self._used()
        answers, after = await asyncio.gather(self._order(order), self._used_in(duration_s))
        processes = self._processes(answers, before, after)
        load_average = round(os.getloadavg()[0], 1)
        sight = LoadTestReceiver(frozenset())
        for answer in answers:
            sight.add(answer["sight"])

        # Counting the messages costs CPU, so it comes after everything that is measured.
        contents = await self._contents(rate_hz)
        lasted_s = after.at_s - before.at_s
        links: list[LinkUsage] = []
        for index, traffic in before.traffic.items():
            link = self._link(index, traffic, after.traffic[index], lasted_s, contents[index])
            links.append(link)
        users = sum(len(worker.group.wrists) for worker in self._workers)
        sent = sum(answer["sent"] for answer in answers)
        hosts = sum(machine.has_people for machine in self._network.machines)
        return LoadResult(
            users=users,
            rate_hz=rate_hz,
            duration_s=duration_s,
            layout=layout,
            sent=sent,
            pointed=len(sight.cursor_s),
            arrived=sight.arrived,
            hovered=sight.hovers,
            light_s=sight.light_s(),
            cursor_s=sight.cursor_s,
            processes=processes,
            load_average=load_average,
            lacking=self._network.lacking,
            hosts=hosts,
            links=links,
        )

    def _processes(
        self, answers: Sequence[Mapping[str, Any]], before: "_Used", after: "_Used"
    ) -> list[Usage]:
        """Return the usage of all workers, and of the routers between two times."""
        # A worker measures its own time: it starts and ends a little later than this process.
        processes: list[Usage] = []
        for worker, answer in zip(self._workers, answers, strict=True):
            cpu = answer["cpu_s"] / answer["lasted_s"]
            usage = Usage(name=worker.group.name, cpu=cpu, memory_mb=answer["memory_mb"])
            processes.append(usage)
        lasted_s = after.at_s - before.at_s
        for index, router in after.routers.items():
            cpu_s = router.cpu_s - before.routers[index].cpu_s
            name = f"router {self._network.machines[index].name}"
            usage = Usage(name=name, cpu=cpu_s / lasted_s, memory_mb=router.memory_mb)
            processes.append(usage)
        return processes

    async def end(self) -> None:
        """End all processes."""
        await asyncio.gather(*(worker.end() for worker in self._workers))

    async def _order(self, order: Mapping[str, Any]) -> list[dict[str, Any]]:
        for worker in self._workers:
            worker.send_line(dict(order))
        return [await worker.answer() for worker in self._workers]

    async def _used_in(self, duration_s: float) -> "_Used":
        await asyncio.sleep(duration_s)
        return self._used()

    def _used(self) -> "_Used":
        routers: dict[int, UsageSample] = {}
        for index, pid in self._routers.items():
            usage = read_usage(pid)
            if usage is not None:
                routers[index] = usage
        at_s = asyncio.get_running_loop().time()
        return _Used(at_s=at_s, routers=routers, traffic=self._network.traffic())

    def _link(
        self,
        index: int,
        before: NamespaceTraffic,
        after: NamespaceTraffic,
        lasted_s: float,
        contents: Contents,
    ) -> LinkUsage:
        lower = self._network.machines[index]
        upper = self._network.machines[lower.uplink]
        up_bytes = after.up_bytes - before.up_bytes
        up_packets = after.up_packets - before.up_packets
        down_bytes = after.down_bytes - before.down_bytes
        down_packets = after.down_packets - before.down_packets

        # The messages were counted later than the bytes, in a time of their own.
        up_hz: dict[str, float] = {}
        down_hz: dict[str, float] = {}
        for kind, (up, down) in contents.counts.items():
            if up:
                up_hz[kind] = up / contents.lasted_s
            if down:
                down_hz[kind] = down / contents.lasted_s
        return LinkUsage(
            name=f"{lower.name} > {upper.name}",
            up_bytes_hz=up_bytes / lasted_s,
            up_packets_hz=up_packets / lasted_s,
            down_bytes_hz=down_bytes / lasted_s,
            down_packets_hz=down_packets / lasted_s,
            up_hz=up_hz,
            down_hz=down_hz,
            counted_s=contents.lasted_s,
        )

    async def _contents(self, rate_hz: float) -> dict[int, Contents]:
        """Return the messages on each link in `CONTENTS_S`."""
        if not self._network.traffic():
            return {}
        counters = await Counters.start(self._network)
        # driven longer than counted: the counters may be told a little later
        order = {"rate_hz": rate_hz, "duration_s": CONTENTS_S + MARGIN_S}
        contents: dict[int, Contents]
        _, contents = await asyncio.gather(self._order(order), counters.count(CONTENTS_S))
        return contents


def _has_seen_all(group: Group, sight: Mapping[str, Any]) -> bool:
    """Return True if a worker has seen the cursors and the light that it is to watch."""
    has_cursors = sight["stamps"] or not group.watched
    has_light = sight["frames"] or not group.watches_light
    return bool(has_cursors and has_light)


@contextlib.asynccontextmanager
async def start_hosts_test(
    network: NamespaceNetwork,
    groups: Mapping[int, Sequence[Group]],
    *,
    site: str,
    program: Program,
    folder: Path,
    site_folder: SiteFolder | None,
) -> AsyncGenerator[HostsTest]:
    """Yield the site with all services running.

    Args:
        network: the machines.
        groups: processes by machine.
        site: name of the site.
        program: what routes.
        folder: for the routers' files.
        site_folder: certificates of the site, if its routers require them.

    Raises:
        ConfigError: If a process ended, or they were not ready in time.
    """
    async with contextlib.AsyncExitStack() as stack:
        # Routers start first, the root before those that join it.
        router_pids: dict[int, int] = {}
        for index, machine in enumerate(network.machines):
            if not machine.has_router:
                continue
            listen = network.listen(index)
            uplinks = [network.uplink(index)] if index else []
            if site_folder is None:
                configuration = plain_configuration(listen, uplinks)
            else:
                _, _, port = listen.rpartition(":")
                configuration = secured_configuration(site_folder, uplinks, int(port))
            place = network.arguments(index)
            router = router_process(configuration, program, folder / str(index), place)
            router_pids[index] = await stack.enter_async_context(router)

        # `end` is pushed before `start`: workers that have started are ended if another one fails.
        test = HostsTest(network, groups, router_pids)
        stack.push_async_callback(test.end)
        await test.start(site)
        yield test
