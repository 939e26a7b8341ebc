"""A wrist at a UDP port: of all that waits, each event and the newest orientations are delivered at once."""

import asyncio
from abc import ABC, abstractmethod

from pointit.runtime.address_config import is_loopback
from pointit.runtime.clock import Clock, Timer
from pointit.runtime.service.surroundings import HealthSink
from pointit.services.imu_bridge.network.udp_server import ANY_HOST, Address, DatagramLimit, UdpServer
from pointit.services.imu_bridge.reading import Deliver, Item, Reading

PERIOD_S = 0.002
"""Shortest time between two orientations that are delivered, s. imu-bridge refuses more than 1000 items a
second, events among them."""


class PortSource(ABC):
    """Receives the datagrams of one sender, and limits those of all."""

    def __init__(
        self,
        name: str,
        place: tuple[str, int],
        clock: Clock,
        health: HealthSink,
        *,
        remedy: str,
        is_shared: bool = False,
    ) -> None:
        """Listen at `place`, a host and a port, once it runs.

        `name` is the plug-in's. `remedy` and `is_shared`: see `UdpServer`.
        """
        self._name = name
        self._clock = clock
        self._health = health
        self._limit, self._limit_of_others = DatagramLimit(), DatagramLimit()
        self._server = UdpServer(
            *place, health, self._on_datagram, self._on_read, remedy=remedy, is_shared=is_shared
        )
        self._is_local = is_loopback(place[0])
        self._newest: Reading | None = None
        """Orientation that is not delivered yet."""
        self._delivered_s = 0.0

    async def run(self, deliver: Deliver) -> None:
        """Deliver readings until cancelled."""
        self._deliver = deliver
        self._timer = Timer(asyncio.get_running_loop().call_later, self._deliver_newest)
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._server.run())
                await self._watch()
        finally:
            self._timer.cancel()

    @abstractmethod
    async def _watch(self) -> None:
        """Report warnings until cancelled."""

    @abstractmethod
    def _is_used(self, address: Address) -> bool:
        """Return True if `address` is that of the sender in use."""

    @abstractmethod
    def _take(self, data: bytes, address: Address, now_s: float) -> None:
        """Deliver the readings in a datagram of an admitted sender."""

    def _on_datagram(self, data: bytes, address: Address) -> None:
        now_s = asyncio.get_running_loop().time()
        if (self._limit if self._is_used(address) else self._limit_of_others).admits(now_s):
            self._take(data, address, now_s)

    def _pass_on(self, item: Item) -> None:
        """Deliver `item`; an orientation only if none follows it at once, since the newest counts."""
        if isinstance(item, Reading):
            self._newest = item
            return
        self._deliver_newest()  # that at which the button was pressed, or of the connection before
        self._deliver(item)

    def _on_read(self) -> None:
        """Deliver the newest orientation, or a little later if one was delivered just now."""
        if self._newest is not None:
            wait_s = self._delivered_s + PERIOD_S - asyncio.get_running_loop().time()
            if wait_s > 0.0:
                self._timer.start(wait_s)
            else:
                self._deliver_newest()

    def _deliver_newest(self) -> None:
        newest, self._newest = self._newest, None
        if newest is not None:
            self._delivered_s = asyncio.get_running_loop().time()
            self._deliver(newest)

    def _warn_flood(self, sender: str, now_s: float) -> None:
        problem = self._limit.problem(now_s)
        self._health.warn("flood", f"{sender} {problem}" if problem else "")

    @property
    def _only_here(self) -> str:
        """Return a clause about the networks that are not heard, or `""`."""
        remedy = f"set {self._name}.host={ANY_HOST} for devices of the network"
        return f"; only this machine is heard there, {remedy}" if self._is_local else ""
