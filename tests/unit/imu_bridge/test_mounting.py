"""Mountings: the arm for a sensor that is worn in each documented way, and a measured mounting."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion, from_roll_pitch_yaw
from pointit.runtime.clock import WallClock
from pointit.schemas import Health, ImuSample, SetMounting, SetMountingReply
from pointit.schemas.topics import HEALTH, IMU, SET_MOUNTING
from pointit.services.imu_bridge.arm_frame import MOUNTINGS, ArmFrame
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.service import ImuBridge
from pointit.services.imu_bridge.simulated import SimulatedConfig
from pointit.services.imu_bridge.stored_mounting import MountingSelection, StoredMountings
from tests.support.bench import Bench, memory_bench, until

ANNA = "anna"
TURNED = from_roll_pitch_yaw(0.5, -0.2, 0.3)


def ask(quaternion: Quaternion | None, *, relative: bool = False) -> SetMounting:
    return SetMounting(sensor_from_arm_xyzw=quaternion, is_relative=relative)


def kept(
    config: ImuBridgeConfig, quaternion: Quaternion, before: StoredMountings | None = None
) -> StoredMountings:
    after = MountingSelection(config, before).set(ask(quaternion), 1)
    assert after is not None
    return after


def test_relative_mounting_is_applied_to_the_one_in_use() -> None:
    wearing = MountingSelection(ImuBridgeConfig(mounting="metamotion"))
    wearing.set(ask(TURNED, relative=True), 1)
    expected = rotation.multiply(MOUNTINGS["metamotion"], TURNED)
    assert wearing.sensor_from_arm == pytest.approx(expected)
    wearing.set(ask(TURNED, relative=True), 2)
    assert wearing.sensor_from_arm == pytest.approx(rotation.multiply(expected, TURNED))
    assert wearing.set(ask(rotation.IDENTITY, relative=True), 3) is None  # only asks
    wearing.set(ask(TURNED), 4)
    assert wearing.sensor_from_arm == pytest.approx(TURNED)
    wearing.set(ask(None), 5)
    assert wearing.sensor_from_arm == MOUNTINGS["metamotion"]
    assert "as configured (metamotion)" in wearing.describe()


def test_mountings_are_kept_for_each_kind_of_source() -> None:
    simulated = ImuBridgeConfig()
    serial = ImuBridgeConfig(source="serial")
    state = kept(serial, MOUNTINGS["minus_y"], kept(simulated, TURNED))
    assert MountingSelection(simulated, state).sensor_from_arm == pytest.approx(TURNED)
    assert MountingSelection(serial, state).sensor_from_arm == MOUNTINGS["minus_y"]
    assert MountingSelection(ImuBridgeConfig(source="replay"), state).is_measured is False
    left = MountingSelection(simulated, state).set(ask(None), 2)
    assert left is not None
    assert list(left.by_source) == ["serial"]


def test_measurement_of_another_mounting_is_not_used_and_warned_of() -> None:
    state = kept(ImuBridgeConfig(), TURNED)
    wearing = MountingSelection(ImuBridgeConfig(mounting="metamotion"), state)
    assert wearing.sensor_from_arm == MOUNTINGS["metamotion"]
    assert "measured while plus_x was configured, now it is metamotion" in wearing.warning


STILL = ImuBridgeConfig.model_validate(
    {
        "mounting": "metamotion",
        "simulated": SimulatedConfig(azimuth_amplitude_deg=0, elevation_amplitude_deg=0, elevation_deg=20),
    }
)


async def finger_of(samples: list[ImuSample]) -> vector.Vec3:
    seen = len(samples)
    await until(lambda: len(samples) > seen + 1)
    return rotation.rotate(samples[-1].orientation_xyzw, (1.0, 0.0, 0.0))


async def set_mounting(bench: Bench, query: SetMounting) -> SetMountingReply:
    reply: SetMountingReply = await bench.bus.call(SET_MOUNTING, query, ANNA)
    return reply


async def test_measured_mounting_is_used_until_it_is_erased(own_state: Path) -> None:
    arm = vector.direction(0.0, math.radians(20))
    async with memory_bench(WallClock()) as bench:
        samples = bench.collect(IMU, ANNA)
        bench.start(ImuBridge, STILL, user=ANNA)
        assert vector.angle_between(await finger_of(samples), arm) < 1e-6
        assert samples[-1].mounting == "simulated metamotion"

        error = from_roll_pitch_yaw(*map(math.radians, (30.0, -15.0, 60.0)))
        reply = await set_mounting(bench, ask(error, relative=True))
        expected = rotation.multiply(MOUNTINGS["metamotion"], error)
        assert reply.sensor_from_arm_xyzw == pytest.approx(expected)
        assert "as measured" in reply.message

        turned = await finger_of(samples)
        assert vector.angle_between(turned, arm) > 0.5
        measured = samples[-1].mounting
        assert measured == "simulated 0.215 -0.188 -0.215 0.934"
    path = own_state / "users" / ANNA / "mounting.json"

    assert path.is_file()
    async with memory_bench(WallClock()) as bench:
        samples = bench.collect(IMU, ANNA)
        bench.start(ImuBridge, STILL, user=ANNA)
        assert vector.angle_between(await finger_of(samples), turned) < 1e-6
        assert samples[-1].mounting == measured

        reply = await set_mounting(bench, ask(rotation.IDENTITY, relative=True))
        assert reply.sensor_from_arm_xyzw == pytest.approx(expected)
        assert (await set_mounting(bench, ask(None))).sensor_from_arm_xyzw == MOUNTINGS["metamotion"]
        assert vector.angle_between(await finger_of(samples), arm) < 1e-6
    assert not path.exists()


async def test_corrupt_file_is_a_warning_and_an_unstored_mounting_used(own_state: Path) -> None:
    path = own_state / "users" / ANNA / "mounting.json"
    path.parent.mkdir(parents=True)
    path.write_text('{"by_source": {"simulated": 7}}', encoding="utf-8")
    async with memory_bench(WallClock()) as bench:
        reports: list[Health] = bench.collect(HEALTH)
        bench.start(ImuBridge, STILL, user=ANNA)
        await until(lambda: bool(reports and reports[-1].warnings))
        assert "mounting.json: cannot be used" in reports[-1].warnings[0]

        await set_mounting(bench, ask(TURNED))  # in its place
        await until(lambda: not reports[-1].warnings)
        path.unlink()
        path.parent.rmdir()
        path.parent.write_text("in the way", encoding="utf-8")
        reply = await set_mounting(bench, ask(TURNED))
        assert "used now, but not stored" in reply.message
        assert reply.sensor_from_arm_xyzw == pytest.approx(TURNED)
        await until(lambda: bool(reports[-1].warnings))


angles = st.floats(-3.1, 3.1)
elevations = st.floats(-1.3, 1.3)
SENSOR_AXIS = {
    "plus_x": (1.0, 0.0, 0.0),
    "minus_x": (-1.0, 0.0, 0.0),
    "plus_y": (0.0, 1.0, 0.0),
    "minus_y": (0.0, -1.0, 0.0),
    "metamotion": (0.0, -1.0, 0.0),
    "myo": (-1.0, 0.0, 0.0),
    "watch_left": (1.0, 0.0, 0.0),  # 3 o'clock is towards the fingers
    "watch_right": (-1.0, 0.0, 0.0),  # 9 o'clock is
    "phone": (0.0, 1.0, 0.0),
}
"""The sensor's axis that points along the arm to the finger."""


@pytest.mark.parametrize("name", sorted(MOUNTINGS))
@given(azimuth=angles, elevation=elevations, roll=angles)
def test_arm_points_along_the_axis_of_the_sensor(
    name: str, azimuth: float, elevation: float, roll: float
) -> None:
    sensor = rotation.from_azimuth_elevation(azimuth, elevation, roll)
    arm = ArmFrame(MOUNTINGS[name]).orientation(sensor)
    finger = rotation.rotate(arm, (1.0, 0.0, 0.0))
    assert vector.angle_between(finger, rotation.rotate(sensor, SENSOR_AXIS[name])) < 1e-7


@pytest.mark.parametrize("name", sorted(MOUNTINGS))
def test_mountings_keep_the_upper_side_of_the_sensor(name: str) -> None:
    assert rotation.rotate(MOUNTINGS[name], (0.0, 0.0, 1.0)) == pytest.approx((0.0, 0.0, 1.0))


@given(roll=angles, pitch=elevations, yaw=angles)
def test_roll_pitch_yaw_turn_about_fixed_axes_in_this_order(roll: float, pitch: float, yaw: float) -> None:
    expected = Rotation.from_euler("xyz", [roll, pitch, yaw])
    ours = Rotation.from_quat(from_roll_pitch_yaw(roll, pitch, yaw))
    assert (ours.inv() * expected).magnitude() < 1e-7


@given(azimuth=angles, origin=angles)
def test_yaw_origin_is_azimuth_zero(azimuth: float, origin: float) -> None:
    arm = ArmFrame(rotation.IDENTITY, origin).orientation(rotation.from_azimuth_elevation(azimuth, 0.3))
    finger = rotation.rotate(arm, (1.0, 0.0, 0.0))
    assert math.isclose(vector.wrap(vector.azimuth(finger) - (azimuth - origin)), 0.0, abs_tol=1e-9)
    assert math.isclose(vector.elevation(finger), 0.3)


@pytest.mark.parametrize("name", sorted(MOUNTINGS))
@given(azimuth=angles, elevation=elevations, roll=angles, wanted=angles)
def test_set_azimuth_sets_the_yaw_and_keeps_the_elevation(
    name: str, azimuth: float, elevation: float, roll: float, wanted: float
) -> None:
    frame = ArmFrame(MOUNTINGS[name], 1.0)
    arm = rotation.from_azimuth_elevation(azimuth, elevation, roll)
    sensor = rotation.multiply(arm, rotation.inverse(MOUNTINGS[name]))
    frame.set_azimuth(wanted, sensor)
    finger = rotation.rotate(frame.orientation(sensor), (1.0, 0.0, 0.0))
    assert math.isclose(vector.wrap(vector.azimuth(finger) - wanted), 0.0, abs_tol=1e-6)
    assert math.isclose(vector.elevation(finger), elevation, abs_tol=1e-7)
