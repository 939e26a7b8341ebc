"""Search for WLED controllers in the network, by mDNS and their web interface."""

import asyncio
import contextlib
import json
from collections.abc import Sequence
from typing import Any, cast

from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.host.name_lookup import look_up
from pointit.runtime.host.service_browser import NetworkService, browse

SERVICE = "_wled._tcp"

ANSWER_S = 1.0
"""Maximum time for the description of a controller, s."""

MAX_INFO_BYTES = 65536


async def find_wled(seconds: float) -> Sequence[FoundDevice]:
    """Return the WLED controllers that are found in a number of seconds.

    Raises:
        ConfigError: If the extra `discovery` is missing.
    """
    services = await browse(SERVICE, seconds)
    return await asyncio.gather(*(_describe(service) for service in services))


async def _describe(service: NetworkService) -> FoundDevice:
    host = service.host if await _is_resolved(service.host) else service.address
    return described(host, service.name, await _ask(service.address, service.port))


async def _is_resolved(host: str) -> bool:
    """Return True if this machine finds the address of `host`, which many do not for `.local`."""
    if not host:
        return False
    try:
        async with asyncio.timeout(ANSWER_S / 2):
            await look_up(host)
    except OSError:  # TimeoutError is one
        return False
    return True


async def _ask(address: str, port: int) -> object:
    """Return the controller's description of itself, or None. Follows no redirect and uses no proxy."""
    answer = b""
    with contextlib.suppress(OSError):  # TimeoutError is one
        async with asyncio.timeout(ANSWER_S):
            reader, writer = await asyncio.open_connection(address, port)
            try:
                writer.write(f"GET /json/info HTTP/1.0\r\nHost: {address}\r\n\r\n".encode())
                while len(answer) < MAX_INFO_BYTES and (part := await reader.read(MAX_INFO_BYTES)):
                    answer += part
            finally:
                writer.close()
    head, _, body = answer.partition(b"\r\n\r\n")
    try:
        return json.loads(body) if head.split(b" ")[1:2] == [b"200"] else None
    except (ValueError, RecursionError):
        return None


def described(host: str, name: str, info: object) -> FoundDevice:
    """Return the controller at `host`, given its `/json/info`, which may be anything."""
    values = cast("dict[str, Any]", info) if isinstance(info, dict) else {}
    leds = values.get("leds")
    pixels = cast("dict[str, Any]", leds).get("count") if isinstance(leds, dict) else None
    own_name, version = values.get("name"), values.get("ver")
    words = [str(own_name or name)]
    details: dict[str, str | float] = {}
    if isinstance(pixels, int):
        details["pixels"] = pixels
        words.append(f"{pixels} pixels")
    if version:
        details["version"] = str(version)
        words.append(f"WLED {version}")
    return FoundDevice(host, ", ".join(words), details)
