"""Bluetooth adapters: the door to bleak, scans that are shared, and errors as sentences.

No core: it waits for a radio.
"""

import asyncio
import contextlib
import weakref
from collections.abc import AsyncGenerator, Callable, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy

if TYPE_CHECKING:
    from bleak import BleakClient, BleakScanner
    from bleak.backends.client import BaseBleakClient
    from bleak.backends.device import BLEDevice
    from bleak.backends.scanner import AdvertisementData, BaseBleakScanner

END_S = 0.5
"""Time that an operating system may take to end a scan or a connection, s."""
CONNECT_S = 15.0
"""Time limit of connecting and reading the services, s."""

_scans: "weakref.WeakKeyDictionary[asyncio.AbstractEventLoop, dict[str, _Scan]]" = weakref.WeakKeyDictionary()

_NO_ADAPTER = (
    "this machine has no Bluetooth adapter that works: plug one in, and look whether `rfkill` blocks it"
)
_OFF = "Bluetooth is switched off: switch it on (`bluetoothctl power on`)"
_NO_PERMISSION = (
    "this program may not use Bluetooth: permit it in the system's settings (macOS: for the terminal), or on "
    "Linux join the group `bluetooth` and log in again"
)
_NO_SERVICE = (
    "the Bluetooth service of this machine does not answer: start it (`sudo systemctl start bluetooth`); a "
    "container needs the host's /run/dbus"
)


@dataclass(frozen=True)
class Radio:
    """An adapter: the backends of bleak that stand for it, or None for those of the operating system."""

    scanner: "type[BaseBleakScanner] | None" = None
    client: "type[BaseBleakClient] | None" = None


VIRTUAL_RADIOS: dict[str, Radio] = {}
"""Adapters in software, by the name that the parameter `adapter` gives. Tests add theirs."""


@dataclass(frozen=True)
class Advertisement:
    """A device that is within reach."""

    device: "BLEDevice"
    name: str
    services: frozenset[str]
    rssi_dbm: float | None
    manufacturer_data: Mapping[int, bytes] = field(default_factory=dict[int, bytes])
    """Data of manufacturers by the number of their company."""

    @property
    def address(self) -> str:
        """Return the address; on macOS an identifier that stands for it."""
        return self.device.address

    @property
    def label(self) -> str:
        """Return the name, the address and the signal for people."""
        strength = "" if self.rssi_dbm is None else f", {self.rssi_dbm:.0f} dBm"
        return f"{self.name or 'no name'} ({self.address}{strength})"


OnAdvertisement = Callable[[Advertisement], None]


@dataclass
class _Scan:
    """One scan of an adapter for all who search, since BlueZ refuses a second one of the same process."""

    listeners: set[OnAdvertisement] = field(default_factory=set[OnAdvertisement])
    lock: asyncio.Lock = field(default_factory=asyncio.Lock)
    scanner: "BleakScanner | None" = None

    def heard(self, device: "BLEDevice", data: "AdvertisementData") -> None:
        """Report an advertisement to all searches."""
        name = data.local_name or device.name or ""
        advertisement = Advertisement(
            device=device,
            name=name,
            services=frozenset(data.service_uuids),
            rssi_dbm=float(data.rssi),
            manufacturer_data=data.manufacturer_data,
        )
        for listener in [*self.listeners]:
            listener(advertisement)

    async def stop_unless_used(self) -> None:
        """Stop the scan if no search is running."""
        if not self.listeners and self.scanner is not None:
            ended = self.scanner
            self.scanner = None
            await ended.stop()


def require_bleak(name: str) -> None:
    """Check that bleak is installed, for the plug-in `name`. Raises ConfigError if it is not."""
    if find_spec("bleak") is None:
        raise ConfigError(f"{name} needs {remedy('ble')}")


@contextlib.asynccontextmanager
async def scanning(adapter: str, on_advertisement: OnAdvertisement) -> AsyncGenerator[None]:
    """Scan with `adapter` (`""`: the default one) and report advertisements in the event loop."""
    await asyncio.to_thread(_load, adapter)
    from bleak import BleakScanner  # noqa: PLC0415 - an extra

    scans = _scans.setdefault(asyncio.get_running_loop(), {})
    scan = scans.setdefault(adapter, _Scan())
    async with scan.lock:
        if scan.scanner is None:
            radio = VIRTUAL_RADIOS.get(adapter, Radio())
            scanner = BleakScanner(scan.heard, bluez=_bluez(adapter), backend=radio.scanner)
            await scanner.start()
            scan.scanner = scanner
        scan.listeners.add(on_advertisement)
    try:
        yield
    finally:
        scan.listeners.discard(on_advertisement)
        with contextlib.suppress(Exception):  # whatever a scan fails with at its end, the next one tells
            async with asyncio.timeout(END_S), scan.lock:
                await scan.stop_unless_used()


def client_of(device: "BLEDevice", adapter: str, on_lost: Callable[[], None]) -> "BleakClient":
    """Return a client of `device`, which is not connected yet."""
    from bleak import BleakClient  # noqa: PLC0415 - an extra

    radio = VIRTUAL_RADIOS.get(adapter, Radio())
    return BleakClient(
        device,
        lambda _client: on_lost(),
        timeout=CONNECT_S,
        bluez=_bluez(adapter),
        backend=radio.client,
    )


def describe_error(error: BaseException) -> str:
    """Return the reason for `error` of bleak or the operating system, and the remedy, in one clause."""
    from bleak.exc import (  # noqa: PLC0415 - an extra
        BleakBluetoothNotAvailableError,
        BleakCharacteristicNotFoundError,
        BleakGATTProtocolError,
    )

    # Errors of bleak have a reason, or name what is missing
    text = f"{type(error).__name__}: {error}".rstrip(": ")
    if isinstance(error, BleakBluetoothNotAvailableError):
        if error.reason.name.startswith("DENIED"):
            return _NO_PERMISSION
        return _OFF if error.reason.name == "POWERED_OFF" else _NO_ADAPTER
    if isinstance(error, BleakCharacteristicNotFoundError):
        return (
            f"it lacks the characteristic {error.char_specifier}: update its firmware by its maker's app, or "
            "name another one, if this is none of its kind"
        )
    if isinstance(error, BleakGATTProtocolError):
        return f"it refuses a command ({error.args[-1]}): update its firmware by its maker's app"

    # Errors of the operating system. D-Bus gives its own as text.
    is_denied = "AccessDenied" in text or "NotPermitted" in text
    if isinstance(error, PermissionError) or is_denied:
        return _NO_PERMISSION
    if isinstance(error, FileNotFoundError | ConnectionRefusedError) or "ServiceUnknown" in text:
        return _NO_SERVICE
    if isinstance(error, TimeoutError):
        return "it did not answer in time: bring it nearer, or charge it"
    return f"Bluetooth failed ({text.partition(chr(10))[0][:200]})"


def _load(adapter: str) -> None:
    """Import bleak with its backend, in a thread, since that would block the event loop too long."""
    from bleak.backends import client, scanner  # noqa: PLC0415 - an extra

    if adapter not in VIRTUAL_RADIOS:
        scanner.get_platform_scanner_backend_type()
        client.get_platform_client_backend_type()


def _bluez(adapter: str) -> Any:
    if not adapter or adapter in VIRTUAL_RADIOS:
        return {}
    return {"adapter": adapter}
