"""Bytes of the wrists by Bluetooth: golden frames, and any bytes."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas import Feedback
from pointit.services.imu_bridge.ble import metamotion_protocol as metamotion
from pointit.services.imu_bridge.ble import witmotion_protocol as witmotion
from pointit.services.imu_bridge.ble import xsens_dot_protocol as xsens_dot
from pointit.services.imu_bridge.ble.metamotion import MetaMotion, MetaMotionConfig
from pointit.services.imu_bridge.ble.witmotion_ble import WitMotionBle, WitMotionBleConfig
from pointit.services.imu_bridge.ble.wrist import Wrist
from pointit.services.imu_bridge.ble.xsens_dot import XsensDot
from pointit.services.imu_bridge.reading import RawReading, Reading

WRISTS: list[Wrist] = [MetaMotion(MetaMotionConfig()), WitMotionBle(WitMotionBleConfig()), XsensDot()]
STARTS = [b"", b"\x19\x07", b"\x11\x8c", b"\x55\x61", b"\x55\x71\x64\x00", b"\x19\x80"]


def test_quaternion_of_a_metamotion_is_scalar_first() -> None:
    found = metamotion.parse(bytes.fromhex("1907 1b9b703f 8c5e4dbd 077f1dbe 78029abe"))
    assert isinstance(found, metamotion.Orientation)
    assert found.orientation_xyzw == pytest.approx((-0.0501, -0.1538, -0.3008, 0.9399), abs=1e-4)
    assert math.hypot(*found.orientation_xyzw) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("frame", "meaning"),
    [
        ("010101", metamotion.ButtonState(is_down=True)),
        ("010100", metamotion.ButtonState(is_down=False)),
        ("118c633410", metamotion.Charge(0.99, 4.148)),
        ("13800001", metamotion.ModuleInfo(0x13, 0, 1)),
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
def test_notifications_of_a_metamotion(frame: str, meaning: metamotion.Notification | None) -> None:
    assert metamotion.parse(bytes.fromhex(frame)) == meaning


def test_nine_axes_of_a_metamotion_configure_the_magnetometer_before_the_start() -> None:
    commands = [each.hex() for each in metamotion.start("BMI270", magnetometer=True)]
    assert commands[:5] == ["19020113", "0303a803", "13032800", "1504040e", "150306"]
    assert commands.index("150101") < commands.index("190101")


def test_motor_of_a_metamotion_runs_at_once_and_its_led_flashes_in_the_colour() -> None:
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


def test_no_command_of_a_metamotion_is_longer_than_its_limit() -> None:
    cue = Feedback(stamp_ns=0, seq=1, cue="target", haptic_ms=(2000,) * 5, color=(255, 255, 255))
    every = (*metamotion.start("BMI160", magnetometer=True), *metamotion.teardown())
    assert max(len(each) for each in (*every, *(each for _, each in metamotion.cue(cue)))) <= 18


def test_frame_of_a_witmotion_is_in_si_units() -> None:
    frame = b"\x55\x61" + struct.pack("<9h", 0, 0, 2048, 16384, 0, -16384, 1, 2, 3)
    (found,) = witmotion.Framer().feed(frame)
    assert isinstance(found, witmotion.Motion)
    assert found.acceleration_mps2 == pytest.approx((0.0, 0.0, 9.80665))
    assert found.angular_velocity_radps == pytest.approx((math.radians(1000), 0.0, -math.radians(1000)))


@pytest.mark.parametrize(
    ("volts", "level"), [(2.0, 0.0), (3.4, 0.0), (3.45, 0.025), (3.93, 0.75), (4.3, 1.0)]
)
def test_charge_of_a_witmotion_follows_from_its_voltage(volts: float, level: float) -> None:
    assert witmotion.Volts(volts).level == pytest.approx(level)


@given(st.lists(st.integers(1, 60), max_size=12), st.binary(max_size=8), st.integers(1, 9))
def test_frames_of_a_witmotion_are_found_however_they_are_split(
    cuts: list[int], noise: bytes, count: int
) -> None:
    frame = b"\x55\x61" + struct.pack("<9h", 1, 2, 3, 4, 5, 6, 7, 8, 9)
    stream = noise.replace(b"\x55", b"") + frame * count
    framer = witmotion.Framer()
    found: list[object] = []
    for cut in cuts:
        found += framer.feed(stream[:cut])
        stream = stream[cut:]
        assert framer.kept < witmotion.FRAME_BYTES
    found += framer.feed(stream)
    assert len(found) == count
    assert len(set(found)) == 1


def test_payload_of_an_xsens_dot_is_microseconds_and_a_quaternion_with_the_scalar_first() -> None:
    found = xsens_dot.parse(struct.pack("<I4f", 1_000_000, 0.6, 0.0, 0.8, 0.0))
    assert found is not None
    assert found.time_us == 1_000_000
    assert found.orientation_xyzw == pytest.approx((0.0, 0.8, 0.0, 0.6))


def test_time_of_an_xsens_dot_goes_on_after_32_bits_and_a_small_step_back_remains_one() -> None:
    time = xsens_dot.UnwrappedTime()
    assert [time.ns(each) for each in (2**32 - 10, 5, 20, 4)] == [
        (2**32 - 10) * 1000,
        (2**32 + 5) * 1000,
        (2**32 + 20) * 1000,
        (2**32 + 4) * 1000,
    ]


@pytest.mark.parametrize("wrist", WRISTS, ids=lambda wrist: type(wrist).__name__)
@given(st.lists(st.tuples(st.sampled_from(STARTS), st.binary(max_size=80)), max_size=20))
def test_any_bytes_of_a_wrist_give_finite_unit_readings_or_none(
    wrist: Wrist, notifications: list[tuple[bytes, bytes]]
) -> None:
    wrist.begin("")
    for start, rest in notifications:
        for characteristic in wrist.notifications:
            for item in wrist.received(characteristic, start + rest, 7):
                if isinstance(item, Reading):
                    assert math.hypot(*item.world_from_sensor) == pytest.approx(1.0, abs=1e-6)
                elif isinstance(item, RawReading):
                    assert all(map(math.isfinite, (*item.acceleration_mps2, *item.angular_velocity_radps)))
