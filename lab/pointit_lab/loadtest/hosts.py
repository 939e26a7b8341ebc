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
        usage_samples: Mapping[int, int],
    ) -> None:
        """Prepare. `groups` and process ids of `usage_samples` are by machine."""
        self._network = network
        self._groups = groups
        self._routers = usage_samples
        self._workers: list[Worker] = []

    async def start(self, site: str) -> None:
        """Start all processes, and wait until they know all poses.

        Raises:
            ConfigError: If a process ended, or they were not ready in time.
        """
        for index, groups in self._groups.items():
            for group in groups:
                place = self._network.arguments(index)
                self._workers.append(await Worker.start(group, site, self._network.endpoint(index), place))
        try:
            async with asyncio.timeout(READY_S):
                await self._order({})
        except TimeoutError:
            raise ConfigError(
                f"the hosts were not ready within {READY_S:g} s; try fewer --users or --hosts"
            ) from None

    async def until_carried(self, rate_hz: float, duration_s: float) -> None:
        """Drive all wrists until cursors follow at each host, and light at the site.

        Raises:
            ConfigError: If that exceeds `READY_S`.
        """
        try:
            async with asyncio.timeout(READY_S):
                while True:
                    answers = await self._order({"rate_hz": rate_hz, "duration_s": duration_s})
                    sights = zip(self._workers, (answer["sight"] for answer in answers), strict=True)
                    if all(
                        (sight["stamps"] or not worker.group.watched)
                        and (sight["frames"] or not worker.group.watches_light)
                        for worker, sight in sights
                    ):
                        return
        except TimeoutError:
            raise ConfigError(f"no light followed any sample within {READY_S:g} s") from None

    async def measure(self, rate_hz: float, duration_s: float, layout: str) -> LoadResult:
        """Drive all wrists for `duration_s` and return the result. Count then what the links carry.

        Raises:
            ConfigError: If a process has ended.
        """
        order = {"rate_hz": rate_hz, "duration_s": duration_s}
        before = self._used()
        answers, after = await asyncio.gather(self._order(order), self._used_in(duration_s))
        lasted_s = after.at_s - before.at_s
        processes = [
            Usage(
                name=worker.group.name,
                cpu=answer["cpu_s"] / answer["lasted_s"],
                memory_mb=answer["memory_mb"],
            )
            for worker, answer in zip(self._workers, answers, strict=True)
        ]
        for index, now in after.routers.items():
            cpu = (now.cpu_s - before.routers[index].cpu_s) / lasted_s
            name = f"router {self._network.machines[index].name}"
            processes.append(Usage(name=name, cpu=cpu, memory_mb=now.memory_mb))
        load_average = round(os.getloadavg()[0], 1)
        sight = LoadTestReceiver(frozenset())
        for answer in answers:
            sight.add(answer["sight"])
        contents = await self._contents(rate_hz)
        users = sum(len(worker.group.wrists) for worker in self._workers)
        return LoadResult(
            users=users,
            rate_hz=rate_hz,
            duration_s=duration_s,
            layout=layout,
            sent=sum(answer["sent"] for answer in answers),
            pointed=len(sight.cursor_s),
            arrived=sight.arrived,
            hovered=sight.hovers,
            light_s=sight.light_s(),
            cursor_s=sight.cursor_s,
            processes=processes,
            load_average=load_average,
            lacking=self._network.lacking,
            hosts=sum(machine.has_people for machine in self._network.machines),
            links=[
                self._link(index, before.traffic[index], after.traffic[index], lasted_s, contents[index])
                for index in before.traffic
            ],
        )

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
        found = {index: read_usage(pid) for index, pid in self._routers.items()}
        return _Used(
            at_s=asyncio.get_running_loop().time(),
            routers={index: usage for index, usage in found.items() if usage is not None},
            traffic=self._network.traffic(),
        )

    def _link(
        self,
        index: int,
        before: NamespaceTraffic,
        after: NamespaceTraffic,
        lasted_s: float,
        contents: Contents,
    ) -> LinkUsage:
        machines = self._network.machines
        return LinkUsage(
            name=f"{machines[index].name} > {machines[machines[index].uplink].name}",
            up_bytes_hz=(after.up_bytes - before.up_bytes) / lasted_s,
            up_packets_hz=(after.up_packets - before.up_packets) / lasted_s,
            down_bytes_hz=(after.down_bytes - before.down_bytes) / lasted_s,
            down_packets_hz=(after.down_packets - before.down_packets) / lasted_s,
            up_hz={kind: up / contents.lasted_s for kind, (up, _) in contents.counts.items() if up},
            down_hz={kind: down / contents.lasted_s for kind, (_, down) in contents.counts.items() if down},
            counted_s=contents.lasted_s,
        )

    async def _contents(self, rate_hz: float) -> dict[int, Contents]:
        """Return the messages on each link in `CONTENTS_S`."""
        if not self._network.traffic():
            return {}
        counters = await Counters.start(self._network)
        order = {"rate_hz": rate_hz, "duration_s": CONTENTS_S + MARGIN_S}
        contents: dict[int, Contents]
        _, contents = await asyncio.gather(self._order(order), counters.count(CONTENTS_S))
        return contents


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
        usage_samples: dict[int, int] = {}
        for index, machine in enumerate(network.machines):
            if not machine.has_router:
                continue
            listen = network.listen(index)
            uplinks = [network.uplink(index)] if index else []
            if site_folder is None:
                made = plain_configuration(listen, uplinks)
            else:
                made = secured_configuration(site_folder, uplinks, int(listen.rpartition(":")[2]))
            usage_samples[index] = await stack.enter_async_context(
                router_process(made, program, folder / str(index), network.arguments(index))
            )
        test = HostsTest(network, groups, usage_samples)
        stack.push_async_callback(test.end)
        await test.start(site)
        yield test
