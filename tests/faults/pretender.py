"""A false router that is not part of the site."""

import contextlib
import socket
import ssl
import threading
from collections.abc import Generator
from dataclasses import dataclass, field

from pointit.access.site_folder import SiteFolder

PATIENCE_S = 5.0
"""Time to wait for the next message of a connection."""


@dataclass
class Pretender:
    port: int
    trusted: list[bytes] = field(default_factory=list[bytes])
    """First message of each client that trusted it."""
    failed: list[str] = field(default_factory=list[str])
    """Error of each other client."""


@contextlib.contextmanager
def pretending(folder: SiteFolder) -> Generator[Pretender]:
    """Listen as a router, by TLS, with the certificate of the site in `folder`."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    router = folder.path / "router"
    context.load_cert_chain(router / "cert.pem", router / "key.pem")
    with socket.create_server(("127.0.0.1", 0)) as server:
        pretender = Pretender(server.getsockname()[1])

        def serve() -> None:
            while True:
                try:
                    came, _ = server.accept()
                except OSError:  # the end
                    return
                with came:
                    came.settimeout(PATIENCE_S)
                    try:
                        _hear(came)
                    except OSError as error:  # each their own way to go: an alert, a reset, silence
                        pretender.failed.append(str(error))

        def _hear(came: socket.socket) -> None:
            with context.wrap_socket(came, server_side=True, do_handshake_on_connect=False) as secured:
                secured.do_handshake()
                said = b""  # nothing, if it fails from here on: the certificate was taken all the same
                try:
                    said = secured.recv(1000)
                finally:
                    pretender.trusted.append(said)

        thread = threading.Thread(target=serve, name="pretender")
        thread.start()
        try:
            yield pretender
        finally:
            server.shutdown(socket.SHUT_RDWR)
            thread.join()
