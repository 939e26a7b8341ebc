"""Counters of the messages on the links of a load test, one at each link's lower end."""

import asyncio
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from pointit.runtime.errors import ConfigError
from pointit_lab.loadtest.network import link_contents
from pointit_lab.loadtest.network.namespaces import UPLINK, Network


@dataclass(frozen=True, kw_only=True)
class Contents:
    """Messages on a link while they were counted."""

    lasted_s: float
    counts: Mapping[str, Sequence[int]] = field(default_factory=dict[str, Sequence[int]])
    """Number by kind, up and down."""


class Counters:
    """Counters that are ready: what crosses from now on is counted as soon as they are told."""

    def __init__(self, links: Mapping[int, str]) -> None:
        self._links = links
        self._running: dict[int, asyncio.subprocess.Process] = {}

    @classmethod
    async def start(cls, network: Network) -> "Counters":
        """Start one for each link, and wait until all are ready.

        Raises:
            ConfigError: If one ended.
        """
        machines = network.machines
        made = cls({index: machines[index].name for index in sorted(network.traffic())})
        for index in made._links:
            made._running[index] = await asyncio.create_subprocess_exec(
                *network.arguments(index, sys.executable, "-m", link_contents.__name__, UPLINK),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                process_group=0,
            )
        for index in made._links:
            await made._line(index)
        return made

    async def count(self, duration_s: float) -> dict[int, Contents]:
        """Count for `duration_s` from now on. Return what crossed, by the lower machine's index.

        Raises:
            ConfigError: If a counter ended: what it did not count is not known.
        """
        for counter in self._running.values():
            if counter.stdin is not None:
                counter.stdin.write(f"{duration_s}\n".encode())
        told = {index: json.loads(await self._line(index)) for index in self._links}
        await asyncio.gather(*(counter.communicate() for counter in self._running.values()))
        return {index: Contents(**each) for index, each in told.items()}

    async def _line(self, index: int) -> bytes:
        counter = self._running[index]
        line = b"" if counter.stdout is None else await counter.stdout.readline()
        if not line:
            raise ConfigError(
                f"what crosses the link of {self._links[index]} could not be counted, as the counter ended "
                f"with exit code {await counter.wait()}: see its output above"
            )
        return line
