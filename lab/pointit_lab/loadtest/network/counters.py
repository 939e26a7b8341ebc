"""Counters of the messages on the links of a load test, one at each link's lower end."""

import asyncio
import json
import re
import socket
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pointit.runtime.errors import ConfigError
from pointit_lab.loadtest.network.namespaces import UPLINK, NamespaceNetwork

KIND = re.compile(rb"application/msgpack;([A-Z]\w+)\.v\d+")

OUTGOING = 4
"""`PACKET_OUTGOING`, packet(7)."""

ALL = 3
"""`ETH_P_ALL`."""

MAX_PACKET = 65_536

BUFFER = 8 * 1024 * 1024


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
    async def start(cls, network: NamespaceNetwork) -> "Counters":
        """Start one for each link, and wait until all are ready.

        Raises:
            ConfigError: If one ended.
        """
        names: dict[int, str] = {}
        for index in sorted(network.traffic()):
            names[index] = network.machines[index].name
        counters = cls(names)
        for index in names:
            command = network.arguments(index, sys.executable, "-m", __name__, UPLINK)
            counters._running[index] = await asyncio.create_subprocess_exec(
                *command,
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                process_group=0,
            )
        # Only now: the processes start beside each other.
        for index in names:
            await counters._line(index)
        return counters

    async def count(self, duration_s: float) -> dict[int, Contents]:
        """Count for `duration_s` from now on. Return what crossed, by the lower machine's index.

        Raises:
            ConfigError: If a counter ended: what it did not count is not known.
        """
        order = f"{duration_s}\n".encode()
        for counter in self._running.values():
            if counter.stdin is not None:
                counter.stdin.write(order)
        contents: dict[int, Contents] = {}
        for index in self._links:
            counted = json.loads(await self._line(index))
            contents[index] = Contents(**counted)
        endings = [counter.communicate() for counter in self._running.values()]
        await asyncio.gather(*endings)
        return contents

    async def _line(self, index: int) -> bytes:
        counter = self._running[index]
        line = b""
        if counter.stdout is not None:
            line = await counter.stdout.readline()
        if not line:
            code = await counter.wait()
            problem = f"what crosses the link of {self._links[index]} could not be counted"
            raise ConfigError(f"{problem}, as the counter ended with exit code {code}: see its output above")
        return line


def count(wire: socket.socket, duration_s: float) -> dict[str, Any]:
    """Return the time and the number of messages of each kind that left and entered by `wire`.

    A message's kind is in clear unless the link is encrypted; a name that a packet's end cuts is missed.
    """
    up = Counter[str]()
    down = Counter[str]()
    start_s = time.monotonic()
    end_s = start_s + duration_s
    while (remaining_s := end_s - time.monotonic()) > 0:
        wire.settimeout(remaining_s)
        try:
            packet, address = wire.recvfrom(MAX_PACKET)
        except TimeoutError:
            break
        _, _, direction, *_ = address
        kinds: list[bytes] = KIND.findall(packet)
        counter = up if direction == OUTGOING else down
        counter.update(kind.decode("ascii") for kind in kinds)
    counts: dict[str, list[int]] = {}
    for kind in sorted({*up, *down}):
        counts[kind] = [up[kind], down[kind]]
    return {"lasted_s": time.monotonic() - start_s, "counts": counts}


def _main(device: str) -> None:
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW) as wire:  # receives nothing until it is bound
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        sys.stdout.write("\n")
        sys.stdout.flush()
        line = sys.stdin.readline()
        if line:
            wire.bind((device, ALL))
            counted = count(wire, float(line))
            sys.stdout.write(json.dumps(counted) + "\n")


if __name__ == "__main__":
    _main(sys.argv[1])
