"""Backends of bleak for a device in memory. Imported where bleak is installed."""

import asyncio
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from bleak.args import SizedBuffer
from bleak.backends.characteristic import BleakGATTCharacteristic
from bleak.backends.client import BaseBleakClient
from bleak.backends.descriptor import BleakGATTDescriptor
from bleak.backends.scanner import AdvertisementData, AdvertisementDataCallback, BaseBleakScanner
from bleak.backends.service import BleakGATTService, BleakGATTServiceCollection
from bleak.exc import BleakError

from pointit_lab.devices.wrists.wrist import Peripheral

RSSI_DBM = -60
MTU = 247


class Scanner(BaseBleakScanner):
    """A scanner without options."""

    def __init__(
        self,
        detection_callback: AdvertisementDataCallback | None,
        service_uuids: list[str] | None,
        _scanning_mode: str,
        **_options: Any,
    ) -> None:
        super().__init__(detection_callback, service_uuids)

    def tell(
        self,
        device: object,
        address: str,
        name: str | None,
        services: list[str],
        *,
        rssi: int,
        manufacturer_data: Mapping[int, bytes],
    ) -> None:
        """Pass an advertisement on; `device` is what a client gets as its details."""
        data = AdvertisementData(
            local_name=name,
            manufacturer_data={**manufacturer_data},
            service_data={},
            service_uuids=services,
            tx_power=None,
            rssi=rssi,
            platform_data=(),
        )
        self.call_detection_callbacks(
            self.create_or_update_device(address, address, name, device, data), data
        )


class Client(BaseBleakClient):
    """A client that neither pairs nor has descriptors."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        options.pop("services", None)
        super().__init__(*arguments, **options)

    async def pair(self, *_arguments: Any, **_options: Any) -> None:
        """Do nothing."""

    async def unpair(self) -> None:
        """Do nothing."""

    async def read_gatt_descriptor(
        self, descriptor: BleakGATTDescriptor, *, use_cached: bool = False, **_options: Any
    ) -> bytearray:
        """Raise: there are none."""
        raise NotImplementedError

    async def write_gatt_descriptor(self, descriptor: BleakGATTDescriptor, data: SizedBuffer) -> None:
        """Raise: there are none."""
        raise NotImplementedError


class MemoryScanner(Scanner):
    """Hears one device if it is there and not connected."""

    device: ClassVar[Peripheral]

    async def start(self) -> None:
        """Begin to hear."""
        self.seen_devices = {}
        self.device.listeners.add(self)
        asyncio.get_running_loop().call_soon(self.hear)

    async def stop(self) -> None:
        """Hear no longer."""
        self.device.listeners.discard(self)

    def hear(self) -> None:
        """Hear the device, if it advertises."""
        device = self.device
        if self not in device.listeners:
            return
        if not device.is_there or device.link is not None:  # a connected device does not advertise
            return
        wrist = device.wrist
        services = [wrist.advertised_service or wrist.service]
        self.tell(
            device,
            device.address,
            wrist.name,
            services,
            rssi=RSSI_DBM,
            manufacturer_data=wrist.manufacturer_data,
        )


class MemoryClient(Client):
    """A connection to one device."""

    device: ClassVar[Peripheral]

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._callbacks: dict[str, Callable[[bytearray], None]] = {}

    @property
    def mtu_size(self) -> int:
        """Return the size of a packet."""
        return MTU

    @property
    def is_connected(self) -> bool:
        """Return True while it is connected."""
        return self.device.link is self

    async def connect(self, pair: bool, **_options: Any) -> None:
        """Connect."""
        del pair
        if not self.device.is_there or self.device.link is not None:
            raise BleakError("not within reach")
        self.services = _services(self.device)
        self.device.link = self
        self.device.received.clear()
        self.device.wrist.connected()

    async def disconnect(self) -> None:
        """Disconnect. The device advertises again."""
        if self.is_connected:
            self.device.link = None

    async def read_gatt_char(
        self, characteristic: BleakGATTCharacteristic, *, use_cached: bool = False, **_options: Any
    ) -> bytearray:
        """Return a value."""
        del use_cached
        self._require_connection()
        return bytearray(self.device.wrist.values[characteristic.uuid])

    async def write_gatt_char(
        self,
        characteristic: BleakGATTCharacteristic,
        data: SizedBuffer,
        response: bool,
    ) -> None:
        """Write, and deliver the answers in the next turn of the loop."""
        del response
        self._require_connection()
        written = bytes(data)
        self.device.received.extend(written)
        for answer in self.device.wrist.write(characteristic.uuid, written):
            asyncio.get_running_loop().call_soon(self.notify, *answer)

    async def start_notify(
        self, characteristic: BleakGATTCharacteristic, callback: Callable[[bytearray], None], **_options: Any
    ) -> None:
        """Pass on notifications of a characteristic."""
        self._require_connection()
        self._callbacks[characteristic.uuid] = callback

    async def stop_notify(self, characteristic: BleakGATTCharacteristic) -> None:
        """Pass them on no longer."""
        self._callbacks.pop(characteristic.uuid, None)

    def notify(self, characteristic: str, data: bytes) -> None:
        """Pass on what the device sends."""
        callback = self._callbacks.get(characteristic)
        if callback is not None and self.is_connected:
            callback(bytearray(data))

    def lose(self) -> None:
        """Tell that the connection is lost."""
        if self._disconnected_callback is not None:
            self._disconnected_callback()

    def _require_connection(self) -> None:
        if not self.is_connected:
            raise BleakError("Not connected")


def backends(peripheral: Peripheral) -> tuple[type[MemoryScanner], type[MemoryClient]]:
    """Return the backends of an adapter that reaches `peripheral` alone."""
    return (
        type("OneScanner", (MemoryScanner,), {"device": peripheral}),
        type("OneClient", (MemoryClient,), {"device": peripheral}),
    )


def _services(peripheral: Peripheral) -> BleakGATTServiceCollection:
    collection = BleakGATTServiceCollection()
    service = BleakGATTService(None, 1, peripheral.wrist.service)
    collection.add_service(service)
    for handle, (uuid, properties) in enumerate(peripheral.wrist.characteristics.items(), 2):
        collection.add_characteristic(
            BleakGATTCharacteristic(None, handle, uuid, [*properties], lambda: MTU - 3, service)  # pyrefly: ignore[bad-argument-type]
        )
    return collection
