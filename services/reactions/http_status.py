"""HTTP requests that read only the status of the response, within limits of time and size.

A server can neither stall the event loop nor fill the memory: the connection ends after the headers, no body
is read or decoded, and no redirect is followed.

No core: it waits for a server.
"""

import contextlib
import importlib
import ipaddress
import ssl
from collections.abc import Iterable
from typing import Any, cast
from urllib.parse import urlsplit
from urllib.request import getproxies, proxy_bypass

import httpcore
import httpx

from pointit.runtime.address_config import parse_address

MAX_HEAD_BYTES = 16384
"""Maximum size of a response up to the end of its headers, and of interim responses before it."""
MAX_READ_BYTES = 1024
"""Maximum size of one read: the event loop runs other tasks between two reads."""


def open_pool(url: httpx.URL) -> httpcore.AsyncConnectionPool:
    """Return a pool of connections to the server of `url`, by the proxy of the environment, if any.

    Blocks while it reads certificates: call it in a thread.

    Raises:
        OSError: If the file of SSL_CERT_FILE cannot be used.
        ValueError, ImportError, httpx.InvalidURL: If the proxy cannot be used.
    """
    return httpcore.AsyncConnectionPool(
        ssl_context=httpx.create_ssl_context(), proxy=_proxy_to(url), network_backend=_LimitedBackend()
    )


async def post(pool: httpcore.AsyncConnectionPool, request: httpx.Request) -> tuple[int, str]:
    """Send `request` and return status and reason of the response. Its body is not read.

    Raises:
        httpcore.NetworkError, httpcore.ProtocolError, httpcore.ProxyError: If there is no response, or its
            head exceeds `MAX_HEAD_BYTES`.
    """
    async with pool.stream(
        request.method, _address(request.url), headers=request.headers.raw, content=request.content
    ) as response:
        extensions: dict[str, Any] = {**response.extensions}
        reason: bytes = extensions.get("reason_phrase", b"")
        return response.status, reason.decode("ascii", errors="replace")


def is_local(url: str) -> bool:
    """Return True if the host of `url` is this machine or in its network, to which no proxy leads.

    These are loopback, private and link-local addresses, names without a dot, and those below `.local` and
    `.localhost`.
    """
    host = httpx.URL(url).host.rstrip(".")
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(host).is_private
    return "." not in host or host.endswith((".local", ".localhost"))


def proxy_address(url: httpx.URL) -> str | None:
    """Return the address of the proxy that the environment names for `url`, or None.

    Raises:
        ValueError: If it is no address.
    """
    proxies = getproxies()
    address = proxies.get(url.scheme) or proxies.get("all")
    if not address or is_local(str(url)):
        return None
    host_and_port = url.netloc.decode("ascii")
    names = (host_and_port, url.host, f"[{url.host}]")  # no_proxy may have ::1 or [::1]
    if any(map(proxy_bypass, names)):
        return None

    # The environment often names a host without a scheme, and may have a user and password
    if "://" not in address:
        address = f"http://{address}"
    _user, _at, proxy_host_and_port = urlsplit(address).netloc.rpartition("@")
    parse_address(proxy_host_and_port)
    return address


def _proxy_to(url: httpx.URL) -> httpcore.Proxy | None:
    """Return the proxy for `url`, or None. The package for its protocol is imported, so that it fails now."""
    address = proxy_address(url)
    if address is None:
        return None
    proxy = httpx.Proxy(address)
    if proxy.url.scheme.startswith("socks"):
        importlib.import_module("socksio")
    return httpcore.Proxy(url=_address(proxy.url), auth=proxy.raw_auth)


def _address(url: httpx.URL) -> httpcore.URL:
    return httpcore.URL(scheme=url.raw_scheme, host=url.raw_host, port=url.port, target=url.raw_path)


class _LimitedBackend(httpcore.AsyncNetworkBackend):
    def __init__(self) -> None:
        self._backend = cast("httpcore.AsyncNetworkBackend", httpcore.AnyIOBackend())

    async def connect_tcp(
        self,
        host: str,
        port: int,
        timeout: float | None = None,  # noqa: ASYNC109 - the base's
        local_address: str | None = None,
        socket_options: Iterable[Any] | None = None,
    ) -> httpcore.AsyncNetworkStream:
        stream = await self._backend.connect_tcp(host, port, timeout, local_address, socket_options)
        return _LimitedStream(stream)


class _LimitedStream(httpcore.AsyncNetworkStream):
    """Stream of which at most `MAX_HEAD_BYTES` can be read."""

    def __init__(self, stream: httpcore.AsyncNetworkStream, remaining_bytes: int = MAX_HEAD_BYTES) -> None:
        self._stream = stream
        self._remaining_bytes = remaining_bytes

    async def read(self, max_bytes: int, timeout: float | None = None) -> bytes:  # noqa: ASYNC109
        if not self._remaining_bytes:
            raise httpcore.RemoteProtocolError(f"the headers of its answer exceed {MAX_HEAD_BYTES} bytes")
        count = min(max_bytes, MAX_READ_BYTES, self._remaining_bytes)
        data = await self._stream.read(count, timeout)
        self._remaining_bytes -= len(data)
        return data

    async def write(self, buffer: bytes, timeout: float | None = None) -> None:  # noqa: ASYNC109
        await self._stream.write(buffer, timeout)

    async def aclose(self) -> None:
        await self._stream.aclose()

    async def start_tls(
        self,
        ssl_context: ssl.SSLContext,
        server_hostname: str | None = None,
        timeout: float | None = None,  # noqa: ASYNC109
    ) -> httpcore.AsyncNetworkStream:
        # what a proxy has answered before counts, too
        stream = await self._stream.start_tls(ssl_context, server_hostname, timeout)
        return _LimitedStream(stream, self._remaining_bytes)

    def get_extra_info(self, info: str) -> Any:
        return self._stream.get_extra_info(info)
