"""Sockets of a client of NatNet, by unicast and multicast, and the search for servers."""

import asyncio
import contextlib
import ipaddress
import socket
import sys
from collections.abc import Callable, Sequence

from pointit.bridges.mocap import natnet_packets
from pointit.bridges.mocap.natnet_packets import MalformedPacketError, ServerInfo
from pointit.bridges.mocap.natnet_session import REQUEST_PERIOD_NS, NatNetSession
from pointit.bridges.mocap.server_search import BROADCAST, open_datagram_socket, search_servers
from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.host.name_lookup import found_addresses, look_up
from pointit.schemas import NS_PER_S

RETRY_S = 2.0
"""Wait after an error of the network, s."""
DEFAULT_INTERFACE = "0.0.0.0"  # noqa: S104 - multicast that this machine sends comes by it
_MULTICAST_ALL = 49
"""Linux: deliver multicast of groups that other programs have joined. Python has no name for it."""


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
                self._warn(
                    f"{self._session.server} cannot be reached ({error}): correct `server` or `interface`"
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
        """Ignore an answer that nobody listens: the session reports the silence."""

    async def _receive(self) -> None:
        hosts = [address for family, address in await look_up(self._session.server, self._port)
                 if family == socket.AF_INET]  # fmt: skip
        if not hosts:
            raise OSError("its name has no IPv4 address")
        host = str(hosts[0][0])
        is_here = ipaddress.ip_address(host).is_loopback
        self._addresses = frozenset((host, *(found_addresses() if is_here else ())))
        loop = asyncio.get_running_loop()
        with contextlib.ExitStack() as opened:
            command = open_datagram_socket(self._interface, 0)
            opened.callback(command.close)
            transport, _ = await loop.create_datagram_endpoint(lambda: self, sock=command)
            opened.callback(transport.abort)
            stream: asyncio.DatagramTransport | None = None
            while True:
                if self._session.info is not self._info:
                    self._info = self._session.info
                    if stream is not None:
                        stream.abort()
                        stream = None
                    if self._info is not None:
                        stream = await self._open_stream(self._info, host)
                        opened.callback(stream.abort)
                self._changed.clear()
                for request in self._session.requests(self._now_ns()):
                    transport.sendto(request, (host, self._port))
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(REQUEST_PERIOD_NS / NS_PER_S):
                        await self._changed.wait()

    async def _open_stream(self, info: ServerInfo, host: str) -> asyncio.DatagramTransport:
        """Listen at the server's data port: some servers send there by unicast, too."""
        sock = open_datagram_socket("", info.data_port)
        try:
            if info.is_multicast:
                own = [self._interface] if self._interface else [_own_address(host), DEFAULT_INTERFACE]
                _join(sock, info.group, own)
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
    error, is_joined = OSError(), False
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
    return await search_servers("NatNet", seconds, targets, lambda _port: request, _read_answer)


def _read_answer(data: bytes, address: str) -> FoundDevice | None:
    try:
        message, payload = natnet_packets.split_packet(data)
        info = natnet_packets.read_server_info(payload) if message == natnet_packets.SERVER_INFO else None
    except MalformedPacketError:
        return None
    if info is None:
        return None
    version = f"NatNet {info.version[0]}.{info.version[1]}"
    kind = f"multicast {info.group}" if info.is_multicast else "unicast"
    label = f"{info.application or 'NatNet server'}, {version}, {kind}"
    return FoundDevice(address, label, {"version": version, "stream": kind})
