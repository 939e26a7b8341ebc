"""HTTP requests of which only the status of the response is read.

No body is read or decoded, and no redirect is followed. httpx limits the size of a head.
"""

import asyncio
import contextlib
import ipaddress
from urllib.parse import urlsplit
from urllib.request import getproxies, proxy_bypass

import httpx

from pointit.runtime.address_config import parse_address


async def post(request: httpx.Request) -> tuple[int, str]:
    """Send `request`, by the proxy of the environment, if any. Return status and reason of the response.

    Raises:
        OSError: If the file of SSL_CERT_FILE cannot be used.
        ValueError, ImportError, httpx.InvalidURL: If the proxy cannot be used.
        httpx.TransportError: If there is no response.
    """
    context = await asyncio.to_thread(httpx.create_ssl_context)  # reads certificates
    proxy = proxy_address(request.url)
    async with httpx.AsyncClient(verify=context, proxy=proxy, trust_env=False, timeout=None) as client:  # noqa: S113 - the caller has one
        response = await client.send(request, stream=True)
        await response.aclose()
        return response.status_code, response.reason_phrase


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
    names = (url.netloc.decode("ascii"), url.host, f"[{url.host}]")  # no_proxy may have ::1 or [::1]
    if not address or is_local(str(url)) or any(map(proxy_bypass, names)):
        return None
    address = address if "://" in address else f"http://{address}"
    parse_address(urlsplit(address).netloc.rpartition("@")[2])
    return address
