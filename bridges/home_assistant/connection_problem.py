"""Why there is no connection to a Home Assistant, with the remedy, in one sentence.

No core: it waits for a network.
"""

import asyncio
import socket
from collections.abc import Mapping
from urllib.parse import urlsplit

from pointit.bridges.home_assistant.config import HomeAssistantConfig
from pointit.bridges.home_assistant.home_websocket import (
    CONNECT_TIMEOUT_S,
    GREETING,
    messages_in,
    open_websocket,
)
from pointit.runtime.address_config import format_address
from pointit.runtime.host.tls_errors import TlsServer, certificate_error_in, encrypts, tls_problem
from pointit.schemas.text import one_line, system_reason

REDIRECT = range(300, 400)
BAD_REQUEST = 400
NOT_FOUND = 404
_GATEWAY = "the proxy at {url} does not reach Home Assistant ({status}): start it"
LOGIN_PAGE = (
    "a login page is in front of {url} ({status}), and PointIt has no login for it: write the address of "
    "Home Assistant itself as `url`, or have the proxy pass /api/websocket on"
)
STATUS_PROBLEMS: Mapping[int, str] = {
    BAD_REQUEST: "a server answers at {url}, and refuses the connection (400): add the proxy in front of "
    "Home Assistant to `trusted_proxies` there, have it pass WebSockets on, or write the address of Home "
    "Assistant itself as `url`",
    401: LOGIN_PAGE,
    403: "Home Assistant at {url}, or a proxy in front of it, blocks this machine (403): look for its "
    "address in ip_bans.yaml there, which wrong logins lead to, and in the rules of the proxy",
    **dict.fromkeys((502, 503, 504), _GATEWAY),
}
"""Meaning of statuses of HTTP, with the remedy."""
AUTHORITY_HINT = "set the variable SSL_CERT_FILE to a file with its authority's certificate"
PROBE_TIMEOUT_S = 3.0
WEBSOCKET_PATH = "/api/websocket"
MAX_REASON = 200
"""Characters of an address or an error that are shown."""


def no_home_assistant(config: HomeAssistantConfig, reason: str) -> str:
    """Return the sentence for a server that is no Home Assistant."""
    return f"{config.url} is no Home Assistant ({reason}): correct `url`, its usual port is 8123"


def _status_problem(config: HomeAssistantConfig, status: int, headers: Mapping[str, str]) -> str:
    """Return the meaning of a status of HTTP, with the remedy, or `""` if it is that of any server."""
    path = urlsplit(config.url).path
    if status in REDIRECT:
        return _redirect_problem(config, status, headers.get("Location", ""))
    if status == NOT_FOUND and path:
        address = config.url.removesuffix(path)
        return f"no Home Assistant is at {path} of {address} (404): write {address} as `url`"
    return STATUS_PROBLEMS.get(status, "").format(url=config.url, status=status)


def _redirect_problem(config: HomeAssistantConfig, status: int, location: str) -> str:
    """Return the meaning of a redirect. A page of logins loses the path of the request, a new address not."""
    login_page = LOGIN_PAGE.format(url=config.url, status=status)
    try:
        redirected = urlsplit(location)
    except ValueError:  # some text that is no address
        return login_page
    scheme = redirected.scheme.replace("ws", "http")
    address = one_line(f"{scheme}://{redirected.netloc}", MAX_REASON)
    keeps_path = redirected.path == urlsplit(config.websocket_url).path and not redirected.query
    if not keeps_path or scheme not in ("https", "http") or "@" in redirected.netloc:
        return login_page
    if scheme == "http" and config.websocket_url.startswith("wss"):
        return (
            f"the server at {config.url} refers to {address}, which does not encrypt: have the proxy pass "
            f"{WEBSOCKET_PATH} on to Home Assistant"
        )
    address += redirected.path.removesuffix(WEBSOCKET_PATH)
    return f"the server at {config.url} refers to another address: write {address} as `url`"


async def connection_problem(config: HomeAssistantConfig, error: Exception) -> str:
    """Return the meaning of an error of a connection, with the remedy."""
    from websockets.exceptions import InvalidStatus  # noqa: PLC0415 - an extra

    parts = urlsplit(config.url)
    host = parts.hostname or ""
    is_encrypted = config.websocket_url.startswith("wss")
    port = parts.port or (443 if is_encrypted else 80)

    # An answer of HTTP. That of 400, or one without a meaning, may be of a server that wants TLS
    status = 0
    problem = ""
    if isinstance(error, InvalidStatus):
        status = error.response.status_code
        problem = _status_problem(config, status, error.response.headers)
    may_encrypt = not isinstance(error, OSError) and (not problem or status == BAD_REQUEST)
    if may_encrypt and not is_encrypted and await encrypts(host, port, PROBE_TIMEOUT_S):
        encrypted_url = f"https://{format_address(host, port)}{parts.path}"
        return f"the server at {config.url} encrypts: write {encrypted_url} as `url`"
    if status:
        return problem or no_home_assistant(config, f"it answers {status}")

    # The network
    if isinstance(error, socket.gaierror):
        return (
            f"the name {host} in `url` is not known in this network ({system_reason(error, MAX_REASON)}): "
            "correct it, or write the IP address"
        )
    if isinstance(error, TimeoutError):
        return f"no Home Assistant answers at {config.url} within {CONNECT_TIMEOUT_S:g} s: correct `url`"

    if is_encrypted and not isinstance(error, ConnectionRefusedError):
        problem = await _encryption_problem(config, host, port, error)
        if problem:
            return problem
    if not isinstance(error, OSError):
        return no_home_assistant(config, "it does not answer as one")
    return (
        f"no Home Assistant answers at {config.url} ({system_reason(error, MAX_REASON)})"
        ": start it, or correct `url`, its usual port is 8123"
    )


async def _encryption_problem(config: HomeAssistantConfig, host: str, port: int, error: Exception) -> str:
    """Return the reason for which a connection by TLS failed, and the remedy, else `""`.

    That a server does not encrypt is said only if a Home Assistant has answered there without encryption.
    """
    parts = urlsplit(config.url)
    is_refused = certificate_error_in(error) is not None
    if not is_refused and not await encrypts(host, port, PROBE_TIMEOUT_S):
        plain_address = f"{format_address(host, port)}{parts.path}"
        if await _begins_without_encryption(plain_address):
            return (
                f"the server at {config.url} does not encrypt: write http://{plain_address} as `url` (the "
                "token can then be read in your network)"
            )
    server = TlsServer(
        host=host,
        port=port,
        name=f"the server at {parts.netloc}",
        authority_hint=AUTHORITY_HINT,
        certificate_hint="write an address that asks for none, such as that of Home Assistant itself",
    )
    return await tls_problem(server, error)


async def _begins_without_encryption(address: str) -> bool:
    """Return True if a Home Assistant begins at `address` without encryption. It gets no token."""
    from websockets.exceptions import ConnectionClosed, InvalidHandshake  # noqa: PLC0415 - an extra

    try:
        async with (
            asyncio.timeout(PROBE_TIMEOUT_S),
            open_websocket(f"ws://{address}{WEBSOCKET_PATH}") as websocket,
        ):
            greeting = messages_in(await websocket.recv())
    except (OSError, EOFError, UnicodeError, InvalidHandshake, ConnectionClosed):
        return False
    return [message.get("type") for message in greeting] == [GREETING]
