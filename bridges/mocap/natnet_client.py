"""Client of NatNet: session with one server, sockets by unicast and multicast, and the search for servers.

No core: it waits for datagrams.
"""

import asyncio
import contextlib
import ipaddress
import socket
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from pointit.bridges.mocap import natnet_packets
from pointit.bridges.mocap.bodies import ARRIVAL_SIGMA_S, BodySample, TimedFrame
from pointit.bridges.mocap.natnet_packets import MalformedPacketError, MocapFrame, ServerInfo, read_models
from pointit.runtime.clock import wait_up_to
from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.datagram_search import BROADCAST, open_datagram_socket, search_by_datagrams
from pointit.runtime.host.name_lookup import found_addresses, look_up
from pointit.schemas import NS_PER_S
from pointit.schemas.message_age import message_age_ns
from pointit.schemas.text import system_reason

MAX_ECHOES = 20
"""Number of echoes that are compared."""
DRIFT = 50e-6
"""Assumed largest rate between two clocks. Quartz crystals differ by less."""

REQUEST_PERIOD_NS = NS_PER_S // 2
"""Period of echoes and keep-alives, and of a request that was not answered."""
SERVER_TIMEOUT_NS = 5 * NS_PER_S
"""Time without any packet after which the connection is restarted."""
SILENCE_NS = 3 * NS_PER_S
"""Time without frames or an answer after which that is reported."""
REPORT_NS = 10 * NS_PER_S
"""Time for which a fault is reported after it was last seen."""
MAX_FRAME_AGE_S = 2.0
"""Age from which a frame is not current: Motive plays a recording."""
MAX_FUTURE_S = 0.5
"""Time by which a frame may seem to be ahead, s."""
USB_LATENCY_SIGMA_S = 0.005
"""1 sigma of the time of exposure if the server states only the time of sending, s."""

RETRY_S = 2.0
"""Wait after an error of the network, s."""
DEFAULT_INTERFACE = "0.0.0.0"  # noqa: S104 - multicast that this machine sends comes by it
_MULTICAST_ALL = 49
"""Linux: deliver multicast of groups that other programs have joined. Python has no name for it."""


class _Echo(NamedTuple):
    offset_ns: float
    half_trip_ns: float
    received_ns: int

    def sigma_ns(self, now_ns: int) -> float:
        return self.half_trip_ns + DRIFT * abs(now_ns - self.received_ns)


class ServerClock:
    """Offset between a server's clock and the site's. The echo with the smallest uncertainty counts."""

    def __init__(self, clock_hz: int) -> None:
        """Start without an offset. `clock_hz`: ticks per second."""
        self._ns_per_tick = NS_PER_S / clock_hz
        self._echoes: deque[_Echo] = deque(maxlen=MAX_ECHOES)
        self.steps = 0
        """Number of times that one of the clocks was set."""

    def add(self, sent_ns: int, received_ns: int, ticks: int) -> None:
        """Add an echo that was sent and received at these times of the site, with the server's ticks."""
        if received_ns < sent_ns:
            return
        middle_ns = (sent_ns + received_ns) / 2
        offset_ns = ticks * self._ns_per_tick - middle_ns
        echo = _Echo(offset_ns, (received_ns - sent_ns) / 2, received_ns)

        # Half a round trip bounds the error of each: two that are further apart are of different clocks
        best = self._best(received_ns)
        if best is not None:
            apart_ns = abs(echo.offset_ns - best.offset_ns)
            if apart_ns > echo.half_trip_ns + best.sigma_ns(received_ns):
                self.steps += 1
                self._echoes.clear()
        self._echoes.append(echo)

    def time_ns(self, ticks: int, now_ns: int) -> tuple[int, float] | None:
        """Return the site's time of `ticks`, and its 1 sigma in ns. None before the first echo."""
        best = self._best(now_ns)
        if best is None:
            return None
        time_ns = ticks * self._ns_per_tick - best.offset_ns
        return round(time_ns), best.sigma_ns(now_ns) / 2

    def _best(self, now_ns: int) -> _Echo | None:
        return min(self._echoes, key=lambda echo: echo.sigma_ns(now_ns), default=None)


class NatNetSession:
    """Understands the packets of one server, and knows what to send next."""

    def __init__(self, server: str, on_frame: Callable[[TimedFrame], None]) -> None:
        self.server = server
        """Name of the server in messages."""
        self.info: ServerInfo | None = None
        """Description of the server, or None while it is not connected."""
        self._on_frame = on_frame
        self._clock: ServerClock | None = None
        self._names: dict[int, tuple[str, ...]] | None = None
        self._is_model_stale = True
        self._last: MocapFrame | None = None
        self._since_ns = 0
        self._asked_ns = 0
        """Time of the last request for an echo."""
        self._packet_ns = 0
        self._arrived_ns = 0
        """Arrival of the last frame, also of one that is not used."""
        self._used_ns = 0
        self._frame_fault = ""
        self._faults: dict[str, tuple[str, int]] = {}
        """Faults that are reported for a while by their kinds, each with its last time."""
        self.damaged = 0
        """Number of packets that could not be read."""

    def restart(self, now_ns: int) -> None:
        """Forget the server, in order to connect again."""
        self.info = None
        self._clock = None
        self._names = None
        self._last = None
        self._since_ns = now_ns
        self._packet_ns = now_ns
        self._arrived_ns = 0
        self._used_ns = 0

    def requests(self, now_ns: int) -> list[bytes]:
        """Return the packets to send now. To be called each `REQUEST_PERIOD_NS`."""
        if self.info is not None and now_ns - self._packet_ns > SERVER_TIMEOUT_NS:
            self.restart(now_ns)
        if self.info is None:
            return [natnet_packets.connect_packet()]
        requests = [natnet_packets.packet(natnet_packets.KEEP_ALIVE)]
        if now_ns - max(self._arrived_ns, self._since_ns) > SERVER_TIMEOUT_NS:
            # A server that was restarted has forgotten its clients
            requests.append(natnet_packets.connect_packet())
        if self._clock is not None:
            self._asked_ns = now_ns
            requests.append(natnet_packets.echo_packet(now_ns))
        if self._names is None or self._is_model_stale:
            requests.append(natnet_packets.packet(natnet_packets.MODEL_REQUEST))
        return requests

    def receive(self, data: bytes, now_ns: int) -> None:
        """Use a packet of the server."""
        try:
            self._receive(data, now_ns)
        except MalformedPacketError as error:
            self.damaged += 1
            advice = "update PointIt or Motive, and end other programs on these ports"
            sentence = f"{self.server} sent no NatNet as it is known ({error}); {advice}"
            self._faults["damage"] = sentence, now_ns

    def receive_unknown(self, data: bytes, address: str, now_ns: int) -> None:
        """Record a packet of another machine. It is not used, since anybody can send one."""
        frame_head = natnet_packets.packet(natnet_packets.FRAME)[:2]
        if data[:2] == frame_head:
            advice = "end that server or give it another port, or name it as `server`"
            self._faults["unknown"] = f"{address} streams here, too, and is not used: {advice}", now_ns

    def problem(self, now_ns: int) -> str:
        """Return a sentence if there is no usable stream, or something is odd, else `""`."""
        if self.info is None:
            if now_ns - self._since_ns < SILENCE_NS:
                return ""
            return (
                f"{self.server} does not answer by NatNet: start Motive, switch on its streaming, and allow "
                "it in the firewalls; `pointit devices` lists servers"
            )

        # Connected: without frames, with unusable ones, or without names, the most probable cause first
        if now_ns - max(self._arrived_ns, self._since_ns) > SILENCE_NS:
            info = self.info
            kind = f"multicast group {info.group}" if info.is_multicast else "unicast"
            return (
                f"{self.server} answers, but no frames come ({kind}, port {info.data_port}): start the "
                "live view in Motive, choose the network of this machine as its local interface, or name "
                "this machine's address in that network in `interface`"
            )
        unused_ns = now_ns - max(self._used_ns, self._since_ns)
        if self._frame_fault and unused_ns > NS_PER_S:
            return f"{self.server}: {self._frame_fault}"
        if self._names is None and now_ns - self._since_ns > SILENCE_NS:
            return f"{self.server} does not name its bodies: switch on rigid bodies in its streaming panel"
        for sentence, seen_ns in self._faults.values():
            if now_ns - seen_ns < REPORT_NS:
                return sentence
        return ""

    def clock_sigma_s(self, now_ns: int) -> float | None:
        """Return 1 sigma of the server's clock, s, or None if it is not known."""
        if self._clock is None:
            return None
        time = self._clock.time_ns(0, now_ns)
        if time is None:
            return None
        _, sigma_ns = time
        return sigma_ns / NS_PER_S

    def _receive(self, data: bytes, now_ns: int) -> None:
        message, payload = natnet_packets.split_packet(data)
        self._packet_ns = now_ns
        if message == natnet_packets.SERVER_INFO:
            self._connect(natnet_packets.read_server_info(payload), now_ns)
        elif self.info is None:
            return
        elif message == natnet_packets.ECHO and self._clock is not None:
            sent_ns, ticks = natnet_packets.read_echo(payload)
            if sent_ns == self._asked_ns:  # else it is late, or another client's
                self._clock.add(sent_ns, now_ns, ticks)
        elif message == natnet_packets.MODEL:
            self._names = read_models(payload, self.info.version)
            self._is_model_stale = False
        elif message == natnet_packets.FRAME:
            self._arrived_ns = now_ns
            self._frame(natnet_packets.read_frame(payload, self.info.version), now_ns)

    def _connect(self, info: ServerInfo, now_ns: int) -> None:
        if self.info == info:
            return
        if info.version < (2, 0):
            major, minor = info.version
            raise MalformedPacketError(f"its version {major}.{minor} is older than 2.0")
        self.restart(now_ns)
        self.info = info
        self._clock = ServerClock(info.clock_hz) if info.clock_hz else None

    def _frame(self, frame: MocapFrame, now_ns: int) -> None:
        if frame.flags & natnet_packets.MODEL_CHANGED or self._names is None:
            self._is_model_stale = True
        last = self._last
        self._last = frame
        if last is not None and _is_repeated(frame, last):
            self._frame_fault = "its frames stand still: leave the edit mode or the pause in Motive"
            return

        # A recording has the times at which it was made
        stamp_ns, sigma_s = self._stamp(frame, now_ns)
        age_s = message_age_ns(stamp_ns, now_ns) / NS_PER_S
        if not -MAX_FUTURE_S <= age_s <= MAX_FRAME_AGE_S:
            limit = f"at most {MAX_FRAME_AGE_S:g} s are accepted"
            self._frame_fault = (
                f"its frames are {age_s:.1f} s old, {limit}: change from "
                "a recording to the live view in Motive"
            )
            return

        # Not before it has named its bodies, nor before the first echo of its clock, unless none comes
        if self._names is None:
            return
        is_timed = self._clock is None or self._clock.time_ns(0, now_ns) is not None
        if not is_timed and now_ns - self._since_ns < SILENCE_NS:
            return
        if any(body.id not in self._names for body in frame.bodies):
            self._is_model_stale = True
        self._used_ns = now_ns
        self._frame_fault = ""
        bodies: list[tuple[str, BodySample]] = []
        for body in frame.bodies:
            bodies += _named(body, self._names.get(body.id))
        self._on_frame(TimedFrame(stamp_ns, sigma_s, tuple(bodies)))

    def _stamp(self, frame: MocapFrame, now_ns: int) -> tuple[int, float]:
        """Return the time of exposure, and its 1 sigma in s."""
        ticks = frame.exposure_ticks or frame.sent_ticks
        if self._clock is None or not ticks:
            return now_ns, ARRIVAL_SIGMA_S
        time = self._clock.time_ns(ticks, now_ns)
        if time is None:
            return now_ns, ARRIVAL_SIGMA_S
        stamp_ns, sigma_ns = time
        latency_sigma_s = 0.0 if frame.exposure_ticks else USB_LATENCY_SIGMA_S
        return stamp_ns, sigma_ns / NS_PER_S + latency_sigma_s


def _named(body: BodySample, names: tuple[str, ...] | None) -> Iterator[tuple[str, BodySample]]:
    """Yield a body under its name, or under each of several that share its id, with the fault."""
    own_names = names or ("",)
    shown_names = tuple(name or f"body {body.id}" for name in own_names)
    if len(shown_names) > 1:
        listing = ", ".join(shown_names)
        text = f"the bodies {listing} have one streaming id, {body.id}, and are not used: give each"
        body = body._replace(fault=f"{text} its own in Motive")
    for name in shown_names:
        yield name, body


def _is_repeated(frame: MocapFrame, last: MocapFrame) -> bool:
    """Return True if the server's time stands still."""
    if frame.exposure_ticks or last.exposure_ticks:
        return frame.exposure_ticks == last.exposure_ticks
    return frame.number == last.number


class NatNetClient(asyncio.DatagramProtocol):
    """Keeps a session with one server alive."""

    def __init__(
        self,
        session: NatNetSession,
        now_ns: Callable[[], int],
        warn: Callable[[str], None],
        *,
        port: int = natnet_packets.COMMAND_PORT,
        interface: str = "",
    ) -> None:
        """Prepare; nothing is opened yet.

        Args:
            session: understands the packets.
            now_ns: time of the site, ns.
            warn: called with a sentence about the network, or `""`.
            port: UDP port of the server for requests.
            interface: address of the interface of this machine, or `""` for those that lead to the server.
        """
        self._session = session
        self._now_ns = now_ns
        self._warn = warn
        self._port = port
        self._interface = interface

        # The connection, which is made in `run`
        self._addresses: frozenset[str] = frozenset()
        """Addresses of the server."""
        self._info: ServerInfo | None = None
        """Server whose stream is received."""
        self._changed = asyncio.Event()

    async def run(self) -> None:
        """Receive until cancelled."""
        while True:
            self._session.restart(self._now_ns())
            try:
                await self._receive()
            except OSError as error:
                server = self._session.server
                self._warn(
                    f"{server} cannot be reached ({system_reason(error)}): correct `server` or `interface`"
                )
            await asyncio.sleep(RETRY_S)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Use a datagram."""
        if addr[0] not in self._addresses:
            self._session.receive_unknown(data, addr[0], self._now_ns())
            return
        self._session.receive(data, self._now_ns())
        if self._session.info is not self._info:
            self._changed.set()

    def error_received(self, exc: Exception) -> None:
        """Ignore the answer that nobody listens: the session reports the silence."""

    async def _receive(self) -> None:
        # The server, which sends from any of its addresses if it is this machine
        hosts: list[str] = []
        for family, address in await look_up(self._session.server, self._port):
            if family == socket.AF_INET:
                hosts.append(str(address[0]))
        if not hosts:
            raise OSError("its name has no IPv4 address")
        host = hosts[0]
        addresses = {host}
        if ipaddress.ip_address(host).is_loopback:
            addresses.update(found_addresses())
        self._addresses = frozenset(addresses)

        loop = asyncio.get_running_loop()
        with contextlib.ExitStack() as stack:
            command = open_datagram_socket(self._interface, 0)
            stack.callback(command.close)
            transport, _ = await loop.create_datagram_endpoint(lambda: self, sock=command)
            stack.callback(transport.abort)
            stream: asyncio.DatagramTransport | None = None
            while True:
                # A stream for each server that answers there: it may be restarted with other settings
                if self._session.info is not self._info:
                    self._info = self._session.info
                    if stream is not None:
                        stream.abort()
                        stream = None
                    if self._info is not None:
                        stream = await self._open_stream(self._info, host)
                        stack.callback(stream.abort)

                # Requests, each period and after the server has answered
                self._changed.clear()
                for request in self._session.requests(self._now_ns()):
                    transport.sendto(request, (host, self._port))
                await wait_up_to(self._changed, REQUEST_PERIOD_NS / NS_PER_S)

    async def _open_stream(self, info: ServerInfo, host: str) -> asyncio.DatagramTransport:
        """Listen at the server's data port: some servers send there by unicast, too."""
        sock = open_datagram_socket("", info.data_port)
        try:
            if info.is_multicast:
                if self._interface:
                    interfaces = [self._interface]
                else:
                    interfaces = [_own_address(host), DEFAULT_INTERFACE]
                _join(sock, info.group, interfaces)
            transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(lambda: self, sock=sock)
        except BaseException:
            sock.close()
            raise
        self._warn("")
        return transport


def _join(sock: socket.socket, group: str, interfaces: Sequence[str]) -> None:
    """Join a group by each interface.

    Raises:
        OSError: If none of them can.
    """
    if sys.platform == "linux":
        sock.setsockopt(socket.IPPROTO_IP, _MULTICAST_ALL, 0)
    error = OSError()
    is_joined = False
    for interface in interfaces:
        try:
            membership = socket.inet_aton(group) + socket.inet_aton(interface)
            sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
            is_joined = True
        except OSError as raised:  # two addresses of one interface: it is joined already
            error = raised
    if not is_joined:
        raise error


def _own_address(host: str) -> str:
    """Return the address of the interface that leads to `host`."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect((host, natnet_packets.COMMAND_PORT))
        address: str = probe.getsockname()[0]
        return address


async def find_servers(
    seconds: float, targets: Sequence[tuple[str, int]] = ((BROADCAST, natnet_packets.COMMAND_PORT),)
) -> Sequence[FoundDevice]:
    """Return the servers that answer within `seconds` at `targets`.

    Raises:
        ConfigError: If the question cannot be sent.
    """
    request = natnet_packets.connect_packet(natnet_packets.DISCOVERY)
    return await search_by_datagrams("NatNet servers", seconds, targets, lambda _port: request, _read_answer)


def _read_answer(data: bytes, address: str) -> FoundDevice | None:
    try:
        message, payload = natnet_packets.split_packet(data)
        if message != natnet_packets.SERVER_INFO:
            return None
        info = natnet_packets.read_server_info(payload)
    except MalformedPacketError:
        return None
    major, minor = info.version
    version = f"NatNet {major}.{minor}"
    kind = f"multicast {info.group}" if info.is_multicast else "unicast"
    application = info.application or "NatNet server"
    label = f"{application}, {version}, {kind}"
    return FoundDevice(address, label, {"version": version, "stream": kind})
