"""The page in the local network, by HTTPS: this machine's address there, and the second listener.

No core: it opens sockets.
"""

import asyncio
import datetime as dt
import socket
import ssl
from collections.abc import Callable
from typing import TYPE_CHECKING

from starlette.types import ASGIApp

from pointit.bridges.web.config import WebConfig
from pointit.bridges.web.lan_address import choose_address
from pointit.bridges.web.server.listener import HttpListener, open_port, url
from pointit.runtime.errors import ConfigError, ListenError, RefusedError
from pointit.runtime.host.name_lookup import lan_addresses
from pointit.runtime.host.state_file import site_folder
from pointit.runtime.host.windows_subsystem import lan_advice
from pointit.runtime.machine import this_machine

if TYPE_CHECKING:
    from pointit.bridges.web.server.certificate import Certificate

PORTS = 10
"""Number of ports to try, from the configured one on."""


class Lan:
    """The page's listener in the local network, closed until `open`.

    A page that is open there from its start calls `listen` before it is present: an address that is printed
    then is one that answers.
    """

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
        self._listening: socket.socket | None = None
        """Socket at which clients wait for `open`, or None."""
        self._own_addresses: list[str] = []
        """Addresses of this machine when it was opened: those of the certificate."""
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
        return obtain(self._folder, addresses, this_machine().host_name, now)

    def listen(self) -> None:
        """Open the port, at which clients wait for `open`. Does nothing if it is open.

        Raises:
            RefusedError: If there is no address or port; says what to do.
        """
        if self._listening is not None:
            return
        self._own_addresses = self._addresses()
        try:
            address = choose_address(self._config.lan_address, self._own_addresses)
            self._listening = self._bind(address)
        except (ConfigError, ListenError) as error:
            raise RefusedError(str(error)) from error
        self.address = address

    async def open(self) -> str:
        """Open the listener and return `url`. Does nothing if it is open.

        Raises:
            RefusedError: If there is no address or port, or the certificate cannot be kept; says what to do.
        """
        async with self._opening:
            if self._listener is not None:
                return self.url
            self.listen()
            try:
                await self._serve()
            except BaseException as error:
                self._hang_up()  # neither an error nor a cancelled start leaves an open port behind
                if isinstance(error, ConfigError):
                    raise RefusedError(str(error)) from error
                raise
            return self.url

    async def _serve(self) -> None:
        """Accept connections at the open port. Raises ConfigError: the certificate cannot be kept."""
        assert self._listening is not None  # noqa: S101 - `listen` was called before
        own_addresses = [self.address, *self._own_addresses]
        certificate = await asyncio.to_thread(self._certificate, own_addresses)
        tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        tls.load_cert_chain(certificate.certificate, certificate.key)
        listener = HttpListener(self._app, self._listening, tls)
        advice = await asyncio.to_thread(self._advice, listener.port)
        try:
            await listener.start()
        except BaseException:
            await listener.close()
            raise

        self._listener = listener
        self.url = url("https", self.address, listener.port)
        self.fingerprint = certificate.fingerprint
        notes = [certificate.warning, self._port_note(listener.port), advice]
        self.note = " ".join(note for note in notes if note)

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
            self._hang_up()

    def _hang_up(self) -> None:
        """Close the port."""
        if self._listening is not None:
            self._listening.close()
            self._listening = None

    def _bind(self, address: str) -> socket.socket:
        first = self._config.lan_port
        end = min(first + PORTS, 65536) if first else 1
        for port in range(first, end):
            try:
                return open_port(address, port, "lan_port=...")
            except ListenError:
                continue
        return open_port(address, first, "lan_port=...")  # the reason is in the log
