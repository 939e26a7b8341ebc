"""Events of a watch with the Touch SDK on the bus."""

from pointit.schemas.topics import BUTTON, IMU, STEP
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.service import ImuBridge
from pointit_lab.devices.ble import BleDevice
from pointit_lab.devices.wrists.touch_sdk_watch import SimulatedTouchSdkWatch
from tests.support.bench import in_virtual_time, memory_bench, until

PINCH, CLOCKWISE, COUNTERCLOCKWISE = "12020801", "2a0b08ffffffffffffffffff01", "2a020801"


@in_virtual_time
async def test_pinch_and_crown_are_numbered_events_of_the_person() -> None:
    device = BleDevice(SimulatedTouchSdkWatch())
    try:
        async with memory_bench() as bench:
            samples, presses = bench.collect(IMU, "anna"), bench.collect(BUTTON, "anna")
            steps = bench.collect(STEP, "anna")
            config = ImuBridgeConfig.model_validate({"source": "touch_sdk", "touch_sdk": device.address})
            bench.start(ImuBridge, config, user="anna")
            await device.plug()
            await until(lambda: device.peripheral.wrist.is_streaming)
            await device.send(SimulatedTouchSdkWatch().frame((0.0, 0.0, 0.0, 1.0)))
            for message in (CLOCKWISE, PINCH, COUNTERCLOCKWISE, PINCH):
                await device.send(bytes.fromhex(message))
            await until(lambda: len(steps) == 2 and len(presses) == 2 and bool(samples))
            assert [(each.by, each.seq, each.source) for each in steps] == [
                (1, 1, "device"),
                (-1, 2, "device"),
            ]
            assert [(each.gesture, each.seq) for each in presses] == [("press", 1), ("press", 2)]
    finally:
        device.close()
