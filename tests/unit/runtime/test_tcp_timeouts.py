"""TCP gives up on ends that have vanished."""

import socket
import sqlite3
import sys
from collections.abc import Awaitable, Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest
import zenoh

from pointit.runtime.link.link import LEASE_MS, Link, ports_of
from pointit.runtime.router_sockets import cut, hold, peer, release_udp_ports
from pointit.runtime.zenoh.session import (
    LINGER,
    close_session,
    configuration,
    open_cancellable,
    open_session,
    own_sockets,
    ports_of_socket,
    set_tcp_timeouts,
)
from tests.support.buses import free_port
from tests.support.invoked import python

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="only Linux has the option"),
    pytest.mark.wall_time,
]

AFTER_MS = 2345

LOOKS_WITHOUT_DESCRIPTORS = """
import os, resource
from pointit.runtime.zenoh.session import set_tcp_timeouts, own_sockets
_, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
resource.setrlimit(resource.RLIMIT_NOFILE, (64, hard))
taken = []
try:
    while True:
        taken.append(os.open(os.devnull, os.O_RDONLY))
except OSError:
    print(list(own_sockets()), set_tcp_timeouts({1}, 1))
"""
"""Run in a process of its own, since it uses up the limit of open files."""


def waits_ms(of: socket.socket) -> int:
    return of.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) if sys.platform == "linux" else 0


@pytest.fixture
def listening() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server


def test_accepted_and_connected_sockets_have_the_timeout(listening: socket.socket) -> None:
    port = listening.getsockname()[1]
    assert set_tcp_timeouts({port}, AFTER_MS) == 1
    with socket.create_connection(("127.0.0.1", port)) as client, listening.accept()[0] as accepted:
        assert waits_ms(accepted) == AFTER_MS
        assert waits_ms(client) == 0
        assert set_tcp_timeouts({port}, AFTER_MS) == 3
        assert waits_ms(client) == AFTER_MS


async def open_bare(link: Link) -> zenoh.Session:
    return await open_cancellable(configuration(link))


def lingers(of: socket.socket) -> bool:
    is_on, _ = LINGER.unpack(of.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER.size))
    return bool(is_on)


def test_connections_close_without_lingering(listening: socket.socket) -> None:
    port = listening.getsockname()[1]
    with socket.create_connection(("127.0.0.1", port)) as client, listening.accept()[0] as accepted:
        accepted.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER.pack(1, 10))
        assert set_tcp_timeouts({free_port()}, AFTER_MS) == 0
        assert lingers(accepted)
        assert set_tcp_timeouts({port}, AFTER_MS) == 3
        assert not lingers(accepted)
        accepted.sendall(b"what was written")
        accepted.close()
        assert client.recv(100) == b"what was written"


def test_others_are_left_alone(listening: socket.socket) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        assert set_tcp_timeouts({other.getsockname()[1], free_port()}, AFTER_MS) == 0
    assert waits_ms(listening) == 0


def test_udp_ports_are_released_and_their_sockets_stay_open(listening: socket.socket) -> None:
    port = listening.getsockname()[1]  # of TCP, which keeps it
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as closed, socket.socket(type=closed.type) as other:
        closed.bind(("127.0.0.1", port))
        other.bind(("127.0.0.1", 0))
        its_port = other.getsockname()
        assert release_udp_ports({port}) == 1
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as next_one:
            next_one.bind(("127.0.0.1", port))
        closed.setblocking(False)
        with pytest.raises(BlockingIOError):
            closed.recv(1)
        assert (listening.getsockname()[1], other.getsockname()) == (port, its_port)
        assert release_udp_ports({port}) == 0


@pytest.mark.parametrize(
    ("family", "host"), [("::1", "::1"), ("::", "127.0.0.1"), ("127.0.0.1", "127.0.0.1")]
)
def test_only_the_peers_connection_is_closed_in_any_notation(family: str, host: str) -> None:
    """Sockets of both versions write an IPv4 address as one of IPv6."""
    version = socket.AF_INET6 if ":" in family else socket.AF_INET
    with (
        socket.create_server((family, 0), family=version, dualstack_ipv6=family == "::") as server,
        socket.create_connection((host, server.getsockname()[1])) as client,
        server.accept()[0] as accepted,
        socket.create_connection((host, server.getsockname()[1])) as other,
        server.accept()[0] as its_end,
    ):
        address, port = client.getsockname()[:2]
        spellings = {address, accepted.getpeername()[0], *([f"{address}%1"] if ":" in address else ())}
        assert len({peer(each, port) for each in spellings}) == 1
        assert cut({peer(accepted.getpeername()[0], port)}) == 1
        assert accepted.recv(1) == b""

        accepted.sendall(b"x")
        assert client.recv(1) == b"x", "what waits is still sent"
        its_end.sendall(b"x")
        assert other.recv(1) == b"x"


def test_held_connection_stays_open_and_nothing_of_it_arrives(listening: socket.socket) -> None:
    with closing(socket.create_connection(listening.getsockname()[:2])) as client:
        accepted, _ = listening.accept()
        with closing(accepted):
            client.sendall(b"x" * 1000)
            assert hold({peer(*client.getsockname()[:2])}) == 1
            client.sendall(b"y" * 1000)
            accepted.sendall(b"z")
            assert client.recv(1) == b"z", "what waits is still sent"
            accepted.setblocking(False)
            with pytest.raises(BlockingIOError):  # no end of the stream, either
                accepted.recv(1)


def test_sockets_are_not_found_without_a_free_descriptor() -> None:
    looked = python("-c", LOOKS_WITHOUT_DESCRIPTORS)
    assert (looked.stdout, looked.stderr) == ("[] 0\n", "")


def test_no_setting_of_a_socket_is_changed_by_looking(listening: socket.socket) -> None:
    listening.setblocking(False)
    set_tcp_timeouts({listening.getsockname()[1]}, AFTER_MS)
    assert not listening.getblocking()
    with pytest.raises(BlockingIOError):
        listening.accept()


def test_locks_on_files_are_kept(tmp_path: Path) -> None:
    take = "import sqlite3, sys; sqlite3.connect(sys.argv[1], timeout=0).execute('BEGIN EXCLUSIVE')"
    path = tmp_path / "held.sqlite"
    with closing(sqlite3.connect(path, isolation_level=None)) as held:
        held.execute("BEGIN EXCLUSIVE")
        set_tcp_timeouts({free_port()}, AFTER_MS)
        other = python("-c", take, path)
    assert "database is locked" in other.stderr


def test_ports_of_addresses() -> None:
    addresses = ("tcp/127.0.0.1:7447", "tls/[::1]:7448#ca=/a b.pem", "quic/host:7449", "serial//dev/ttyUSB0")
    assert ports_of(addresses) == {7447, 7448, 7449}


@pytest.mark.parametrize(
    ("opens", "limits"), [(open_session, (LEASE_MS, False)), (open_bare, (0, True))], ids=["ours", "Zenoh's"]
)
async def test_sessions_have_the_timeouts_which_zenoh_does_not_set(
    opens: Callable[[Link], Awaitable[zenoh.Session]], limits: tuple[int, bool]
) -> None:
    port = free_port()
    endpoint = f"tcp/127.0.0.1:{port}"
    router = await open_session(Link(listen=(endpoint,), router=True))
    session = await opens(Link(connect=(endpoint,)))
    try:
        connected: list[tuple[int, bool]] = []
        others: list[int] = []
        for each in own_sockets():
            if each.getsockname()[1] == port:
                others.append(waits_ms(each))
            elif port in ports_of_socket(each):
                connected.append((waits_ms(each), lingers(each)))
        assert connected == [limits]
        assert others == [LEASE_MS] * 2, "what listens, and what it has accepted"
    finally:
        await close_session(session)
        await close_session(router)
