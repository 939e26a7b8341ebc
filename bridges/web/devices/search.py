"""Search for wrists, lights and Home Assistants within reach of this machine."""

from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from pointit.bridges.web.devices.wire import ConnectDevice, ConnectedDevice
from pointit.plugins import GROUPS
from pointit.plugins.device_search import HOME_ASSISTANTS, IMPORT, SearchResult, import_options, search, words
from pointit.runtime.address_config import is_loopback
from pointit.runtime.config.plugins import FoundDevice

SEARCH_S = 3.0
"""Time of a search, s."""
MAX_FOUND = 100
HOME = "home-assistant"
KINDS = {"wrist": ("imu-source", "--imu"), "light": ("led-output", "--output")}
"""Kind of plug-in, and option that chooses a device, by kind of device."""


@dataclass(frozen=True, kw_only=True)
class FoundDevices:
    """Result of a search."""

    devices: tuple[ConnectedDevice, ...]
    """Devices as they would be stored, without the name of a person or strip."""
    uses: tuple[str, ...]
    """Option of `pointit run` that chooses each."""
    homes: tuple[tuple[str, str, str], ...] = ()
    """Label of each Home Assistant, the command that imports its lamps and switches, and its address."""
    problems: tuple[str, ...]
    """A sentence for each search that could not run."""

    def device(self, request: ConnectDevice) -> ConnectedDevice | None:
        """Return the device that `request` chooses, or None if it was not found."""
        for device in self.devices:
            if device.is_like(request):
                return device
        return None


def find() -> FoundDevices:
    """Return the devices within reach. Takes `SEARCH_S` or a little longer."""
    groups = {kind: GROUPS[kind] for kind, _ in KINDS.values()}
    results = search({**groups, HOME: HOME_ASSISTANTS}, SEARCH_S, lambda _done: None)

    homes: list[tuple[str, str, str]] = []
    for result in results:
        if result.kind != HOME:
            continue
        for home in result.found:
            command = f"{IMPORT} {import_options(home)}"
            homes.append((home.label, command, home.address))

    # Wrists first, then lights. An address is checked as one that a page sends.
    devices: list[ConnectedDevice] = []
    uses: list[str] = []
    problems = [f"{result.name}: {result.problem}" for result in results if result.problem]
    for device_kind, (plugin_kind, option) in KINDS.items():
        for result in results:
            if result.kind != plugin_kind:
                continue
            for found_device in result.found:
                try:
                    devices.append(_connected_device(device_kind, result, found_device))
                except ValidationError:
                    problems.append(f"{result.name}: a device has an address that cannot be used")
                else:
                    uses.append(f"{option} {words(result, found_device)}")

    return FoundDevices(
        devices=tuple(devices[:MAX_FOUND]),
        uses=tuple(uses[:MAX_FOUND]),
        homes=tuple(homes[:MAX_FOUND]),
        problems=tuple(problems[:MAX_FOUND]),
    )


def _connected_device(kind: str, result: SearchResult, found_device: FoundDevice) -> ConnectedDevice:
    """Return a device as it would be stored. Raises ValidationError if it cannot be."""
    label, _, _ = found_device.label.partition("; --set ")  # parameters, which are set here
    pixels = found_device.details.get("pixels", 0)
    if not isinstance(pixels, int | float):
        pixels = 0
    is_remote = _is_remote(found_device.details.get("ip", ""))
    values: dict[str, Any] = {
        "kind": kind,
        "plugin": result.name,
        "address": found_device.address,
        "name": "unnamed",
        "label": label[:400],
        "pixels": max(0, int(pixels)),
        "is_remote": is_remote,
    }
    return ConnectedDevice.model_validate(values)


def _is_remote(address: str | float) -> bool:
    """Return True if `address` is that of another machine."""
    return bool(address) and not is_loopback(str(address))
