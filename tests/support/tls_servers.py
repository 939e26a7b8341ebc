"""Servers of OpenSSL that refuse a client by TLS, each in its own way. They send alerts, as proxies do."""

import contextlib
import socket
import ssl
import threading
import warnings
from collections.abc import Callable, Generator
from pathlib import Path

from tests.support.certificates import issue

ANSWER = b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n"


def _client_certificate(context: ssl.SSLContext, authority: Path) -> None:
    context.verify_mode = ssl.CERT_REQUIRED
    context.load_verify_locations(authority)


def _client_certificate_of_tls_1_2(context: ssl.SSLContext, authority: Path) -> None:
    _client_certificate(context, authority)
    context.maximum_version = ssl.TLSVersion.TLSv1_2


def _unknown_name(context: ssl.SSLContext, authority: Path) -> None:
    """As nginx with `ssl_reject_handshake`."""
    del authority
    context.sni_callback = lambda *_: ssl.AlertDescription.ALERT_DESCRIPTION_UNRECOGNIZED_NAME


def _internal_error(context: ssl.SSLContext, authority: Path) -> None:
    """As Caddy without a certificate for the name."""
    del authority
    context.sni_callback = lambda *_: ssl.AlertDescription.ALERT_DESCRIPTION_INTERNAL_ERROR


def _old_version(context: ssl.SSLContext, authority: Path) -> None:
    del authority
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        context.minimum_version = ssl.TLSVersion.TLSv1_1
        context.maximum_version = ssl.TLSVersion.TLSv1_1
    context.set_ciphers("ALL:@SECLEVEL=0")


REFUSALS: dict[str, tuple[Callable[[ssl.SSLContext, Path], None], str]] = {
    "certificate": (_client_certificate, "asks for a certificate of the client, and PointIt has none"),
    "certificate 1.2": (_client_certificate_of_tls_1_2, "it may ask for a certificate of the client"),
    "name": (_unknown_name, "has no certificate for this name or address"),
    "internal": (_internal_error, "has no certificate for this name or address"),
    "version": (_old_version, "encrypts by TLSv1.1 only: update it to TLS 1.2"),
}
"""How a server refuses, and a part of the sentence that is said of it."""


@contextlib.contextmanager
def refusing(folder: Path, kind: str) -> Generator[tuple[int, Path]]:
    """Run a server on localhost that refuses clients in a way of `REFUSALS`.

    Yield its port and the file of its authority.
    """
    authority, certificate, key = issue(folder, "localhost")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate, key)
    configure, _sentence = REFUSALS[kind]
    configure(context, authority)

    def answer(connection: socket.socket) -> None:
        connection.settimeout(5.0)
        with contextlib.suppress(OSError), context.wrap_socket(connection, server_side=True) as secured:
            secured.recv(4096)
            secured.sendall(ANSWER)

    def serve() -> None:
        with contextlib.suppress(OSError):
            while True:
                connection, _address = server.accept()
                threads.append(threading.Thread(target=answer, args=(connection,)))
                threads[-1].start()

    threads: list[threading.Thread] = []
    with socket.create_server(("127.0.0.1", 0)) as server:
        acceptor = threading.Thread(target=serve)
        acceptor.start()
        yield server.getsockname()[1], authority
        server.shutdown(socket.SHUT_RDWR)
    acceptor.join()
    for thread in threads:
        thread.join()
