"""One tolerance of a quaternion's norm for all sources: within, it is normalized; beyond, it is refused."""

import json
import math
import struct
from collections.abc import Callable
from pathlib import Path

import pytest
from pythonosc.osc_message_builder import build_msg

from pointit.runtime.errors import ConfigError
from pointit.schemas import WristSample
from pointit.schemas.base import NORM_TOLERANCE
from pointit.services.imu_bridge.ble import metamotion, xsens_dot
from pointit.services.imu_bridge.network.osc import OscConfig, OscDecoder
from pointit.services.imu_bridge.network.udp import UdpConfig, UdpDecoder
from pointit.services.imu_bridge.serial.text_line import TextFramer
from pointit.services.imu_bridge.serial.witmotion import FULL_SCALE, WitMotionFramer
from pointit.services.imu_bridge.serial.ximu3 import Ximu3Framer
from pointit.services.imu_bridge.sources import Item, Reading, fault
from pointit.services.imu_bridge.streams import unit_rotation
from pointit.sim.recordings import read_imu_csv
from pointit_lab.devices.serial_formats import witmotion_packet, ximu3_binary

Quaternion = tuple[float, float, float, float]
XYZW: Quaternion = (0.5, -0.5, 0.5, 0.5)


def first(items: list[Item]) -> Quaternion | None:
    return next((item.world_from_sensor for item in items if isinstance(item, Reading)), None)


def by_line(q: Quaternion) -> Quaternion | None:
    x, y, z, w = q
    return first(TextFramer().feed(f"\n{w} {x} {y} {z}\n".encode(), 0))


def by_json(q: Quaternion) -> Quaternion | None:
    return first(
        list(UdpDecoder(UdpConfig()).items(json.dumps(dict(zip("xyzw", q, strict=True))).encode(), 0))
    )


def by_osc(q: Quaternion) -> Quaternion | None:
    x, y, z, w = q
    return first(list(OscDecoder(OscConfig()).items(build_msg("/quaternion", [w, x, y, z]).dgram, 0)))


def by_ximu3(q: Quaternion) -> Quaternion | None:
    x, y, z, w = q
    return first(Ximu3Framer().feed(ximu3_binary("Q", 1, w, x, y, z), 0))


def by_witmotion(q: Quaternion) -> Quaternion | None:
    x, y, z, w = (round(value * FULL_SCALE) for value in q)
    return first(WitMotionFramer(configure=False, baud=0).feed(witmotion_packet(0x59, w, x, y, z), 0))


def by_metamotion(q: Quaternion) -> Quaternion | None:
    x, y, z, w = q
    item = metamotion.parse(b"\x19\x07" + struct.pack("<4f", w, x, y, z), 0)
    return item.world_from_sensor if isinstance(item, Reading) else None


def by_xsens_dot(q: Quaternion) -> Quaternion | None:
    x, y, z, w = q
    reading = xsens_dot.parse(struct.pack("<I4f", 1, w, x, y, z), 0)
    return None if reading is None else reading.world_from_sensor


def by_tracker(q: Quaternion) -> Quaternion | None:
    return unit_rotation(q, "xyzw")


def by_plugin(q: Quaternion) -> Quaternion | None:
    return None if fault(Reading(0, q)) else XYZW


def by_message(q: Quaternion) -> Quaternion | None:
    return WristSample(stamp_ns=1, seq=1, orientation_xyzw=q).orientation_xyzw


SOURCES: list[Callable[[Quaternion], Quaternion | None]] = [
    by_line, by_json, by_osc, by_ximu3, by_witmotion, by_metamotion, by_xsens_dot, by_tracker, by_plugin,
    by_message,
]  # fmt: skip


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("norm", [1.0 - NORM_TOLERANCE + 1e-4, 0.99, 1.004, 1.0 + NORM_TOLERANCE - 1e-4])
def test_norm_within_the_tolerance_is_normalized(
    source: Callable[[Quaternion], Quaternion | None], norm: float
) -> None:
    x, y, z, w = XYZW
    turned = source((norm * x, norm * y, norm * z, norm * w))
    assert turned is not None
    assert turned == pytest.approx(XYZW, abs=1e-4)
    assert math.hypot(*turned) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("norm", [0.0, 1.0 - NORM_TOLERANCE - 1e-3, 1.0 + NORM_TOLERANCE + 1e-3, math.nan])
def test_norm_beyond_the_tolerance_is_refused(
    source: Callable[[Quaternion], Quaternion | None], norm: float
) -> None:
    if source is by_witmotion and math.isnan(norm):
        return  # has whole numbers
    x, y, z, w = XYZW
    try:
        turned = source((norm * x, norm * y, norm * z, norm * w))
    except ValueError:
        turned = None
    assert turned is None


def test_quaternions_of_two_decimals_are_accepted_in_a_recording(tmp_path: Path) -> None:
    path = tmp_path / "arm.csv"
    path.write_text("t,qw,qx,qy,qz\n0,0.71,0.00,0.71,0.12\n")
    assert read_imu_csv(path).orientation_xyzw[0] == pytest.approx([0.0, 0.7020, 0.1186, 0.7020], abs=1e-3)
    path.write_text("t,qw,qx,qy,qz\n0,0.71,0.00,0.71,0.37\n")
    with pytest.raises(
        ConfigError, match=r"columns 'qw' to 'qz': a quaternion of norm 1 was expected, got norm 1\.07"
    ):
        read_imu_csv(path)
