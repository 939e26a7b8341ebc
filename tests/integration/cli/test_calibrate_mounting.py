"""`pointit person calibrate mounting` against a real imu-bridge."""

import asyncio
import json
import math
import sys
from pathlib import Path

from pointit.cli.people.calibrate_mounting import angle_between
from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion, from_roll_pitch_yaw
from pointit.runtime.clock import WallClock
from pointit.runtime.service.service import Launch, run_service
from pointit.schemas import ImuSample, SetMounting
from pointit.schemas.topics import IMU, SET_MOUNTING
from pointit.services.imu_bridge.arm_frame import MOUNTINGS
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.serial.detection import SerialConfig
from pointit.services.imu_bridge.service import ImuBridge
from pointit.services.pointing.service import Pointing
from tests.support.bench import until
from tests.support.cli_site import Site, interrupt, next_line
from tests.support.commands import PATIENCE_S
from tests.support.pace import within
from tests.support.pty_device import PtyDevice, pty_device

ANNA = "anna"
MOUNTING = ("person", "calibrate", "mounting", ANNA)
WORN = from_roll_pitch_yaw(math.radians(-92), math.radians(15), math.radians(4))
"""Rotation of the sensor against its configured mounting: arm_from_true."""
AHEAD, UP = 0.0, math.pi / 2


def start_bridge(site: Site, device: PtyDevice) -> None:
    config = ImuBridgeConfig.model_validate(
        {"source": "serial", "mounting": "metamotion", "serial": SerialConfig(port=str(device.path))}
    )
    launch = Launch(service=ImuBridge, config=config, user=ANNA)
    site._tasks.append(asyncio.create_task(run_service(launch, site.bus, WallClock())))


def line(elevation_rad: float) -> bytes:
    """Return the line that the device sends while the arm is held at this elevation."""
    arm = rotation.from_azimuth_elevation(0.7, elevation_rad, 0.1 * elevation_rad)
    worn = rotation.multiply(MOUNTINGS["metamotion"], WORN)
    x, y, z, w = rotation.multiply(arm, rotation.inverse(worn))
    return f"{w:.6f},{x:.6f},{y:.6f},{z:.6f}\n".encode()


class Arm:
    """Holds the arm at an elevation, and sends it 50 times a second."""

    def __init__(self, device: PtyDevice) -> None:
        self.elevation_rad = AHEAD
        self._device = device

    async def live(self) -> None:
        while True:
            self._device.send(line(self.elevation_rad))
            await asyncio.sleep(0.02)


def finger_height(sample: ImuSample) -> float:
    """Return the z component of the unit pointing direction in a sample of imu-bridge."""
    return rotation.rotate(sample.orientation_xyzw, (1.0, 0.0, 0.0))[2]


def expected() -> Quaternion:
    return rotation.multiply(MOUNTINGS["metamotion"], WORN)


async def test_a_mounting_is_found_shown_and_erased(site: Site, tmp_path: Path, own_state: Path) -> None:
    samples: list[ImuSample] = []
    site.bus.subscribe(IMU, lambda sample, _user: samples.append(sample), ANNA)
    with pty_device(tmp_path / "imu") as device:
        arm = Arm(device)
        life = asyncio.create_task(arm.live())
        try:
            start_bridge(site, device)
            await site.arrived("imu-bridge.anna")
            async with site.command(*MOUNTING, "--non-interactive", "--seconds", "0.5", "--json") as process:
                assert "straight ahead, with the arm stretched and the palm down, and rest for 0.5 s" in (
                    await next_line(process.stderr)
                )
                assert await next_line(process.stderr) == "anna: good, the arm rested ahead\n"
                assert "straight up" in await next_line(process.stderr)
                arm.elevation_rad = UP
                out, err = await process.communicate()
                assert process.returncode == 0, err.decode()
            found = json.loads(out)
            assert abs(found["about_arm_deg"] - 92) < 3
            assert 10 < found["off_axis_deg"] < 20
            assert abs(found["forward_error_deg"]["before"]) > 4
            assert abs(found["forward_error_deg"]["after"]) < 0.1
            assert angle_between(tuple(found["sensor_from_arm_xyzw"]), expected()) < 0.002
            # Samples come another way than the command's end: the first with the new mounting may be on it.
            await until(lambda: finger_height(samples[-1]) > 0.9999, PATIENCE_S, "the arm points straight up")
            shown = await site.pointit(*MOUNTING, "--show")
            assert (shown.code, shown.out[:35]) == (0, "anna: the mounting is as measured (")
            assert (own_state / "users" / ANNA / "mounting.json").is_file()
            erased = await site.pointit(*MOUNTING, "--erase")
            assert erased.out == "anna: the mounting is as configured (metamotion)\n"
            assert not (own_state / "users" / ANNA / "mounting.json").exists()
        finally:
            life.cancel()
            await asyncio.wait({life})


async def test_an_arm_that_does_not_move_or_no_keyboard_is_one_sentence(site: Site, tmp_path: Path) -> None:
    with pty_device(tmp_path / "imu") as device:
        arm = Arm(device)
        life = asyncio.create_task(arm.live())
        try:
            start_bridge(site, device)
            await site.arrived("imu-bridge.anna")
            ended = await site.pointit(*MOUNTING, "--non-interactive", "--seconds", "0.3", "--timeout", "3")
            assert ended.code == 1
            assert "Error: the arm of anna did not rest up within 3 s" in ended.err
            if not sys.stdin.isatty():  # the command has the tests' own
                ended = await site.pointit(*MOUNTING, code=2)
                assert "no keyboard to press Enter on; use --non-interactive" in ended.err
            async with site.command(*MOUNTING, "--non-interactive") as process:
                await next_line(process.stderr)
                code, took_s = await interrupt(process)
            assert code == 130
            assert within(took_s, 5.0)
        finally:
            life.cancel()
            await asyncio.wait({life})


async def test_with_nobody_there_the_file_here_is_shown_and_erased(site: Site, own_state: Path) -> None:
    shown = await site.pointit(*MOUNTING, "--show", code=0)
    assert "no service runs, and no mounting is stored on this machine" in shown.out
    site.start(ImuBridge, ANNA)
    await site.arrived("imu-bridge.anna")
    query = SetMounting(sensor_from_arm_xyzw=(0.0, 0.0, 1.0, 0.0))
    await site.bus.call(SET_MOUNTING, query, ANNA)
    (task,) = site._tasks
    task.cancel()
    await asyncio.wait({task})
    shown = await site.pointit(*MOUNTING, "--show")
    assert "source simulated, measured with mounting=plus_x" in shown.out
    assert "z 1.000" in shown.out
    erased = await site.pointit(*MOUNTING, "--erase", "--json")
    assert json.loads(erased.out)["erased"] is True
    assert not list((own_state / "users").rglob("*.json"))


async def test_setting_the_pose_of_a_person_who_is_not_there_names_who_is(site: Site) -> None:
    site.start(Pointing, "user1")
    await site.arrived("pointing.user1")
    for place in ((), ("1", "1")):
        ended = await site.pointit("person", "pose", "user9", *place, code=1)
        assert "user9 is not on this site, there is user1; did you mean user1" in ended.sentence
