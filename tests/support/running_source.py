"""A source that runs beside phones on sockets of this machine."""

import asyncio
import contextlib
from collections.abc import AsyncGenerator, Callable
from dataclasses import dataclass, field
from typing import Any

from pointit.plugins import ImuSource, Item, Surroundings
from pointit.runtime.clock import WallClock
from pointit.runtime.service.plugin_guard import NullHealth
from tests.support.buses import free_udp_port


class Health(NullHealth):
    """Health whose present warnings and metrics can be read."""

    def __init__(self) -> None:
        self.warnings: dict[str, str] = {}
        self.metrics: dict[str, float] = {}

    def warn(self, code: str, sentence: str, subject: str = "") -> None:
        self.clear(code, subject)
        if sentence:
            key = f"{code} {subject}".rstrip()
            self.warnings[key] = sentence

    def clear(self, code: str, subject: str = "") -> None:
        key = f"{code} {subject}".rstrip()
        self.warnings.pop(key, None)

    def set_metric(self, name: str, value: float | None, unit: str = "") -> None:
        del unit
        self.metrics.pop(name, None)
        if value is not None:
            self.metrics[name] = value


@dataclass
class Running:
    """A source, what it shows, and what it has delivered."""

    source: Any
    port: int
    """UDP port, or 0 if it has none."""
    warnings: dict[str, str]
    metrics: dict[str, float]
    items: list[Item] = field(default_factory=list[Item])

    def of(self, kind: type[Any]) -> list[Any]:
        return [item for item in self.items if isinstance(item, kind)]


@contextlib.asynccontextmanager
async def running(plugin: ImuSource, **parameters: object) -> AsyncGenerator[Running]:
    """Run a source, by default at a free UDP port."""
    port = parameters.setdefault("port", free_udp_port())
    health = Health()
    folder = Surroundings.detached().folder
    around = Surroundings(clock=WallClock(), health=health, folder=folder, user="anna")
    config = plugin.config.model_validate(parameters)
    source = plugin.make(config, around)
    udp_port = port if isinstance(port, int) else 0
    found = Running(source, udp_port, health.warnings, health.metrics)
    task = asyncio.create_task(source.run(found.items.append))
    try:
        yield found
    finally:
        task.cancel()
        await asyncio.wait({task})
    assert task.cancelled()


class Phone(asyncio.DatagramProtocol):
    """A sender of datagrams that remembers what it hears."""

    def __init__(self, port: int) -> None:
        self._port = port
        self.heard: list[bytes] = []
        self.transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.DatagramTransport) -> None:
        self.transport = transport

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        del addr
        self.heard.append(data)

    def say(self, data: bytes, host: str = "127.0.0.1") -> None:
        assert self.transport is not None
        self.transport.sendto(data, (host, self._port))

    @property
    def port(self) -> int:
        assert self.transport is not None
        return int(self.transport.get_extra_info("sockname")[1])

    def saying(self, data: bytes, condition: Callable[[], bool]) -> Callable[[], bool]:
        """Return `condition` as one that sends `data` each time before."""

        def said() -> bool:
            self.say(data)
            return condition()

        return said

    def of_kind(self, kind: int) -> list[bytes]:
        return [data for data in self.heard if int.from_bytes(data[:4]) == kind]


@contextlib.asynccontextmanager
async def phone_at(port: int, host: str = "127.0.0.1") -> AsyncGenerator[Phone]:
    """Open a phone's socket at `host`, from which it sends to `port`."""
    loop = asyncio.get_running_loop()
    transport, phone = await loop.create_datagram_endpoint(
        lambda: Phone(port), local_addr=(host, 0), allow_broadcast=True
    )
    try:
        yield phone
    finally:
        transport.abort()
        await asyncio.sleep(0)
