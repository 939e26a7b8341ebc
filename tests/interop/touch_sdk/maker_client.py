# pyrefly: ignore-errors
# ruff: noqa: ANN001, ANN002, ANN003, ANN201, ANN202, ANN204
# (touch_sdk and its bleak 0.22 are in .venv-touch-sdk only)
"""The maker's client with a Bluetooth controller behind a TCP port; in .venv-touch-sdk.

    maker_client.py PORT

Prints each of its callbacks as a line of JSON, [name, arguments], and answers each pinch by a vibration.
"""

import asyncio
import json
import sys
from functools import partial
from uuid import UUID

import bleak
from bleak.backends.characteristic import BleakGATTCharacteristic
from bleak.backends.client import BaseBleakClient
from bleak.backends.scanner import AdvertisementData, BaseBleakScanner
from bleak.backends.service import BleakGATTService, BleakGATTServiceCollection
from bumble import core
from bumble.device import Device, Peer
from bumble.gatt import Characteristic as Gatt
from bumble.hci import Address
from bumble.transport import open_transport
from touch_sdk import Watch

FLAGS = {Gatt.Properties.READ: "read", Gatt.Properties.WRITE: "write", Gatt.Properties.NOTIFY: "notify"}


def text_of(uuid):
    return str(UUID(bytes=uuid.to_bytes(force_128=True)[::-1]))


class Service(BleakGATTService):
    handle = uuid = characteristics = None

    def __init__(self, found):
        super().__init__(found)
        self.handle, self.uuid, self.characteristics = found.handle, text_of(found.uuid), []

    def add_characteristic(self, characteristic):
        self.characteristics.append(characteristic)


class Characteristic(BleakGATTCharacteristic):
    handle = uuid = properties = service_uuid = service_handle = None
    descriptors = ()

    def __init__(self, found, service, size):
        super().__init__(found, lambda: size)
        self.handle, self.uuid = found.handle, text_of(found.uuid)
        self.properties = [name for flag, name in FLAGS.items() if found.properties & flag]
        self.service_uuid = service.uuid
        self.service_handle = service.handle

    def get_descriptor(self, specifier):
        del specifier

    def add_descriptor(self, descriptor):
        del descriptor


class Scanner(BaseBleakScanner):
    central = None

    def __init__(self, callback, service_uuids, *_arguments, **_options):
        super().__init__(callback, service_uuids)
        self.seen_devices = {}

    async def start(self):
        self.central.on("advertisement", self._on_advertisement)
        await self.central.start_scanning(active=False, filter_duplicates=False)

    async def stop(self):
        await self.central.stop_scanning()

    def set_scanning_filter(self, **options):
        del options

    def _on_advertisement(self, heard):
        kinds = core.AdvertisingData
        services = heard.data.get(kinds.COMPLETE_LIST_OF_128_BIT_SERVICE_CLASS_UUIDS) or ()
        manufacturer = heard.data.get(kinds.MANUFACTURER_SPECIFIC_DATA)
        data = AdvertisementData(
            local_name=None,
            manufacturer_data={} if manufacturer is None else dict([manufacturer]),
            service_data={},
            service_uuids=[text_of(each) for each in services],
            tx_power=None,
            rssi=heard.rssi,
            platform_data=(),
        )
        address = heard.address.to_string(with_type_qualifier=False)
        self.call_detection_callbacks(self.create_or_update_device(address, None, heard.address, data), data)


class Client(BaseBleakClient):
    central = None

    def __init__(self, device, **options):
        super().__init__(device, **options)
        self._target = device.details
        self._connection = None

    @property
    def mtu_size(self):
        return self._connection.att_mtu

    @property
    def is_connected(self):
        return self._connection is not None

    async def connect(self, **_options):
        self._connection = await self.central.connect(self._target)
        self._connection.on("disconnection", self._on_disconnection)
        peer = Peer(self._connection)
        await peer.request_mtu(517)
        await peer.discover_services()
        self.services = BleakGATTServiceCollection()
        for found in peer.services:
            service = Service(found)
            self.services.add_service(service)
            for each in await found.discover_characteristics():
                self.services.add_characteristic(Characteristic(each, service, self.mtu_size - 3))

    def _on_disconnection(self, _reason):
        self._connection = None

    async def disconnect(self):
        if self._connection is not None:
            await self._connection.disconnect()

    async def read_gatt_char(self, specifier, **_options):
        characteristic = self.services.get_characteristic(specifier)
        return bytearray(await characteristic.obj.read_value())

    async def write_gatt_char(self, characteristic, data, response):
        await characteristic.obj.write_value(bytes(data), with_response=response)

    async def start_notify(self, characteristic, callback, **_options):
        await characteristic.obj.subscribe(lambda value: callback(bytearray(value)))

    async def stop_notify(self, characteristic):
        await characteristic.obj.unsubscribe()

    async def _unsupported(self, *_arguments, **_options):
        raise NotImplementedError

    pair = unpair = get_services = read_gatt_descriptor = write_gatt_descriptor = _unsupported


def print_line(*content):
    print(json.dumps(content), flush=True)  # noqa: T201 - the answer


class PrintingWatch(Watch):
    """The maker's client, whose callbacks print."""

    def __init__(self):
        super().__init__()
        for name in ("back_button", "rotary", "touch_down", "touch_up", "touch_move", "touch_cancel"):
            setattr(self, f"on_{name}", partial(print_line, name))

    def on_connect(self):
        print_line("connect", self.hand.value, self.battery_percentage, self.touch_screen_resolution)

    def on_sensors(self, sensor_frame):
        print_line(
            "sensors",
            sensor_frame.angular_velocity,
            sensor_frame.acceleration,
            sensor_frame.orientation,
            sensor_frame.timestamp,
        )

    def on_tap(self):
        print_line("tap")
        self.trigger_haptics(0.5, 300)


async def main():
    transport = await open_transport(f"tcp-client:127.0.0.1:{sys.argv[1]}")
    central = Device.with_hci("maker", Address("F0:F1:F2:F3:F4:F5"), transport.source, transport.sink)
    await central.power_on()
    Scanner.central = Client.central = central
    bleak.get_platform_scanner_backend_type = lambda: Scanner
    bleak.get_platform_client_backend_type = lambda: Client
    await PrintingWatch().run()


if __name__ == "__main__":
    asyncio.run(main())
