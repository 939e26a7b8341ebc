"""A fake device by Bluetooth Low Energy: a radio in memory, in place of the operating system's."""

import itertools

from pointit.services.imu_bridge.ble.radio import VIRTUAL_RADIOS, Radio
from pointit.testing.devices import FakeDevice
from pointit_lab.devices.wrists.wrist import Peripheral, SimulatedWrist

_numbers = itertools.count(1)


class BleDevice(FakeDevice):
    """A simulated wrist alone within reach of an adapter of its own."""

    def __init__(self, wrist: SimulatedWrist) -> None:
        super().__init__()
        number = next(_numbers)
        self.adapter = f"memory{number}"
        """Adapter by which the program reaches it."""
        address = f"F0:00:00:00:{number // 256 % 256:02X}:{number % 256:02X}"
        self.peripheral = Peripheral(wrist, address)
        self.address = {"sensor": address, "adapter": self.adapter}
        self.received = self.peripheral.received
        VIRTUAL_RADIOS[self.adapter] = self._radio()

    async def plug(self) -> None:
        """Advertise."""
        self.peripheral.is_there = True
        for listener in [*self.peripheral.listeners]:
            listener.hear()

    async def unplug(self) -> None:
        """Vanish, as when its battery is taken out."""
        self.peripheral.is_there = False
        link = self.peripheral.link
        self.peripheral.link = None
        if link is not None:
            link.lose()

    async def send(self, data: bytes) -> None:
        """Notify of `data` in its stream, if it is connected and streams."""
        wrist = self.peripheral.wrist
        link = self.peripheral.link
        if link is not None and wrist.is_streaming:
            link.notify(wrist.stream, data)

    def close(self) -> None:
        """Remove the adapter."""
        VIRTUAL_RADIOS.pop(self.adapter, None)

    def _radio(self) -> Radio:
        from pointit_lab.devices.ble_backend import backends  # noqa: PLC0415 - needs an extra

        scanner, client = backends(self.peripheral)
        return Radio(scanner=scanner, client=client)
