"""The page in the local network, by HTTPS: this machine's address there, and the second listener."""

import asyncio
import datetime as dt
import ipaddress
import socket
import ssl
from collections.abc import Callable
from typing import TYPE_CHECKING

from starlette.types import ASGIApp

from pointit.bridges.web.config import WebConfig
from pointit.bridges.web.server.listener import HttpListener, open_port, url
from pointit.runtime.address_config import parse_address
from pointit.runtime.errors import ConfigError, ListenError, RefusedError
from pointit.runtime.host.name_lookup import lan_addresses
from pointit.runtime.host.state_file import site_folder
from pointit.runtime.host.windows_subsystem import lan_advice

if TYPE_CHECKING:
    from pointit.bridges.web.server.certificate import Certificate

PORTS = 10
"""Number of ports to try, from the configured one on."""


def choose_address(configured: str, addresses: list[str]) -> str:
    """Return the address to listen at: `configured`, or the first of this machine's `addresses`.

    Raises:
        ConfigError: If `configured` is none of a machine, or it is empty and there are no `addresses`.
    """
    if not configured:
        if not addresses:
            raise ConfigError(
                "this machine has no address in a local network: connect it to one, or name its "
                "address, as in --set web.lan_address=192.168.1.20"
            )
        return addresses[0]

    # One that is written down must be an address alone: browsers compare it with the certificate
    try:
        host, port = parse_address(configured)
        parsed = ipaddress.ip_address(host)
    except ValueError as error:
        raise ConfigError(
            f"lan_address: {configured!r} is not an address; write it like 192.168.1.20, or leave it empty"
        ) from error
    if port is not None:
        raise ConfigError(f"lan_address: {configured!r} has a port; write {host}, and lan_port: {port}")
    if parsed.is_unspecified or parsed.is_multicast:
        raise ConfigError(
            f"lan_address: {configured} is not the address of one machine; "
            "write one of this machine's, or leave it empty"
        )
    return str(parsed)


class Lan:
    """The page's listener in the local network, closed until `open`."""

    def __init__(
        self,
        config: WebConfig,
        site: str,
        app: ASGIApp,
        *,
        addresses: Callable[[], list[str]] = lan_addresses,
        advice: Callable[[int], str] = lan_advice,
    ) -> None:
        self._config = config
        self._folder = site_folder(site, "web")
        self._app = app
        self._addresses = addresses
        self._advice = advice
        self._listener: HttpListener | None = None
        self._opening = asyncio.Lock()
        self.address = ""
        """Address of the listener, or the last one."""
        self.url = ""
        """Address of the page, without a path; `""` if closed."""
        self.fingerprint = ""
        """Fingerprint of the certificate."""
        self.note = ""
        """A deviation from the configuration, or `""`."""

    def _certificate(self, addresses: list[str]) -> "Certificate":
        # imported only when the page is opened to the network: it takes 40 ms and 10 MB
        from pointit.bridges.web.server.certificate import obtain  # noqa: PLC0415

        now = dt.datetime.now(dt.UTC)
        return obtain(self._folder, addresses, socket.gethostname(), now)

    async def open(self) -> str:
        """Open the listener and return `url`. Does nothing if it is open.

        Raises:
            RefusedError: If there is no address or port, or the certificate cannot be kept; says what to do.
        """
        async with self._opening:
            if self._listener is not None:
                return self.url
            # All that may be impossible, before anything is open
            try:
                own_addresses = self._addresses()
                address = choose_address(self._config.lan_address, own_addresses)
                certificate = await asyncio.to_thread(self._certificate, [address, *own_addresses])
                tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
                tls.load_cert_chain(certificate.certificate, certificate.key)
                listening = self._bind(address)
            except (ConfigError, ListenError) as error:
                raise RefusedError(str(error)) from error

            # A cancelled start leaves no listener behind
            listener = HttpListener(self._app, listening, tls)
            try:
                await listener.start()
            except BaseException:
                await listener.close()
                raise

            self._listener = listener
            self.address = address
            self.url = url("https", address, listener.port)
            self.fingerprint = certificate.fingerprint
            advice = await asyncio.to_thread(self._advice, listener.port)
            notes = [certificate.warning, self._port_note(listener.port), advice]
            self.note = " ".join(note for note in notes if note)
            return self.url

    def _port_note(self, port: int) -> str:
        """Return a sentence if `port` is not the configured one, else `""`."""
        configured = self._config.lan_port
        if not configured or port == configured:
            return ""
        return f"port {configured} of {self.address} is taken: the page is at port {port}"

    async def close(self) -> None:
        """Close the listener and its connections."""
        async with self._opening:
            listener = self._listener
            self._listener = None
            self.url = ""
            if listener is not None:
                await listener.close()

    def _bind(self, address: str) -> socket.socket:
        first = self._config.lan_port
        end = min(first + PORTS, 65536) if first else 1
        for port in range(first, end):
            try:
                return open_port(address, port, "lan_port=...")
            except ListenError:
                continue
        return open_port(address, first, "lan_port=...")  # the reason is in the log
