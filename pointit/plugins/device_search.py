"""Search of all installed plug-ins for devices, and for Home Assistants in the local network."""

import asyncio
import contextlib
import queue
import shlex
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from typing import Any, cast
from urllib.parse import urlsplit

from pointit.runtime.address_config import format_address
from pointit.runtime.config.config import Config
from pointit.runtime.config.plugins import DevicePlugin, FoundDevice, PluginGroup
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.name_lookup import NetworkService, browse
from pointit.schemas.printable import is_printable
from pointit.schemas.text import one_line

TIMEOUT_S = 2.0
"""Time after its seconds at which a search is cancelled. After this time once more it is given up."""

LONGEST_WAIT_S = 0.5
"""Python may see a Ctrl-C that comes just before a wait only after it."""

SERVICE = "_home-assistant._tcp"
MAX_LABEL = 100
IMPORT = "pointit map import home-assistant"
"""Command that uses a Home Assistant that was found."""


class ShippedDevices(PluginGroup[DevicePlugin]):
    """Devices of this package that are only searched: those of others join in another way."""

    def __init__(self, kind: str, noun: str, **paths: str) -> None:
        """Create with the paths `MODULE:NAME` of `DevicePlugin`s by name."""
        super().__init__(f"pointit.{kind}", DevicePlugin, noun)
        self._paths = paths

    def find(self) -> dict[str, tuple[EntryPoint, ...]]:
        """Return the devices by name."""
        entries: dict[str, tuple[EntryPoint, ...]] = {}
        for name, path in self._paths.items():
            entries[name] = (EntryPoint(name, path, self.group),)
        return entries

    def package(self, name: str) -> str:
        """Return the package that brings `name`."""
        return "pointit" if name in self._paths else super().package(name)


@dataclass(frozen=True, kw_only=True)
class SearchResult:
    """Result of the search of one plug-in."""

    kind: str
    """The plug-in's kind, a key of `pointit.plugins.GROUPS`."""
    name: str
    found: tuple[FoundDevice, ...] = ()
    problem: str = ""
    """One sentence if the search failed, else `""`."""


def words(result: SearchResult, device: FoundDevice) -> str:
    """Return `NAME:ADDRESS`, as a word of a shell, that chooses a found device."""
    word = result.name
    if device.address:
        word = f"{result.name}:{device.address}"
    return shlex.quote(word)


def search(
    groups: Mapping[str, PluginGroup[Any]], seconds: float, tell: Callable[[int], None]
) -> list[SearchResult]:
    """Return the results of all plug-ins that can search, in the order of their groups and names.

    Each has a thread with an event loop of its own. Threads that do not end are left behind: the process must
    end without them.

    Args:
        groups: groups of `DevicePlugin`s by kind.
        seconds: time for each search.
        tell: called with the number of finished plug-ins.
    """
    searches: list[tuple[str, str]] = []
    for kind, group in groups.items():
        searches += [(kind, name) for name in group.names]
    answers = queue.SimpleQueue[tuple[tuple[str, str], SearchResult | None]]()
    results: dict[tuple[str, str], SearchResult | None] = {}
    for kind, name in searches:
        arguments = (groups[kind], kind, name, seconds, answers)
        threading.Thread(target=_run, args=arguments, name=f"search {name}", daemon=True).start()

    # Report progress until all have answered, or the last one has exceeded its time
    until_s = time.monotonic() + seconds + 2 * TIMEOUT_S
    while len(results) < len(searches):
        tell(len(results))
        remaining_s = until_s - time.monotonic()
        try:
            search_key, result = answers.get(timeout=max(0.0, min(remaining_s, LONGEST_WAIT_S)))
        except queue.Empty:
            if remaining_s <= 0.0:
                break
            continue
        results[search_key] = result

    # In the order of the searches, not of the answers. Those without an answer have a problem.
    ordered: list[SearchResult] = []
    for kind, name in searches:
        if (kind, name) not in results:
            problem = _hangs(groups[kind], name)
            ordered.append(SearchResult(kind=kind, name=name, problem=problem))
            continue
        result = results[kind, name]
        if result is not None:
            ordered.append(result)
    return ordered


def _hangs(group: PluginGroup[Any], name: str) -> str:
    return f"{group.label(name)} did not end its search: update or uninstall {group.package(name)}"


def _run(
    group: PluginGroup[Any],
    kind: str,
    name: str,
    seconds: float,
    answers: queue.SimpleQueue[tuple[tuple[str, str], SearchResult | None]],
) -> None:
    """Search with one plug-in in this thread, and put the result: None if the plug-in has no search."""

    async def put_result() -> None:
        result = await _searched(group, kind, name, seconds)
        answers.put(((kind, name), result))

    with contextlib.suppress(BaseException):  # of loops that do not close: the result is known by then
        asyncio.run(put_result())


async def _searched(group: PluginGroup[Any], kind: str, name: str, seconds: float) -> SearchResult | None:
    limit = asyncio.timeout(None)
    try:
        plugin = cast("DevicePlugin", group.get(name))  # imports it, which may take long
        if plugin.discover is None:
            return None
        async with limit:
            limit.reschedule(asyncio.get_running_loop().time() + seconds + TIMEOUT_S)
            results = cast("object", await plugin.discover(seconds))
    except ConfigError as error:
        return SearchResult(kind=kind, name=name, problem=str(error))
    except BaseException as error:  # noqa: BLE001 - code of others; its result is a sentence
        if limit.expired():
            return SearchResult(kind=kind, name=name, problem=_hangs(group, name))
        reason = f"{type(error).__name__}: {error}"
        problem = f"search of {group.label(name)} failed ({reason})"
        return SearchResult(kind=kind, name=name, problem=problem)
    if not isinstance(results, Sequence):
        return SearchResult(kind=kind, name=name, problem=_no_devices(group, name, results))
    devices = cast("Sequence[object]", results)
    for device in devices:
        if not isinstance(device, FoundDevice):
            return SearchResult(kind=kind, name=name, problem=_no_devices(group, name, device))
    return SearchResult(kind=kind, name=name, found=tuple(cast("Sequence[FoundDevice]", devices)))


def _no_devices(group: PluginGroup[Any], name: str, result: object) -> str:
    kind = type(result).__name__
    return f"search of {group.label(name)} found a {kind} instead of a FoundDevice"


async def find_home_assistants(seconds: float) -> Sequence[FoundDevice]:
    """Return the Home Assistants that are found in a number of seconds.

    Raises:
        ConfigError: If the extra `discovery` is missing.
    """
    return [announced_home(service) for service in await browse(SERVICE, seconds)]


def announced_home(service: NetworkService) -> FoundDevice:
    """Return the Home Assistant that a service announces, whatever its properties hold."""
    # Anybody in the network may announce anything, so texts are cut, and another host is named
    name = service.properties.get("location_name") or service.name
    version = service.properties.get("version") or ""
    address = _url_of(service)
    shown_name = f"{name}, {version}" if version else name
    label = one_line(shown_name, MAX_LABEL)
    label += f", announced by {service.address}"
    host = urlsplit(address).hostname
    if host not in (service.address, service.host.rstrip(".").lower()):
        label += f"; it names another host, {host}: send no token there unless that is yours"
    details: dict[str, str | float] = {
        "ip": service.address,
        "port": service.port,
        "version": one_line(version, MAX_LABEL),
    }
    return FoundDevice(address, label, details)


def import_options(device: FoundDevice) -> str:
    """Return the options of `IMPORT` for a Home Assistant that was found."""
    return f"--url {shlex.quote(device.address)} --token-file ~/ha.token"


def _url_of(service: NetworkService) -> str:
    """Return the address that Home Assistant states for its network, or that of its machine."""
    # An address with a user or odd characters may be a trap, and is not used
    stated = service.properties.get("internal_url") or ""
    try:
        parts = urlsplit(stated)
        is_web = parts.scheme in ("http", "https") and bool(parts.hostname)
        is_usable = is_web and parts.port != 0
    except ValueError:
        parts = urlsplit("")
        is_usable = False
    has_user = "@" in parts.netloc
    if is_usable and not has_user and is_printable(stated):
        return f"{parts.scheme}://{parts.netloc}"
    return f"http://{format_address(service.address, service.port)}"


HOME_ASSISTANT = DevicePlugin(
    summary="Home Assistant", config=Config, argument="url", discover=find_home_assistants
)
HOME_ASSISTANTS = ShippedDevices(
    "home_assistants", "Home Assistant", **{"home-assistant": f"{__name__}:HOME_ASSISTANT"}
)
