"""An HTTP server in a thread that answers each request with any bytes, as fast as the client lets it."""

import contextlib
import socket
import threading
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass, field

Chunks = Callable[[threading.Event], Iterable[bytes]]
"""Chunks of an answer, given the event that ends the server."""


@dataclass
class HostileServer:
    """Its address, the requests it got, and the bytes it could send before the client closed."""

    port: int
    requests: list[bytes] = field(default_factory=list[bytes])
    sent: int = 0
    closed: threading.Event = field(default_factory=threading.Event)
    """Set when a client has closed, or has read the whole answer."""

    @property
    def url(self) -> str:
        """Return its URL."""
        return f"http://127.0.0.1:{self.port}/hook"


@contextlib.contextmanager
def hostile_server(chunks: Chunks) -> Generator[HostileServer]:
    """Serve `chunks` to each request during the body. Small buffers: what is sent was read by the client."""
    is_over = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        listener.settimeout(0.1)
        server = HostileServer(listener.getsockname()[1])
        thread = threading.Thread(target=_serve, args=(listener, server, chunks, is_over))
        thread.start()
        try:
            yield server
        finally:
            is_over.set()
            thread.join(30)


def forever(chunk: bytes, start: bytes = b"") -> Chunks:
    """Return an answer of `start` and `chunk` again and again."""

    def chunks(is_over: threading.Event) -> Generator[bytes]:
        yield start
        while not is_over.is_set():
            yield chunk

    return chunks


def drip(answer: bytes, period_s: float) -> Chunks:
    """Return an answer of one byte in each `period_s`."""

    def chunks(is_over: threading.Event) -> Generator[bytes]:
        for number in range(len(answer)):
            yield answer[number : number + 1]
            if is_over.wait(period_s):
                return

    return chunks


def _serve(listener: socket.socket, server: HostileServer, chunks: Chunks, is_over: threading.Event) -> None:
    while not is_over.is_set():
        with contextlib.suppress(TimeoutError):
            connection, _ = listener.accept()
            with connection:
                connection.settimeout(10)
                server.closed.clear()
                with contextlib.suppress(OSError):
                    server.requests.append(connection.recv(65536))
                    for chunk in chunks(is_over):
                        connection.sendall(chunk)
                        server.sent += len(chunk)
                    # closing with an unread request resets the connection, and the client may lose the answer
                    connection.shutdown(socket.SHUT_WR)
                    while connection.recv(65536):
                        pass
                server.closed.set()
