"""Search for wrists that advertise."""

import asyncio
from collections.abc import Sequence

from pointit.runtime.config.plugins import Discover, FoundDevice
from pointit.runtime.errors import ConfigError
from pointit.services.imu_bridge.ble.radio import Advertisement, describe_error, require_bleak, scanning
from pointit.services.imu_bridge.ble.wrist import Kind


def discover_ble(kind: Kind, adapter: str = "") -> Discover:
    """Return the search for wrists of a `kind`. Searches in one event loop share one scan."""

    async def discover(seconds: float) -> Sequence[FoundDevice]:
        require_bleak("the search by Bluetooth")
        advertisements: dict[str, Advertisement] = {}

        def on_advertisement(advertisement: Advertisement) -> None:
            if kind.includes(advertisement):
                advertisements[kind.identify(advertisement)] = advertisement

        try:
            async with scanning(adapter, on_advertisement):
                await asyncio.sleep(seconds)
        except Exception as error:  # errors of bleak and its backends, which differ by system
            raise ConfigError(describe_error(error)) from error
        return [_found(text, each) for text, each in advertisements.items()]

    return discover


def _found(text: str, advertisement: Advertisement) -> FoundDevice:
    details: dict[str, str | float] = {"name": advertisement.name}
    if advertisement.rssi_dbm is not None:
        details["rssi_dbm"] = advertisement.rssi_dbm
    return FoundDevice(text, advertisement.label, details)
