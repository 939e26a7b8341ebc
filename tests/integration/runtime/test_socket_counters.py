"""The system's counters of connections, of real sockets."""

import socket
import sys

import pytest

from pointit.runtime.router_sockets import peer
from pointit.runtime.socket_counters import SocketCounters, socket_counters
from tests.support.bench import until

pytestmark = [
    pytest.mark.wall_time,
    pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such counters"),
]


async def test_bytes_and_unread_data_of_each_peer_are_counted() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        with (
            socket.create_connection(("127.0.0.1", port)) as client,
            socket.create_connection(("127.0.0.1", port)) as other,
        ):
            accepted, _ = listener.accept()
            accepted_other, _ = listener.accept()
            with accepted, accepted_other:
                client_address = peer(*client.getsockname())

                def counters() -> SocketCounters:
                    return socket_counters({port})[client_address]

                client.sendall(b"x" * 5000)
                await until(lambda: counters().received_bytes == 5000)
                assert counters().received_segments >= 1
                assert not counters().is_peer_full
                assert socket_counters({port})[peer(*other.getsockname())].received_bytes == 0

                # The client reads nothing of what it gets, and its window closes
                accepted.setblocking(False)
                accepted.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)

                def fill() -> bool:
                    try:
                        while True:
                            accepted.send(b"x" * 65536)
                    except BlockingIOError:
                        return counters().is_peer_full

                await until(fill)
                assert not socket_counters({port})[peer(*other.getsockname())].is_peer_full
