"""Errors of Bluetooth in sentences, shared scans, and gestures of a button."""

import asyncio
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
from pointit.services.imu_bridge.ble import radio
from pointit.services.imu_bridge.ble.button import DOUBLE_S, HOLD_S, ButtonGestures
from pointit.services.imu_bridge.ble.metamotion import METAMOTION
from pointit.services.imu_bridge.ble.radio import VIRTUAL_RADIOS, Radio, describe_error, scanning
from pointit_lab.devices.ble import BleDevice, parameters
from pointit_lab.devices.wrists.metamotion import SimulatedMetaMotion

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


def test_machine_without_an_adapter_is_a_warning_and_a_failed_search(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(VIRTUAL_RADIOS, "broken", Radio(scanner=Broken))
    monkeypatch.setitem(VIRTUAL_RADIOS, "", Radio(scanner=Broken))
    said: list[str] = []

    class Health:
        def warn(self, _topic: str, sentence: str) -> None:
            said.append(sentence)

    async def main() -> None:
        around = Surroundings.detached()
        source = METAMOTION.make(METAMOTION.config(adapter="broken"), around)  # type: ignore[call-arg]
        monkeypatch.setattr(source, "_warnings", Health())
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(60.0):
                await source.run(lambda _item: None)
        assert METAMOTION.discover is not None
        with pytest.raises(ConfigError, match="this machine has no Bluetooth adapter"):
            await METAMOTION.discover(1.0)

    run_virtually(main())
    assert all("no Bluetooth adapter that works" in each for each in said)
    assert 5 <= len(said) <= 20  # with back-off


def test_searches_share_one_scan() -> None:
    device = BleDevice(SimulatedMetaMotion())

    async def main() -> None:
        heard: list[str] = []
        await device.plug()
        adapter = str(parameters(device)["adapter"])
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


def test_a_short_press_two_of_them_and_a_long_one_are_three_gestures() -> None:
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
