"""Outputs in the network by UDP: the newest frame, resent, ended dark; pixels alone or in DMX universes.

No core: it sends datagrams at its own times.
"""

import asyncio
import contextlib
import errno
import socket
from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from pydantic import Field

from pointit.runtime.address_config import AddressConfig, format_address
from pointit.runtime.clock import wait_up_to
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.name_lookup import Resolved, look_up
from pointit.runtime.service.plugin_guard import Surroundings
from pointit.schemas import Strip
from pointit.services.led_driver.output.pixel_map import PixelMap, map_pixels
from pointit.services.led_driver.output.pixel_output import OutputHealth, PixelOutput
from pointit.services.led_driver.outputs import FRAME_RATE, OutputConfig

Universe = tuple[int, bytes]
"""Number of a universe, and its values from the first slot on."""

RATE_HZ = 40.0
"""Number of frames per second; DMX itself carries 44."""
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

UNIVERSE_SLOTS = 512
"""Number of values of a universe, a byte each."""


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

        # Only the newest payload is sent: an older frame shows what is over
        self._payload: bytes | None = None
        self._shown_s = 0.0
        self._age_s: float | None = None
        self._changed = asyncio.Event()

        # Sending
        self._number = 0
        self._addresses: Sequence[Resolved] = ()

    def send(self, payload: bytes, age_s: float | None = None) -> None:
        """Send `payload`.

        It replaces an unsent one. `age_s`: age of the captured data in it, s, or None.
        """
        self._payload = payload
        self._shown_s = asyncio.get_running_loop().time()
        self._age_s = age_s
        self._changed.set()

    async def run(self) -> None:
        """Send until cancelled, then switch off."""
        try:
            while True:
                # A name may have another address after each error
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
            except OSError as refusal:
                sock.close()
                error = refusal
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
        sent = 0
        unchanged = 0
        next_s = loop.time()
        self._changed.set()  # what was shown meanwhile
        while True:
            # Wait for a new payload, or until the last one is due again, then for the rate
            repeat_s = REPEAT_S if unchanged < REPEATS else KEEP_ALIVE_S
            await wait_up_to(self._changed, repeat_s)
            wait_s = next_s - loop.time()
            if wait_s > 0.0:
                await asyncio.sleep(wait_s)
            if self._payload is None:
                self._changed.clear()
                continue
            is_new = self._changed.is_set()
            unchanged = 0 if is_new else unchanged + 1
            self._changed.clear()

            # On the grid of the rate; a pause saves up no more than one payload
            earliest_s = loop.time() - self._period_s
            next_s = max(next_s, earliest_s) + self._period_s
            await self._send_payload(sock, self._payload, is_new=is_new)
            sent += 1
            if sent == SETTLED_SENDS:
                self._health.clear("network")

    async def _send_payload(self, sock: socket.socket, payload: bytes, *, is_new: bool) -> None:
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        shown_s = self._shown_s
        age_s = self._age_s
        self._number += 1
        datagrams = self._encode(payload, self._number)
        for datagram in datagrams:
            await self._send_datagram(sock, datagram)

        # `send` may have been called meanwhile: the times are those of this payload
        now_s = loop.time()
        if is_new and age_s is not None:
            self._health.reached(age_s, now_s - shown_s)
        rate_hz = 1.0 / max(now_s - began_s, self._period_s)
        self._health.set_metric(FRAME_RATE, rate_hz, "Hz")
        size = sum(len(datagram.data) for datagram in datagrams)
        self._health.set_metric("network rate", size * rate_hz / 1000.0, "kB/s")

    async def _send_datagram(self, sock: socket.socket, datagram: Datagram) -> None:
        loop = asyncio.get_running_loop()
        if datagram.host is None:
            await loop.sock_sendall(sock, datagram.data)
        else:
            address = (datagram.host, self._destination.port)
            await loop.sock_sendto(sock, datagram.data, address)

    async def _end(self, sock: socket.socket, payload: bytes) -> None:
        async with asyncio.timeout(END_S):
            for datagram in self._encode_end(payload, self._number + 1):
                with contextlib.suppress(OSError):  # the others may arrive
                    await self._send_datagram(sock, datagram)


def describe_network_error(error: OSError) -> str:
    """Return the meaning of `error` and the remedy, for a person."""
    if isinstance(error, socket.gaierror):
        return "its name cannot be resolved: switch it on, or use its address instead of the name"
    if error.errno == errno.ECONNREFUSED:
        return "it is there, but does not listen: switch on its network input, or correct the port"
    if error.errno in UNREACHABLE:
        return "it cannot be reached: switch it on, or correct the address or this machine's network"
    return f"sending failed ({error}): correct the address or this machine's network"


class UdpOutputConfig(AddressConfig, OutputConfig):
    """A controller in the network."""

    host: str = Field(default="", description="name or address of the controller, or HOST:PORT")
    port: int = Field(gt=0, le=65535, description="UDP port of the controller")
    max_rate_hz: float = Field(
        default=RATE_HZ, gt=0, le=1000, description="maximum number of frames per second"
    )


class UdpOutput(PixelOutput):
    """Sends frames to one controller by UDP. A subclass says which datagrams show pixels."""

    def __init__(
        self, config: UdpOutputConfig, surroundings: Surroundings, destination: Destination | None = None
    ) -> None:
        """Prepare; nothing is opened yet.

        Args:
            config: parameters.
            surroundings: what the plug-in may use.
            destination: receiver, if not host and port of `config`. Health names it by the host alone.

        Raises:
            ConfigError: If the host is missing.
        """
        if not config.host:
            remedy = f"give the controller's name or address, as in --output {config.kind}:HOST"
            raise ConfigError(f"host: is missing; {remedy}")

        # The name in health has the port only where that is not the protocol's
        default_port = type(config).model_fields["port"].default
        address = config.host
        if destination is None and config.port != default_port:
            address = format_address(config.host, config.port)
        super().__init__(config, surroundings, address)

        self._sender = DatagramSender(
            destination or Destination(host=config.host, port=config.port),
            self.encode,
            self.health,
            max_rate_hz=config.max_rate_hz,
            encode_end=self._encode_dark_end,
        )

    @abstractmethod
    def encode(self, pixels: bytes, number: int) -> Sequence[Datagram]:
        """Return the datagrams that show `pixels` of the present map. `number` counts frames, from 1."""

    def encode_end(self, pixels: bytes, number: int) -> Sequence[Datagram]:
        """Return the last datagrams. `pixels` are dark."""
        return self.encode(pixels, number)

    def _encode_dark_end(self, pixels: bytes, number: int) -> Sequence[Datagram]:
        dark = bytes(len(pixels))
        return self.encode_end(dark, number)

    def send_pixels(self, pixels: bytes, age_s: float | None) -> None:
        """Send `pixels` of the present map, captured `age_s` ago, instead of unsent ones. Returns at once."""
        self._sender.send(pixels, age_s)

    async def run(self) -> None:
        """Send until cancelled, then switch the strips off."""
        await self._sender.run()

    def _on_map(self, problems: list[str]) -> None:
        self._sender.send(bytes(self.pixel_map.size))
        super()._on_map(problems)


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


class DmxOutput(UdpOutput):
    """Sends pixels that fill universes."""

    def __init__(
        self, config: UdpOutputConfig, surroundings: Surroundings, stream: DmxStream, first_universe: int
    ) -> None:
        super().__init__(config, surroundings, stream.destination)
        self._stream = stream
        self._first_universe = first_universe

    def map_strips(self, strips: Sequence[Strip]) -> tuple[PixelMap, list[str]]:
        """Return the pixels of `strips`, whole in each universe, and sentences about what cannot be shown."""
        segments = self._config.segments
        colors = len(segments[0].order) if segments else 3
        block_pixels = UNIVERSE_SLOTS // colors
        pixel_map, problems = map_pixels(
            segments, strips, block_pixels=block_pixels, first_block=self._first_universe
        )
        return pixel_map.covering(self.pixel_map), problems

    def encode(self, pixels: bytes, number: int) -> Sequence[Datagram]:
        """Return the packets that show `pixels`."""
        return self._stream.frame(self._universes(pixels), number)

    def encode_end(self, pixels: bytes, number: int) -> Sequence[Datagram]:
        """Return the last packets, of dark `pixels`."""
        return self._stream.end(self._universes(pixels), number)

    def _universes(self, pixels: bytes) -> list[Universe]:
        universes: list[Universe] = []
        for block in self.pixel_map.blocks:
            end = block.start + block.size
            universes.append((block.number, pixels[block.start : end]))
        return universes
