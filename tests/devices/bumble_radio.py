"""A Bluetooth adapter without a radio: Google's stack `bumble` on both sides, from advertising to GATT.

The program's side is a backend of bleak on one bumble device. The wrist's side is a GATT server on another
one. Both controllers and the link between them are virtual, so that it also runs in virtual time.
"""

import asyncio
import contextlib
import functools
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from typing import Any, ClassVar, cast
from uuid import UUID

from bleak.args import SizedBuffer
from bleak.assigned_numbers import CharacteristicPropertyName
from bleak.backends.characteristic import BleakGATTCharacteristic
from bleak.backends.device import BLEDevice
from bleak.backends.service import BleakGATTService, BleakGATTServiceCollection
from bleak.exc import BleakError, BleakGATTProtocolError
from bumble import core, gatt
from bumble.device import Advertisement, Connection, Peer
from bumble.hci import Address
from bumble.link import LocalLink

from pointit.services.imu_bridge.ble.radio import VIRTUAL_RADIOS, Radio
from pointit_lab.devices.ble_backend import Client, Scanner
from pointit_lab.devices.wrists.wrist import SimulatedWrist
from tests.devices.bumble_wrist import BumbleWrist, numbers, virtual_device

NAMES: dict[gatt.Characteristic.Properties, CharacteristicPropertyName] = {
    gatt.Characteristic.Properties.READ: "read",
    gatt.Characteristic.Properties.WRITE: "write",
    gatt.Characteristic.Properties.WRITE_WITHOUT_RESPONSE: "write-without-response",
    gatt.Characteristic.Properties.NOTIFY: "notify",
}


def uuid_text(uuid: core.UUID) -> str:
    """Return a UUID as bleak writes it."""
    return str(UUID(bytes=uuid.to_bytes(force_128=True)[::-1]))


class BumbleScanner(Scanner):
    """bleak's scanner on a bumble device."""

    central: ClassVar[Any]

    async def start(self) -> None:
        self.seen_devices = {}
        self.central.on("advertisement", self._on_advertisement)
        await self.central.start_scanning(active=False)

    async def stop(self) -> None:
        self.central.remove_listener("advertisement", self._on_advertisement)
        await self.central.stop_scanning()

    def _on_advertisement(self, heard: Advertisement) -> None:
        name = heard.data.get(core.AdvertisingData.COMPLETE_LOCAL_NAME)
        services: Any = (
            heard.data.get(core.AdvertisingData.COMPLETE_LIST_OF_128_BIT_SERVICE_CLASS_UUIDS) or ()
        )
        address = heard.address.to_string(with_type_qualifier=False)
        uuids = [uuid_text(each) for each in services]
        manufacturer: Any = heard.data.get(core.AdvertisingData.MANUFACTURER_SPECIFIC_DATA)
        data = {} if manufacturer is None else dict([manufacturer])
        self.tell(heard.address, address, name or None, uuids, rssi=heard.rssi, manufacturer_data=data)


class BumbleClient(Client):
    """bleak's client on a bumble device."""

    central: ClassVar[Any]

    def __init__(self, device: BLEDevice, **options: Any) -> None:
        super().__init__(device, **options)
        self._target: Address = device.details
        self._connection: Connection | None = None

    @property
    def mtu_size(self) -> int:
        return 23 if self._connection is None else self._connection.att_mtu

    @property
    def is_connected(self) -> bool:
        return self._connection is not None

    async def connect(self, pair: bool, **_options: Any) -> None:
        del pair
        try:
            connection = await self.central.connect(self._target, timeout=self._timeout)
        except core.BaseBumbleError as error:
            raise BleakError(str(error)) from error
        self._connection = connection
        discovery = asyncio.ensure_future(self._discover(Peer(connection)))
        connection.on("disconnection", self._on_disconnection)
        connection.on("disconnection", functools.partial(_cancel, discovery))
        try:
            self.services = await discovery
        except asyncio.CancelledError:
            if self.is_connected:
                raise
            raise BleakError("disconnected while it was connecting") from None

    async def _discover(self, peer: Peer) -> BleakGATTServiceCollection:
        services = BleakGATTServiceCollection()
        await peer.request_mtu(517)  # as operating systems do
        await peer.discover_services()
        for service in peer.services:
            found = BleakGATTService(service, service.handle, uuid_text(service.uuid))
            services.add_service(found)
            discovered: list[Any] = await cast("Any", service).discover_characteristics()
            for each in discovered:
                names: list[CharacteristicPropertyName] = [
                    name for flag, name in NAMES.items() if each.properties & flag
                ]
                characteristic = BleakGATTCharacteristic(
                    each, each.handle, uuid_text(each.uuid), names, lambda: self.mtu_size - 3, found
                )
                services.add_characteristic(characteristic)
        return services

    async def disconnect(self) -> None:
        if self._connection is not None:
            with contextlib.suppress(core.BaseBumbleError):
                await self._connection.disconnect()

    async def read_gatt_char(
        self, characteristic: BleakGATTCharacteristic, *, use_cached: bool = False, **_options: Any
    ) -> bytearray:
        del use_cached
        self._require_connection()
        return bytearray(await characteristic.obj.read_value())

    async def write_gatt_char(
        self,
        characteristic: BleakGATTCharacteristic,
        data: SizedBuffer,
        response: bool,
    ) -> None:
        self._require_connection()
        try:
            await characteristic.obj.write_value(bytes(data), with_response=response)
        except core.ProtocolError as error:
            raise BleakGATTProtocolError(error.error_code or 0) from error

    async def start_notify(
        self, characteristic: BleakGATTCharacteristic, callback: Callable[[bytearray], None], **_options: Any
    ) -> None:
        self._require_connection()

        def on_value(value: bytes) -> None:
            callback(bytearray(value))

        await characteristic.obj.subscribe(on_value)

    async def stop_notify(self, characteristic: BleakGATTCharacteristic) -> None:
        await characteristic.obj.unsubscribe()

    def _require_connection(self) -> None:
        if self._connection is None:
            raise BleakError("Not connected")

    def _on_disconnection(self, _reason: int) -> None:
        self._connection = None
        if self._disconnected_callback is not None:
            self._disconnected_callback()


def _cancel(task: asyncio.Future[Any], _reason: int) -> None:
    task.cancel()


class Air:
    """Wrists within reach of one virtual adapter."""

    def __init__(self, link: LocalLink, adapter: str) -> None:
        self._link = link
        self.adapter = adapter

    async def wrist(self, wrist: SimulatedWrist) -> BumbleWrist:
        """Return a wrist that does not advertise yet."""
        return BumbleWrist(await virtual_device(self._link, wrist.name), wrist)


@asynccontextmanager
async def air() -> AsyncGenerator[Air]:
    """Provide a virtual adapter, by whose name sources of orientations reach its wrists."""
    link = LocalLink()
    central = await virtual_device(link, "central")
    adapter = f"bumble{next(numbers)}"
    VIRTUAL_RADIOS[adapter] = Radio(
        scanner=type("Scanner", (BumbleScanner,), {"central": central}),
        client=type("Client", (BumbleClient,), {"central": central}),
    )
    try:
        yield Air(link, adapter)
    finally:
        del VIRTUAL_RADIOS[adapter]
        await central.power_off()
