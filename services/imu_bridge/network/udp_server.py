"""A UDP port that is opened again after errors, and a wrist that sends to it.

No core: it waits for datagrams.
"""

import asyncio
import contextlib
import socket
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Container

from pointit.runtime.address_config import format_address, is_loopback
from pointit.runtime.clock import Clock, Timer
from pointit.runtime.config.parameters import set_option
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.plugin_guard import HealthSink, NullHealth, WarningSink
from pointit.schemas.text import system_reason
from pointit.services.imu_bridge.sources import Deliver, Item, Reading

Address = tuple[str, int]
SocketAddress = tuple[str, int] | tuple[str, int, int, int]
MAPPED = "::ffff:"
"""Beginning of an address of IPv4 at a socket of IPv6 (RFC 4291, 2.5.5.2)."""
LONGEST_DATAGRAM = 65536
MAX_AT_ONCE = 512
"""Datagrams that are read before other work of the loop has its turn. Linux keeps about 300 small ones."""
RETRY_S = 2.0
"""Wait before a port is opened again, s."""
ANY_HOST = "0.0.0.0"  # noqa: S104 - no default of any parameter
"""Host of all networks of this machine."""

PERIOD_S = 0.002
"""Shortest time between two orientations that are delivered, s. imu-bridge refuses more than 1000 items a
second, events among them."""


class UdpServer(asyncio.DatagramProtocol):
    """Receives datagrams at a port, and sends from it."""

    def __init__(
        self,
        host: str,
        port: int,
        health: WarningSink,
        on_datagram: Callable[[bytes, Address], None],
        on_read: Callable[[], None] = lambda: None,
        *,
        remedy: str,
        is_shared: bool = False,
    ) -> None:
        """Listen at `host`, of which the port 0 is any free one.

        `on_datagram` is called with each datagram, and `on_read` after all that waited. `remedy` says what to
        do if the port is taken. `is_shared`: other programs of this user may open it, too, if they share it
        as well; each gets all broadcasts, and one of them the rest, unless one has connected to the sender.
        Windows shares none.
        """
        self._host = host
        self._port = port
        self._health = health
        self._on_datagram = on_datagram
        self._on_read = on_read
        self._remedy = remedy
        self._is_shared = is_shared and hasattr(socket, "SO_REUSEPORT")

        # The open port
        self._transport: asyncio.DatagramTransport | None = None
        self._waiting: socket.socket | None = None
        """The server's socket, of which the loop itself reads one datagram a turn."""
        self._lost: asyncio.Future[None] | None = None
        self._links: dict[Address, socket.socket] = {}
        """Sockets at the shared port. Each is connected to one sender and gets only its datagrams."""

    @property
    def place(self) -> str:
        """Return host and port, for people."""
        return format_address(self._host, self._port)

    async def run(self) -> None:
        """Listen until cancelled."""
        loop = asyncio.get_running_loop()
        reuse_port = self._is_shared or None
        while True:
            # Open the port, again and again while another program has it
            self._lost = loop.create_future()
            try:
                transport, _ = await loop.create_datagram_endpoint(
                    lambda: self, local_addr=(self._host, self._port), reuse_port=reuse_port
                )
            except OSError as error:
                self._warn(error)
                await asyncio.sleep(RETRY_S)
                continue

            # Serve it until it is lost
            self._health.clear("port")
            self._transport = transport
            try:
                if sys.platform != "win32":  # there the loop waits by reading: the next one would come late
                    self._waiting = transport.get_extra_info("socket").dup()
                await self._lost
            except OSError as error:
                self._warn(error)
                await asyncio.sleep(RETRY_S)
            finally:
                self._transport = None
                if self._waiting is not None:
                    self._waiting.close()
                    self._waiting = None
                self.disconnect_others(())
                transport.abort()

    def connect(self, address: Address) -> None:
        """Get what comes from `address`, though others share the port."""
        if self._transport is None:
            return
        if not self._is_shared or address in self._links:
            return
        server = self._transport.get_extra_info("socket")
        link = socket.socket(server.family, socket.SOCK_DGRAM)
        try:
            link.setblocking(False)
            link.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
            link.bind(server.getsockname())
            link.connect(_socket_address(address, server.family))
        except OSError:  # what comes from there may still arrive at the server
            link.close()
            return
        self._links[address] = link
        asyncio.get_running_loop().add_reader(link, self._read_datagrams, link)

    def disconnect_others(self, addresses: Container[Address]) -> None:
        """End what `connect` has begun, but for `addresses`."""
        for address in [*self._links]:
            if address in addresses:
                continue
            link = self._links.pop(address)
            asyncio.get_running_loop().remove_reader(link)
            link.close()

    def _read_datagrams(self, waiting: socket.socket) -> None:
        for _ in range(MAX_AT_ONCE):
            try:
                data, sender = waiting.recvfrom(LONGEST_DATAGRAM)
            except OSError:  # all datagrams are read, or the sender has closed its port
                break
            self._on_datagram(data, _address(sender))  # another's, if it came before `connect`
        self._on_read()

    def send(self, data: bytes, address: Address) -> None:
        """Send a datagram, or nothing while the port is closed."""
        if address in self._links:
            with contextlib.suppress(OSError):
                self._links[address].send(data)
        elif self._transport is not None:
            with contextlib.suppress(OSError):  # a lost datagram, as any other
                family = self._transport.get_extra_info("socket").family
                self._transport.sendto(data, _socket_address(address, family))

    def datagram_received(self, data: bytes, addr: SocketAddress) -> None:
        """Pass a datagram on, and those that wait behind it."""
        self._on_datagram(data, _address(addr))
        if self._waiting is None:
            self._on_read()
        else:
            self._read_datagrams(self._waiting)

    def error_received(self, exc: Exception) -> None:
        """Ignore an undelivered datagram. A sender that is gone falls silent, which is reported."""

    def connection_lost(self, exc: Exception | None) -> None:
        """Open the port again."""
        if self._lost is not None and not self._lost.done():
            error = exc if isinstance(exc, OSError) else OSError("the port was closed")
            self._lost.set_exception(error)
            self._lost.exception()  # marks the error as retrieved if no caller waits for it

    def _warn(self, error: OSError) -> None:
        reason = system_reason(error)
        self._health.warn("port", f"UDP port {self.place} cannot be opened ({reason}): {self._remedy}")


def _address(sender: SocketAddress) -> Address:
    """Return an address of IPv4 also at a socket of IPv6, and a link-local one with its interface."""
    host, port, *rest = sender
    if len(rest) == 2 and rest[1]:
        host = f"{host}%{socket.if_indextoname(rest[1])}"
    if "." in host:
        host = host.removeprefix(MAPPED)
    return host, port


def _socket_address(address: Address, family: socket.AddressFamily) -> SocketAddress:
    """Return `address` as a socket of this `family` takes it. Raises OSError if there is no such link."""
    host, port = address
    if family != socket.AF_INET6:
        return address
    if ":" not in host:
        host = f"{MAPPED}{host}"
    host, _, link = host.partition("%")
    scope = socket.if_nametoindex(link) if link else 0
    return host, port, 0, scope


class _Problem(NullHealth):
    """Health that remembers why the port cannot be opened."""

    sentence = ""

    def warn(self, code: str, sentence: str, subject: str = "") -> None:  # noqa: ARG002 - the protocol's signature
        self.sentence = sentence

    def clear(self, code: str, subject: str = "") -> None:  # noqa: ARG002 - the protocol's signature
        self.sentence = ""


async def receive_shared(
    port: int, seconds: float, on_datagram: Callable[[bytes, Address], None], *, remedy: str
) -> None:
    """Receive datagrams at `port` for `seconds`, together with other programs that share it.

    Raises:
        ConfigError: If it cannot be opened. `remedy` is the remedy in the message.
    """
    problem = _Problem()
    server = UdpServer("0.0.0.0", port, problem, on_datagram, remedy=remedy, is_shared=True)  # noqa: S104
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(seconds):
            await server.run()
    if problem.sentence:
        raise ConfigError(problem.sentence)


class DatagramLimit:
    """Limits the datagrams of a second, so that a flood costs little."""

    def __init__(self, max_per_s: int = 2000) -> None:
        self._max_per_s = max_per_s
        self._second = 0
        self._count = 0
        self._flooded_s = -1

    def admits(self, now_s: float) -> bool:
        """Count a datagram. Return False if it is one too many in its second."""
        second = int(now_s)
        if second != self._second:
            self._second = second
            self._count = 0
        self._count += 1
        if self._count > self._max_per_s:
            self._flooded_s = second
            return False
        return True

    def problem(self, now_s: float) -> str:
        """Return the problem of the last seconds, a clause, or `""`."""
        if self._flooded_s < 0 or now_s - self._flooded_s > 3.0:
            return ""
        return f"sends more than {self._max_per_s} datagrams a second; the rest is dropped: lower its rate"


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

        # A flood of others must not use up what the sender in use may send
        self._limit = DatagramLimit()
        self._limit_of_others = DatagramLimit()
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
                await self._watch_sender()
        finally:
            self._timer.cancel()

    @abstractmethod
    async def _watch_sender(self) -> None:
        """Report warnings until cancelled."""

    @abstractmethod
    def _is_used(self, address: Address) -> bool:
        """Return True if `address` is that of the sender in use."""

    @abstractmethod
    def _process_datagram(self, data: bytes, address: Address, now_s: float) -> None:
        """Deliver the readings in a datagram of an admitted sender."""

    def _on_datagram(self, data: bytes, address: Address) -> None:
        now_s = asyncio.get_running_loop().time()
        limit = self._limit if self._is_used(address) else self._limit_of_others
        if limit.admits(now_s):
            self._process_datagram(data, address, now_s)

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
        newest = self._newest
        self._newest = None
        if newest is not None:
            self._delivered_s = asyncio.get_running_loop().time()
            self._deliver(newest)

    def _warn_flood(self, sender: str, now_s: float) -> None:
        problem = self._limit.problem(now_s)
        self._health.warn("flood", f"{sender} {problem}" if problem else "")

    @property
    def _only_here(self) -> str:
        """Return a clause about the networks that are not heard, or `""`."""
        if not self._is_local:
            return ""
        option = set_option("imu-bridge", f"{self._name}.host", ANY_HOST)
        return f"; only this machine is heard there: {option} for others"
