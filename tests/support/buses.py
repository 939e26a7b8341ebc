"""Participants of a site on every kind of bus, and a router that can be killed."""

import asyncio
import contextlib
import fcntl
import itertools
import os
import secrets
import signal
import socket
import tempfile
import time
from collections.abc import AsyncGenerator, AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest_asyncio

from pointit.runtime.bus.contract import Bus
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.link.link import Link
from pointit.runtime.router import running_router
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas.table_types import PresenceHandler
from pointit.schemas.topics import SERVICE_ALIVE
from tests.simulation.kernel.process import Host
from tests.simulation.kernel.simulation import Simulation
from tests.simulation.network.network import Network
from tests.simulation.network.simulated_bus import SimulatedBus
from tests.support.bench import until
from tests.support.forked import ForkedProcess

KINDS = ("memory", "simulated", "zenoh-peer", "zenoh-router")
"""In one process; on the network of simulations; clients of a listening process; clients of a router."""

TEST_PORTS = range(15000, 32000)
"""Ports below those that Linux gives to who asks for any (`net.ipv4.ip_local_port_range`)."""
PORT_LOCKS = Path(tempfile.gettempdir(), "pointit-test-ports")

_marks = itertools.count()


@dataclass(frozen=True)
class Site:
    """Three participants of one site."""

    kind: str
    a: Bus
    b: Bus
    c: Bus

    @property
    def buses(self) -> tuple[Bus, Bus, Bus]:
        return (self.a, self.b, self.c)

    async def settle(self) -> None:
        """Return when each declaration is known to all (declarations travel in order)."""
        await settled(*self.buses)


async def settled(*buses: Bus) -> None:
    """Return when everybody sees a token that everybody else has announced just now."""
    mark = f"settle.{next(_marks)}"
    names = {f"{mark}.{index}" for index in range(len(buses))}
    seen: list[set[str]] = [set() for _ in buses]
    watches = [bus.watch(SERVICE_ALIVE, _adder(mine)) for bus, mine in zip(buses, seen, strict=True)]
    tokens = [bus.announce(SERVICE_ALIVE, f"{mark}.{index}") for index, bus in enumerate(buses)]
    await until(lambda: all(names <= mine for mine in seen), what="the participants to see each other")
    for declared in (*watches, *tokens):
        declared.close()


def _adder(names: set[str]) -> PresenceHandler:
    return lambda name, **_: names.add(name)


@asynccontextmanager
async def site_of(kind: str, name: str = "lab") -> AsyncGenerator[Site]:
    """Yield three participants, joined as `kind` says."""
    async with contextlib.AsyncExitStack() as stack:
        buses: list[Bus] = []
        if kind == "memory":
            exchange = LocalBroker()
            buses = [MemoryBus(exchange) for _ in range(3)]
        elif kind == "simulated":
            buses = _simulated_buses(name)
        else:
            endpoint = (f"tcp/127.0.0.1:{free_port()}",)
            links = [Link(site=name, connect=endpoint)] * 3
            if kind == "zenoh-peer":
                links[0] = Link(site=name, listen=endpoint)
            else:
                await stack.enter_async_context(running_router(endpoint))
            for link in links:
                buses.append(await ZenohBus.open(link, patience_s=30))
        for bus in buses:
            stack.push_async_callback(bus.close)
        yield Site(kind, *buses)


def _simulated_buses(name: str) -> list[Bus]:
    """Return the buses of three processes on three machines."""
    simulation = Simulation(asyncio.get_running_loop(), seed=1)
    network = Network(simulation)
    buses: list[Bus] = []
    for host in ("a", "b", "c"):
        process = simulation.start_process(host, Host(host, simulation))
        buses.append(process.context.run(SimulatedBus, network, process, name))
    return buses


def free_port() -> int:
    """Return a free port of 127.0.0.1, which no other test gets while this process lives."""
    return _reserved_port(socket.SOCK_STREAM)


def free_udp_port() -> int:
    """Return a free UDP port of 127.0.0.1, which no other test gets while this process lives."""
    return _reserved_port(socket.SOCK_DGRAM)


def _reserved_port(kind: socket.SocketKind) -> int:
    """Lock a port among the tests of this machine, in all their processes.

    The system gives none of these to who asks for any port, so that none is taken before it is used.
    """
    PORT_LOCKS.mkdir(exist_ok=True)
    while True:
        port = secrets.choice(TEST_PORTS)
        lock = os.open(PORT_LOCKS / f"{port}", os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # until this process ends
            with socket.socket(socket.AF_INET, kind) as probe:
                probe.bind(("127.0.0.1", port))
        except OSError:
            os.close(lock)
        else:
            return port


def is_listening(port: int, host: str = "127.0.0.1") -> bool:
    """Return True if something listens at `port` of an address of this machine."""
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        return probe.connect_ex((host, port)) == 0


class RouterProcess:
    """`pointit router` in a process of its own, always on the same port."""

    def __init__(self) -> None:
        self.port = free_port()
        self.endpoint = f"tcp/127.0.0.1:{self.port}"
        self._folder = tempfile.TemporaryDirectory()
        self._process: ForkedProcess | None = None

    def start(self) -> None:
        """Start it and wait until it listens."""
        out, err = (Path(self._folder.name, f"{name}{next(_marks)}") for name in ("out", "err"))
        self._process = ForkedProcess(["router", "--listen", self.endpoint], out, err, os.environ)
        self._process.says(self.endpoint)

    def freeze(self) -> None:
        """Let it do nothing until it is stopped: what it gets is lost then."""
        assert self._process is not None
        self._process.send_signal(signal.SIGSTOP)

    def stop(self, number: int = signal.SIGKILL) -> float:
        """Send a signal; return how long the process took to end, s."""
        process = self._process
        self._process = None
        if process is None:
            return 0.0
        began_s = time.monotonic()
        process.send_signal(number)
        assert process.wait(10) is not None
        return time.monotonic() - began_s

    def close(self) -> None:
        """Delete what it has printed."""
        self._folder.cleanup()


@asynccontextmanager
async def router_process() -> AsyncGenerator[RouterProcess]:
    """Yield a running router that may be killed and started again."""
    router = RouterProcess()
    await asyncio.to_thread(router.start)
    try:
        yield router
    finally:
        router.stop()
        router.close()


@pytest_asyncio.fixture
async def bus() -> AsyncIterator[MemoryBus]:
    bus = MemoryBus()
    yield bus
    await bus.close()
