"""Wrists by Bluetooth: golden frames, any bytes, errors in sentences, shared scans, gestures of a button."""

import asyncio
import math
import struct
from collections.abc import Callable

import pytest
from bleak.backends.scanner import AdvertisementDataCallback, BaseBleakScanner
from bleak.exc import (
    BleakBluetoothNotAvailableError,
    BleakBluetoothNotAvailableReason,
    BleakDBusError,
    BleakError,
)
from hypothesis import given
from hypothesis import strategies as st

from pointit.plugins import ConfigError, Surroundings
from pointit.runtime.virtual_time import run_virtually
from pointit.schemas import Feedback
from pointit.services.imu_bridge.ble import metamotion, radio, xsens_dot
from pointit.services.imu_bridge.ble import witmotion_ble as witmotion
from pointit.services.imu_bridge.ble.metamotion import METAMOTION
from pointit.services.imu_bridge.ble.radio import VIRTUAL_RADIOS, Radio, describe_error, scanning
from pointit.services.imu_bridge.ble.wrist import DOUBLE_S, HOLD_S, ButtonChange, ButtonGestures
from pointit.services.imu_bridge.sources import Battery, RawReading, Reading
from pointit_lab.devices.ble import BleDevice
from pointit_lab.devices.wrists.metamotion import SimulatedMetaMotion


def test_quaternion_of_a_metamotion_is_scalar_first() -> None:
    reading = metamotion.parse(bytes.fromhex("1907 1b9b703f 8c5e4dbd 077f1dbe 78029abe"), 9)
    assert isinstance(reading, Reading)
    assert reading.stamp_ns == 9
    assert reading.world_from_sensor == pytest.approx((-0.0501, -0.1538, -0.3008, 0.9399), abs=1e-4)
    assert math.hypot(*reading.world_from_sensor) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("frame", "item"),
    [
        ("010101", ButtonChange(is_down=True)),
        ("010100", ButtonChange(is_down=False)),
        ("118c633410", Battery(0.99, 4.148)),
        ("13800001", metamotion.ModuleInfo(0x13, 0)),
        ("1980", metamotion.ModuleInfo(0x19, None)),
        ("1907" + "00000000" * 4, None),
        ("1907" + "0000803f" * 4, None),
        ("1907" + "0000c07f" * 4, None),
        ("1907" + "0000807f" + "00000000" * 3, None),
        ("1907" + "0000803f", None),
        ("19", None),
        ("", None),
    ],
)
def test_notifications_of_a_metamotion(frame: str, item: object) -> None:
    assert metamotion.parse(bytes.fromhex(frame), 9) == item


def test_metamotion_configures_its_magnetometer_before_the_start() -> None:
    commands = [each.hex() for each in metamotion.start("BMI270", magnetometer=True)]
    assert commands[:5] == ["19020113", "0303a803", "13032800", "1504040e", "150306"]
    assert commands.index("150101") < commands.index("190101")


def test_metamotion_cue_runs_the_motor_and_flashes_the_led() -> None:
    assert metamotion.buzz(150).hex() == "0801f8960000"
    cue = Feedback(stamp_ns=0, seq=1, cue="target", haptic_ms=(150, 50, 80), color=(0, 255, 8))
    commands = [(pause_s, each.hex()) for pause_s, each in metamotion.cue(cue)]
    green = "02030002" + "1f00" + "0000" + "2c01" + "0000" + "2c01" + "0000" + "01"
    blue = "02030202" + "0100" + "0000" + "2c01" + "0000" + "2c01" + "0000" + "01"
    assert commands == [
        (0.0, "0801f8960000"),
        (0.0, "020201"),
        (0.0, green),
        (0.0, blue),
        (0.0, "020101"),
        (0.2, "0801f8500000"),
    ]
    assert metamotion.cue(Feedback(stamp_ns=0, seq=1, cue="target")) == []


def test_metamotion_commands_are_within_their_length_limit() -> None:
    cue = Feedback(stamp_ns=0, seq=1, cue="target", haptic_ms=(2000,) * 5, color=(255, 255, 255))
    every = (*metamotion.start("BMI160", magnetometer=True), *metamotion.teardown())
    assert max(len(each) for each in (*every, *(each for _, each in metamotion.cue(cue)))) <= 18


def test_frame_of_a_witmotion_is_in_si_units() -> None:
    frame = b"\x55\x61" + struct.pack("<9h", 0, 0, 2048, 16384, 0, -16384, 1, 2, 3)
    (found,) = witmotion.Framer().feed(frame, 9)
    assert isinstance(found, RawReading)
    assert found.stamp_ns == 9
    assert found.acceleration_mps2 == pytest.approx((0.0, 0.0, 9.80665))
    assert found.angular_velocity_radps == pytest.approx((math.radians(1000), 0.0, -math.radians(1000)))


@pytest.mark.parametrize(
    ("volts", "level"), [(2.0, 0.0), (3.4, 0.0), (3.45, 0.025), (3.93, 0.75), (4.3, 1.0)]
)
def test_charge_of_a_witmotion_follows_from_its_voltage(volts: float, level: float) -> None:
    assert witmotion.charge_level(volts) == pytest.approx(level)


@given(st.lists(st.integers(1, 60), max_size=12), st.binary(max_size=8), st.integers(1, 9))
def test_frames_of_a_witmotion_are_found_however_they_are_split(
    cuts: list[int], noise: bytes, count: int
) -> None:
    frame = b"\x55\x61" + struct.pack("<9h", 1, 2, 3, 4, 5, 6, 7, 8, 9)
    stream = noise.replace(b"\x55", b"") + frame * count
    framer = witmotion.Framer()
    found: list[object] = []
    for cut in cuts:
        found += framer.feed(stream[:cut], 9)
        stream = stream[cut:]
        assert len(framer._rest) < witmotion.FRAME_BYTES
    found += framer.feed(stream, 9)
    assert len(found) == count
    assert len(set(found)) == 1


def test_xsens_dot_payload_is_microseconds_and_scalar_first_quaternion() -> None:
    reading = xsens_dot.parse(struct.pack("<I4f", 1_000_000, 0.6, 0.0, 0.8, 0.0), 9)
    assert reading is not None
    assert (reading.stamp_ns, reading.device_time_ns) == (9, 1_000_000_000)
    assert reading.world_from_sensor == pytest.approx((0.0, 0.8, 0.0, 0.6))


Reason = BleakBluetoothNotAvailableReason


@pytest.mark.parametrize(
    ("error", "remedy"),
    [
        (BleakBluetoothNotAvailableError("no", Reason.NO_BLUETOOTH), "no Bluetooth adapter"),
        (BleakBluetoothNotAvailableError("no", Reason.POWERED_OFF), "bluetoothctl power on"),
        (BleakBluetoothNotAvailableError("no", Reason.DENIED_BY_USER), "may not use Bluetooth"),
        (BleakDBusError("org.freedesktop.DBus.Error.AccessDenied", []), "group `bluetooth`"),
        (BleakDBusError("org.freedesktop.DBus.Error.ServiceUnknown", []), "systemctl start bluetooth"),
        (FileNotFoundError(2, "No such file"), "systemctl start bluetooth"),
        (PermissionError(13, "denied"), "may not use Bluetooth"),
        (TimeoutError(), "did not answer in time"),
        (BleakError("le-connection-abort-by-local"), "le-connection-abort-by-local"),
    ],
)
def test_errors_of_bluetooth_say_what_to_do(error: Exception, remedy: str) -> None:
    assert remedy in describe_error(error)


def test_source_without_bleak_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(_name: str) -> None:
        return None

    monkeypatch.setattr(radio, "find_spec", missing)
    with pytest.raises(ConfigError, match=r"metamotion needs .*\bble\b"):
        METAMOTION.check(METAMOTION.config())


class Broken(BaseBleakScanner):
    """A scanner of a machine without Bluetooth."""

    def __init__(
        self, callback: AdvertisementDataCallback | None, *_arguments: object, **_options: object
    ) -> None:
        super().__init__(callback, None)

    async def start(self) -> None:
        raise BleakBluetoothNotAvailableError("none", Reason.NO_BLUETOOTH)

    async def stop(self) -> None:
        raise AssertionError


async def test_missing_adapter_is_a_warning_and_a_failed_search(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(VIRTUAL_RADIOS, "broken", Radio(scanner=Broken))
    monkeypatch.setitem(VIRTUAL_RADIOS, "", Radio(scanner=Broken))
    said: list[str] = []

    class Health:
        def warn(self, _topic: str, sentence: str) -> None:
            said.append(sentence)

    around = Surroundings.detached()
    source = METAMOTION.make(METAMOTION.config(adapter="broken"), around)  # pyrefly: ignore[unexpected-keyword]
    monkeypatch.setattr(source, "_warnings", Health())
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(60.0):
            await source.run(lambda _item: None)
    assert METAMOTION.discover is not None
    with pytest.raises(ConfigError, match="this machine has no Bluetooth adapter"):
        await METAMOTION.discover(1.0)
    assert all("no Bluetooth adapter that works" in each for each in said)
    assert 5 <= len(said) <= 20  # with back-off


def test_searches_share_one_scan() -> None:
    device = BleDevice(SimulatedMetaMotion())

    async def main() -> None:
        heard: list[str] = []
        await device.plug()
        adapter = str(device.address["adapter"])
        async with scanning(adapter, lambda found: heard.append(found.name)):
            await asyncio.sleep(0.1)
            async with scanning(adapter, lambda found: heard.append(found.address)):
                assert len(device.peripheral.listeners) == 1
                await device.plug()
        assert sorted(heard) == sorted(["MetaWear", "MetaWear", device.peripheral.address])
        assert not device.peripheral.listeners

    try:
        run_virtually(main())
    finally:
        device.close()


def test_short_double_and_long_presses_are_three_gestures() -> None:
    gestures = ButtonGestures()
    assert (gestures.down(0.0), gestures.up(0.1)) == (None, None)
    assert gestures.due_s == pytest.approx(0.1 + DOUBLE_S)
    assert gestures.wait(0.1 + DOUBLE_S) == "press"
    assert [gestures.down(1.0), gestures.up(1.1), gestures.down(1.2), gestures.up(1.3)][-1] == "double"
    gestures.down(2.0)
    assert gestures.wait(2.0 + HOLD_S) == "hold"
    gestures.up(3.0)
    gestures.down(4.0)
    assert gestures.up(4.0 + HOLD_S) == "hold"
    assert gestures.due_s is None


Changes = st.lists(st.tuples(st.floats(0.0, 2.0), st.booleans()), max_size=12)


@given(Changes)
def test_gestures_are_at_most_one_a_press_whatever_comes(changes: list[tuple[float, bool]]) -> None:
    gestures = ButtonGestures()
    now_s = 0.0
    count = presses = 0

    def wait_until(end_s: float) -> int:
        found = 0
        while (due_s := gestures.due_s) is not None and due_s <= end_s:
            found += gestures.wait(due_s) is not None
            assert gestures.due_s is None or gestures.due_s > due_s
        return found

    for pause_s, is_down in changes:
        now_s += pause_s
        count += wait_until(now_s)
        change: Callable[[float], str | None] = gestures.down if is_down else gestures.up
        count += change(now_s) is not None
        presses += is_down
    count += wait_until(now_s + HOLD_S + DOUBLE_S)
    assert gestures.due_s is None
    assert count <= presses
    assert bool(count) == bool(presses)
