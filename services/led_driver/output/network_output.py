"""Strips on a controller in the network: the newest frame by UDP, resent, ended dark."""

import asyncio
import contextlib
import errno
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from pointit.runtime.host.name_lookup import Resolved, look_up
from pointit.runtime.service.plugin_guard import HealthSink
from pointit.schemas import Strip, StripsFrame
from pointit.schemas.text import round_beyond
from pointit.services.led_driver.output.pixel_map import WHOLE, PixelMap, Power, PowerLoad, map_pixels
from pointit.services.led_driver.outputs import FRAME_RATE, OutputConfig

LIMIT_SHOWN_S = 2.0
"""Time for which dimming is reported, s. Health is read once a second."""
FIGURE_NAME = 50
"""Maximum number of characters of the address in the name of a metric."""


class OutputHealth:
    """Health of the output at an address."""

    def __init__(self, health: HealthSink, address: str) -> None:
        self._health = health
        self._address = address
        self._limited_s = -LIMIT_SHOWN_S

    def warn(self, code: str, sentence: str, subject: str = "") -> None:
        """Show a warning, which begins with the address, until it is cleared, by `clear` or `""`."""
        self._health.warn(code, f"{self._address}: {sentence}" if sentence else "", subject or self._address)

    def clear(self, code: str, subject: str = "") -> None:
        """Clear a warning."""
        self._health.clear(code, subject or self._address)

    def set_metric(self, name: str, value: float | None, unit: str = "") -> None:
        """Show a metric. None removes it."""
        # a metric's name is short, an address may not be; its end distinguishes ports
        self._health.set_metric(f"{name} {self._address[-FIGURE_NAME:]}", value, unit)

    def reached(self, latency_s: float) -> None:
        """Record the age of captured data at the moment at which it becomes visible."""
        self._health.reached(latency_s)

    def show_load(self, load: PowerLoad, limit_a: float | None) -> None:
        """Show the current of a frame, and warn while frames are dimmed to `limit_a`."""
        self.set_metric("current", load.drawn_a, "A")
        now_s = asyncio.get_running_loop().time()
        if load.limited:
            self._limited_s = now_s
            self.warn(
                "current",
                f"frames need up to {round_beyond(load.wanted_a, limit_a or 0.0)} A and are dimmed to "
                f"{limit_a} A; lower the "
                "brightness, or give more power and raise `max_current_a`",
            )
        elif now_s - self._limited_s >= LIMIT_SHOWN_S:
            self.clear("current")


KEEP_ALIVE_S = 1.0
"""Period at which an unchanged payload is resent, s. Receivers forget one after 2.5 s (WLED, E1.31)."""
REPEATS = 2
"""Number of times that a payload is resent soon, since datagrams get lost (E1.31-2018, 6.6.1)."""
REPEAT_S = 0.1
"""Period of these, s: long beside that of frames, so that a new one seldom waits for a repeated one."""
RETRY_S = 0.5
"""Wait after an error, s."""
END_S = 0.3
"""Maximum time for the last datagrams, s."""
SETTLED_SENDS = 2
"""Number of payloads after which a connection is in order: the answer to a datagram, that nobody listens,
makes a later one fail."""
UNREACHABLE = (errno.EHOSTUNREACH, errno.ENETUNREACH, errno.EHOSTDOWN, errno.ENETDOWN, errno.ENETRESET)


class Datagram(NamedTuple):
    """Bytes to send."""

    data: bytes
    host: str | None = None
    """IPv4 address, if not that of the output."""


Encode = Callable[[bytes, int], Sequence[Datagram]]
"""Returns the datagrams that show a payload. The second argument counts payloads, from 1."""


@dataclass(frozen=True, kw_only=True)
class Destination:
    """Receiver of datagrams, and the way there."""

    host: str
    """Name or address, or `""` if each datagram has its own."""
    port: int
    is_broadcast: bool = False
    """True if the address may be a broadcast address."""
    interface: str = ""
    """Address of the network interface by which multicast leaves, or `""` for the system's choice."""


class DatagramSender:
    """Sends the newest payload to one receiver, at a limited rate."""

    def __init__(
        self,
        destination: Destination,
        encode: Encode,
        health: OutputHealth,
        *,
        max_rate_hz: float,
        encode_end: Encode,
    ) -> None:
        """Prepare; nothing is opened yet.

        Args:
            destination: receiver.
            encode: protocol.
            health: shows errors, the frame rate, and the bytes per second at this rate.
            max_rate_hz: number of payloads per second that the receiver takes.
            encode_end: datagrams to send at the end, given the last payload.
        """
        self._destination = destination
        self._encode = encode
        self._encode_end = encode_end
        self._health = health
        self._period_s = 1.0 / max_rate_hz
        self._payload: bytes | None = None
        self._shown_s = 0.0
        self._age_s: float | None = None
        self._changed = asyncio.Event()
        self._number = 0
        self._addresses: Sequence[Resolved] = ()
        self.light_s = 0.0
        """Time from `send` to the last datagram of the last new payload, s; 0.0 before the first."""

    def send(self, payload: bytes, age_s: float | None = None) -> None:
        """Send `payload`.

        It replaces an unsent one. `age_s`: age of the captured data in it, s, or None.
        """
        self._payload = payload
        self._shown_s, self._age_s = asyncio.get_running_loop().time(), age_s
        self._changed.set()

    async def run(self) -> None:
        """Send until cancelled, then switch off."""
        try:
            while True:
                try:
                    if self._destination.host:
                        self._addresses = await look_up(self._destination.host, self._destination.port)
                    with self._open() as sock:
                        await self._send_payloads(sock)
                except OSError as error:
                    self._health.warn("network", describe_network_error(error))
                self._health.set_metric(FRAME_RATE, None)
                await asyncio.sleep(RETRY_S)
        except asyncio.CancelledError:
            if self._payload is not None and self._number:
                # a new socket: the answer to an earlier datagram must not make the last ones fail
                with contextlib.suppress(OSError), self._open() as sock:
                    await self._end(sock, self._payload)
            raise

    def _open(self) -> socket.socket:
        """Return a socket, which is connected if there is an address, so that errors come back.

        Raises:
            OSError: No network leads to any of the addresses.
        """
        if not self._destination.host:
            return self._open_family(socket.AF_INET)  # multicast
        error = OSError("its name has no address")
        for family, address in self._addresses:
            sock = self._open_family(family)
            try:
                sock.connect(address)
            except OSError as raised:
                sock.close()
                error = raised
            else:
                return sock
        raise error

    def _open_family(self, family: socket.AddressFamily) -> socket.socket:
        sock = socket.socket(family, socket.SOCK_DGRAM)
        try:
            sock.setblocking(False)
            if family == socket.AF_INET and self._destination.is_broadcast:
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            if family == socket.AF_INET and self._destination.interface:
                interface = socket.inet_aton(self._destination.interface)
                sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, interface)
        except BaseException:
            sock.close()
            raise
        return sock

    async def _send_payloads(self, sock: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        sent, unchanged, next_s = 0, 0, loop.time()
        self._changed.set()  # what was shown meanwhile
        while True:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(REPEAT_S if unchanged < REPEATS else KEEP_ALIVE_S):
                    await self._changed.wait()
            if (wait_s := next_s - loop.time()) > 0.0:
                await asyncio.sleep(wait_s)
            if self._payload is None:
                self._changed.clear()
                continue
            is_new = self._changed.is_set()
            unchanged = 0 if is_new else unchanged + 1
            self._changed.clear()
            next_s = max(next_s, loop.time() - self._period_s) + self._period_s
            await self._send_one(sock, self._payload, is_new=is_new)
            sent += 1
            if sent == SETTLED_SENDS:
                self._health.clear("network")

    async def _send_one(self, sock: socket.socket, payload: bytes, *, is_new: bool) -> None:
        loop = asyncio.get_running_loop()
        began_s, shown_s, age_s = loop.time(), self._shown_s, self._age_s
        self._number += 1
        datagrams = self._encode(payload, self._number)
        for datagram in datagrams:
            await self._send_datagram(sock, datagram)
        now_s = loop.time()
        if is_new and age_s is not None:
            self.light_s = now_s - shown_s
            self._health.reached(age_s + self.light_s)
        rate_hz = 1.0 / max(now_s - began_s, self._period_s)
        self._health.set_metric(FRAME_RATE, rate_hz, "Hz")
        size = sum(len(datagram.data) for datagram in datagrams)
        self._health.set_metric("network rate", size * rate_hz / 1000.0, "kB/s")

    async def _send_datagram(self, sock: socket.socket, datagram: Datagram) -> None:
        loop = asyncio.get_running_loop()
        if datagram.host is None:
            await loop.sock_sendall(sock, datagram.data)
        else:
            await loop.sock_sendto(sock, datagram.data, (datagram.host, self._destination.port))

    async def _end(self, sock: socket.socket, payload: bytes) -> None:
        async with asyncio.timeout(END_S):
            for datagram in self._encode_end(payload, self._number + 1):
                with contextlib.suppress(OSError):  # the others may arrive
                    await self._send_datagram(sock, datagram)


def describe_network_error(error: OSError) -> str:
    """Return the meaning of `error` and the remedy, for a person."""
    if isinstance(error, socket.gaierror):
        return "its name is not known here: switch it on, or give its address in place of the name"
    if error.errno == errno.ECONNREFUSED:
        return "it is there, but does not listen: switch on its network input, or correct the port"
    if error.errno in UNREACHABLE:
        return "it cannot be reached: switch it on, or correct the address or this machine's network"
    return f"sending failed ({error}): correct the address or this machine's network"


EncodePixels = Callable[[bytes, PixelMap, int], Sequence[Datagram]]
"""Returns the datagrams that show pixels, given the output's map and the number of the frame, from 1."""


@dataclass(frozen=True, kw_only=True)
class Wire:
    """Protocol of a controller. Pure."""

    encode: EncodePixels
    encode_end: EncodePixels | None = None
    """Datagrams at the end, given dark pixels. If None, those of a dark frame."""
    block_bytes: int | None = None
    """Number of bytes of a universe. Its pixels are whole."""
    first_block: int = 0
    """Number of the first universe."""
    max_rate_hz: float
    """Number of frames per second that the controller takes."""


class NetworkOutput:
    """Sends frames to one controller in the network. Newer frames replace unsent ones."""

    def __init__(
        self, config: OutputConfig, destination: Destination, wire: Wire, health: HealthSink, address: str
    ) -> None:
        """Prepare; nothing is opened yet. `address` names the output in health."""
        self._config = config
        self._wire = wire
        self._health = OutputHealth(health, address)
        self._power = Power(config)
        self._map, _ = map_pixels((), ())
        self._strips: tuple[Strip, ...] | None = None
        self._sender = DatagramSender(
            destination,
            lambda pixels, number: self._wire.encode(pixels, self._map, number),
            self._health,
            max_rate_hz=wire.max_rate_hz,
            encode_end=self._encode_end,
        )

    def _encode_end(self, pixels: bytes, number: int) -> Sequence[Datagram]:
        return (self._wire.encode_end or self._wire.encode)(bytes(len(pixels)), self._map, number)

    @property
    def light_s(self) -> float:
        """Return the time from `show` to the last datagram of the last new frame, s; 0.0 before the first."""
        return self._sender.light_s

    def set_strips(self, strips: Sequence[Strip]) -> None:
        """Set the map's strips. Reports in health what the output cannot show."""
        if tuple(strips) == self._strips:  # no blink
            return
        self._strips = tuple(strips)
        block_pixels = WHOLE
        if self._wire.block_bytes is not None:
            orders = [segment.order for segment in self._config.segments] or ["RGB"]
            block_pixels = self._wire.block_bytes // len(orders[0])
        new_map, problems = map_pixels(
            self._config.segments, strips, block_pixels=block_pixels, first_block=self._wire.first_block
        )
        self._map = new_map.covering(self._map)
        self._sender.send(bytes(self._map.size))
        self._health.warn("segments", "; ".join(problems))

    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        """Send `frame`, which shows what was captured `age_s` ago. Returns at once."""
        pixels, load = self._power.send(self._map.output_bytes(frame))
        self._health.show_load(load, self._config.max_current_a)
        self._sender.send(pixels, age_s)

    async def run(self) -> None:
        """Send until cancelled, then switch the strips off."""
        await self._sender.run()


UNIVERSE_SLOTS = 512
"""Number of values of a universe, a byte each."""
RATE_HZ = 40.0
"""Number of frames per second; DMX itself carries 44."""
Universe = tuple[int, bytes]
"""Number of a universe, and its values from the first slot on."""


class DmxStream(Protocol):
    """Packets that set universes of one receiver. Pure."""

    @property
    def destination(self) -> Destination:
        """Return the receiver."""
        ...

    def frame(self, universes: Sequence[Universe], number: int) -> list[Datagram]:
        """Return the packets that set `universes`. `number` counts frames."""
        ...

    def end(self, universes: Sequence[Universe], number: int) -> list[Datagram]:
        """Return the packets that set `universes` for the last time."""
        ...


def pixels_wire(stream: DmxStream, first_universe: int, rate_hz: float) -> Wire:
    """Return the protocol of an output whose pixels fill universes from `first_universe` on."""

    def universes(pixels: bytes, pixel_map: PixelMap) -> list[Universe]:
        return [(block.number, pixels[block.start : block.start + block.size]) for block in pixel_map.blocks]

    return Wire(
        encode=lambda pixels, pixel_map, number: stream.frame(universes(pixels, pixel_map), number),
        encode_end=lambda pixels, pixel_map, number: stream.end(universes(pixels, pixel_map), number),
        block_bytes=UNIVERSE_SLOTS,
        first_block=first_universe,
        max_rate_hz=rate_hz,
    )
