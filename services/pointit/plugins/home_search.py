"""Search for Home Assistants in the local network, which announce themselves."""

import shlex
from collections.abc import Sequence
from urllib.parse import urlsplit

from pointit.plugins.device_search import ShippedDevices
from pointit.runtime.config.config import Config
from pointit.runtime.config.plugins import DevicePlugin, FoundDevice
from pointit.runtime.host.service_browser import NetworkService, browse
from pointit.schemas.text import one_line

SERVICE = "_home-assistant._tcp"
MAX_LABEL = 100
IMPORT = "pointit map import home-assistant"
"""Command that uses a Home Assistant that was found."""


async def find_home_assistants(seconds: float) -> Sequence[FoundDevice]:
    """Return the Home Assistants that are found in a number of seconds.

    Raises:
        ConfigError: If the extra `discovery` is missing.
    """
    return [announced_home(each) for each in await browse(SERVICE, seconds)]


def announced_home(service: NetworkService) -> FoundDevice:
    """Return the Home Assistant that a service announces, whatever its properties hold."""
    name = service.properties.get("location_name") or service.name
    version = service.properties.get("version") or ""
    label = one_line(f"{name}, {version}" if version else name, MAX_LABEL)
    details: dict[str, str | float] = {
        "ip": service.address,
        "port": service.port,
        "version": one_line(version, MAX_LABEL),
    }
    return FoundDevice(_url_of(service), label, details)


def import_options(device: FoundDevice) -> str:
    """Return the options of `IMPORT` for a Home Assistant that was found."""
    return f"--url {shlex.quote(device.address)} --token-file ~/ha.token"


def _url_of(service: NetworkService) -> str:
    """Return the address that Home Assistant states for its network, or that of its machine."""
    stated = service.properties.get("internal_url") or ""
    try:
        parts = urlsplit(stated)
        is_usable = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:
        parts, is_usable = urlsplit(""), False
    if is_usable and "@" not in parts.netloc and stated.isprintable():
        return f"{parts.scheme}://{parts.netloc}"
    return f"http://{service.address}:{service.port}"


HOME_ASSISTANT = DevicePlugin(
    summary="Home Assistant", config=Config, argument="url", discover=find_home_assistants
)
HOME_ASSISTANTS = ShippedDevices(
    "home_assistants", "Home Assistant", **{"home-assistant": f"{__name__}:HOME_ASSISTANT"}
)
