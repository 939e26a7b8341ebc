"""`pointit person calibrate`, `anchor`, `pose` with real services and a played localizer."""

import asyncio
import json
import math
import sys
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import pytest_asyncio
from click.testing import CliRunner

from pointit.cli.main import command
from pointit.geometry import rotation
from pointit.geometry.rotation import angle_between, from_roll_pitch_yaw
from pointit.geometry.vector import Vec3
from pointit.runtime.clock import WallClock
from pointit.runtime.errors import RefusedError
from pointit.runtime.service.service import Launch, run_service
from pointit.schemas import (
    Anchor,
    CancelLocalization,
    Done,
    ImuSample,
    Localization,
    PointAnchor,
    RememberedBias,
    SetMounting,
    SetPose,
    UserPose,
    UserProfile,
)
from pointit.schemas.topics import CANCEL_LOCALIZATION, IMU, LOCALIZATION, PROFILE, SET_MOUNTING
from pointit.services.imu_bridge.arm_frame import MOUNTINGS
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.serial.detection import SerialConfig
from pointit.services.imu_bridge.service import ImuBridge
from pointit.services.pui.service import Pui
from pointit.services.supervisor.service import Supervisor
from tests.support.bench import until
from tests.support.cli_site import Site, interrupt, next_line
from tests.support.commands import PATIENCE_S
from tests.support.pace import within
from tests.support.played_localizer import PlayedLocalizer
from tests.support.pty_device import PtyDevice, pty_device

ANNA = "anna"
LAMPS: dict[str, Vec3] = {
    "led_0": (3.572, -2.946, 2.080),
    "led_1": (1.699, -2.609, 0.850),
    "led_2": (3.239, -0.606, 0.150),
    "led_3": (0.762, -1.031, 0.150),
}
"""Lamp positions of the map `lab` in {W}, m."""


@dataclass
class ErringLocalizer(PlayedLocalizer):
    """As the played one, until something else is said of it."""

    truly_m: Vec3 | None = None
    """True position of the person in {W}, m. None if it is the announced one."""
    refuses: str = ""
    """Reason for which pointing at a lamp is refused, or `""` if it is accepted."""
    poses: list[SetPose] = field(default_factory=list[SetPose])
    """As they were said."""

    def find(self, yaw_sigma_rad: float, bias_rad: float = 0.0) -> None:
        """Publish the pose as one that was found by pointing."""
        variances = (0.01, 0.0, 0.0, 0.0, 0.0025, 0.0, 0.0, 0.0, yaw_sigma_rad**2)
        pose = UserPose(
            stamp_ns=time.time_ns(), position_m=self.position_m, yaw_rad=self.yaw_rad, covariance=variances,
            method="static_targets", elevation_bias_rad=bias_rad,
            remembered_bias=self.remembered_bias,
        )  # fmt: skip
        self._poses.put(pose)

    async def _point_anchor(self, query: PointAnchor, _user: str) -> Done:
        if self.refuses:
            self.asked.append(f"anchor {query.lamp}".strip())
            raise RefusedError(self.refuses)
        return await super()._point_anchor(query, _user)

    async def _cancel(self, query: CancelLocalization, user: str) -> Done:
        if query.forget_bias and self.refuses:
            raise RefusedError(self.refuses)
        return await super()._cancel(query, user)

    async def _set_pose(self, query: SetPose, _user: str) -> Done:
        self.poses.append(query)
        return await super()._set_pose(query, _user)

    def _anchor(self, lamp: str, reason: str) -> Anchor:
        told_m = self.position_m
        self.position_m = self.truly_m or told_m
        seen: Anchor = super()._anchor(lamp, reason)
        self.position_m = told_m
        return seen.model_copy(update={"position_m": told_m})


@pytest_asyncio.fixture
async def localizer(site: Site) -> AsyncIterator[ErringLocalizer]:
    played = ErringLocalizer(site.bus, ANNA, LAMPS)
    site.start(Pui)
    site.start(Supervisor, ANNA)
    await site.arrived("supervisor.anna")
    await site.arrived("pui")
    try:
        yield played
    finally:
        await played.stop()


async def test_offset_is_kept_and_forgotten(site: Site, localizer: ErringLocalizer, own_state: Path) -> None:
    profiles: list[UserProfile] = []
    site.bus.subscribe(PROFILE, lambda profile, _user: profiles.append(profile), ANNA)
    ended = await site.pointit("person", "calibrate", "user", ANNA, "--json", code=0)
    assert localizer.asked == [f"anchor {lamp}" for lamp in LAMPS]

    told = json.loads(ended.out)
    assert told["offset"]["rung"] == "pitch"
    assert abs(math.degrees(told["offset"]["elevation"][0]) - 4.0) < 0.3  # drawn a little to nothing
    assert [row["lamp"] for row in told["anchors"]] == list(LAMPS)
    for row in told["anchors"]:
        assert abs(row["elevation_before_deg"] - 4.0) < 0.05
        assert abs(row["elevation_after_deg"]) < 0.3
        assert abs(row["azimuth_before_deg"]) < 0.05  # that all are off by 6° is the heading's
        assert row["used"] == "yes"
    await until(lambda: profiles[-1].offset is not None)
    assert profiles[-1].offset is not None
    assert profiles[-1].offset.anchors == 4

    path = own_state / "users" / ANNA / "offset.json"
    assert path.is_file()
    shown = await site.pointit("person", "calibrate", "user", ANNA, "--show")
    assert shown.out.startswith("anna: the rays are turned up by 4.0°")
    assert "fitted from 4 pointings" in shown.out

    erased = await site.pointit("person", "calibrate", "user", ANNA, "--erase")
    assert erased.out == "anna: the offset is forgotten\n"
    assert not path.exists()
    await until(lambda: profiles[-1].offset is None)


async def test_lamps_are_chosen_and_bad_holds_do_not_count(site: Site, localizer: ErringLocalizer) -> None:
    localizer.rejects = ("led_2",)
    ended = await site.pointit(
        "person", "calibrate", "user", ANNA, "--lamps", "led_2,led_0", "--anchors", "3", "--dry-run", code=0
    )
    assert localizer.asked == ["anchor led_2", "anchor led_0", "anchor led_2"]
    assert ended.out.count("no: the arm wandered while led_2 was lit") == 2
    assert "fitted from 1 pointing," in ended.out
    assert ended.out.endswith("nothing is changed (--dry-run)\n")
    localizer.rejects = tuple(LAMPS)
    ended = await site.pointit("person", "calibrate", "user", ANNA, "--lamps", "led_0", code=1)
    assert "no pointing was usable, nothing was changed: the arm wandered" in ended.err
    ended = await site.pointit("person", "calibrate", "user", ANNA, "--lamps", "led_9", code=2)
    assert "no lamp 'led_9' on map" in ended.err


async def test_without_a_site_what_is_kept_here_is_shown(site: Site, own_state: Path) -> None:
    shown = await site.pointit("person", "calibrate", "user", ANNA, "--show")
    assert "no service runs, and no offset is stored on this machine" in shown.out
    path = own_state / "users" / ANNA / "offset.json"
    path.parent.mkdir(parents=True)
    path.write_text('{"rung": "pitch", "elevation": [0.05, 0, 0, 0, 0, 0], "anchors": 2}', encoding="utf-8")
    shown = await site.pointit("person", "calibrate", "user", ANNA, "--show")
    assert "the rays are turned up by 2.9°; fitted from 2 pointings" in shown.out
    erased = await site.pointit("person", "calibrate", "user", ANNA, "--erase")
    assert "was deleted" in erased.out
    path.write_text("{", encoding="utf-8")
    shown = await site.pointit("person", "calibrate", "user", ANNA, "--show", code=2)
    assert "offset.json: cannot be used" in shown.err


async def test_an_anchor_says_in_one_sentence_what_it_found(site: Site, localizer: ErringLocalizer) -> None:
    ended = await site.pointit("person", "anchor", ANNA, "led_1", code=0)
    assert ended.out == (
        "anna: led_1: the direction was 6.0° too far right (the IMU's drift turns the pose by 12.0 °/min) "
        "and is corrected; the pose is known to 0.10 m and 1.5° now; before, it counted as exact, as it "
        "was given.\n"
    )
    localizer.rejects = ("led_0",)
    ended = await site.pointit("person", "anchor", ANNA, code=1)  # the localizer chooses
    assert "led_0: not accepted, the pose is as before: the arm wandered while led_0 was lit" in ended.out
    ended = await site.pointit("person", "anchor", ANNA, "led_9", "--json", code=1)
    assert "lamps led_9 are not on the map" in ended.err


async def test_an_anchor_without_end_is_called_off(site: Site, localizer: ErringLocalizer) -> None:
    localizer.hangs = True
    ended = await site.pointit("person", "anchor", ANNA, "led_1", "--timeout", "1", code=1)
    assert "did not finish within 1 s and was cancelled" in ended.err
    assert localizer.asked == ["anchor led_1", "cancel"]
    async with site.command("person", "anchor", ANNA, "led_1") as process:
        await until(lambda: len(localizer.asked) == 3, 20)
        code, took_s = await interrupt(process)
    assert code == 130
    assert within(took_s, 5.0)
    assert localizer.asked[2:] == ["anchor led_1", "cancel"]


@pytest.mark.slow
async def test_without_a_localizer_it_says_what_to_start(site: Site) -> None:
    ended = await site.pointit("person", "anchor", ANNA, code=1)
    assert "no localizer of anna is heard" in ended.err
    assert (
        "anna is not on this site, there are no people; add them with `pointit person add anna`" in ended.err
    )

    ended = await site.pointit("person", "pose", ANNA, code=1)
    assert "where anna stands is not known: anna is not on this site" in ended.err
    site.start(Supervisor, ANNA)
    await site.arrived("supervisor.anna")
    ended = await site.pointit("person", "pose", ANNA)
    assert "pointit service run localizer --user anna" in ended.err
    assert "or set it: pointit person pose anna X Y" in ended.err

    ended = await site.pointit("person", "pose", "ben")
    assert "ben is not on this site, there is anna; add them with `pointit person add ben`" in ended.err
    ended = await site.pointit("person", "pose", "ann", "1", "1", code=1)
    assert "ann is not on this site, there is anna; did you mean anna" in ended.sentence

    ended = await site.pointit("person", "calibrate", "user", "ben", "--show")
    assert ended.err == "waiting for the profile of ben …\n"  # a second later than it was asked


async def test_the_pose_is_shown_and_said(site: Site, localizer: ErringLocalizer) -> None:
    shown = await site.pointit("person", "pose", ANNA, code=0)
    assert "position      x 2.00 m, y 0.50 m, z 0.00 m" in shown.out
    assert "given, counts as exact" in shown.out

    said = await site.pointit("person", "pose", ANNA, "-1.5", "2")
    assert (said.code, said.out) == (0, "anna: the pose is set\n"), said.err
    assert localizer.asked[-1] == "pose (-1.5, 2.0, 0.0) 17.2"  # the yaw is as it was

    said = await site.pointit("person", "pose", ANNA, "1", "2", "0.5", "--yaw", "-20", "--json")
    assert localizer.asked[-1] == "pose (1.0, 2.0, 0.5) -20.0"
    fields = json.loads(said.out)
    assert (fields["position_m"], round(fields["yaw_deg"], 6)) == ([1.0, 2.0, 0.5], -20.0)

    said = await site.pointit("person", "pose", ANNA, "--facing", "90", "--now")
    assert said.out == "anna: the yaw is set by where you point\n"
    assert localizer.asked[-1] == "heading 90.0"

    await site.pointit("person", "anchor", ANNA, "led_1")
    shown = await site.pointit("person", "pose", ANNA)
    assert "1 sigma 0.10 m" in shown.out
    assert "12.0 °/min; 1 sigma 6.0 °/min" in shown.out
    assert "last anchor" in shown.out
    assert "never" not in shown.out


async def test_a_typed_place_keeps_the_found_yaw_and_sigma(site: Site, localizer: ErringLocalizer) -> None:
    localizer.find(yaw_sigma_rad=math.radians(4.0), bias_rad=0.02)
    said = await site.pointit("person", "pose", ANNA, "1", "2")
    assert said.out == "anna: the pose is set; the yaw stays, and its drift is still tracked\n", said.err
    asked = localizer.poses[-1]
    assert (asked.method, asked.position_m, asked.yaw_rad) == ("static_targets", (1.0, 2.0, 0.0), 0.3)
    assert asked.elevation_bias_rad == 0.02
    assert asked.covariance is not None
    assert [math.sqrt(asked.covariance[i]) for i in (0, 4, 8)] == pytest.approx(
        [0.05, 0.05, math.radians(4.0)]
    )
    said = await site.pointit("person", "pose", ANNA, "1", "2", "--yaw", "10")
    assert (localizer.poses[-1].method, localizer.poses[-1].covariance) == ("fixed", None)
    assert said.err == ""


def remembered_bias(localizations: int) -> RememberedBias:
    return RememberedBias(
        localizations=localizations,
        origin_height_m=1.64,
        bias_rad=0.05,
        slope=0.0,
        covariance=(1e-4, 0.0, 0.0, 1e-2),
    )


async def test_a_remembered_bias_is_shown_and_forgotten(site: Site, localizer: ErringLocalizer) -> None:
    localizer.remembered_bias = remembered_bias(localizations=3)
    localizer.find(yaw_sigma_rad=math.radians(4.0))
    shown = await site.pointit("person", "pose", ANNA, code=0)
    assert "remembered    elevation bias of 3 localizations\n" in shown.out

    localizer.refuses = "the state file cannot be deleted"
    ended = await site.pointit("person", "pose", ANNA, "--forget-bias", code=1)
    assert (ended.out, ended.sentence) == ("", "the state file cannot be deleted")

    localizer.refuses = ""
    told = await site.pointit("person", "pose", ANNA, "--forget-bias", code=0)
    assert told.out == "anna: forgotten: the next localization expects no elevation bias\n"
    assert localizer.asked == ["forget"]

    shown = await site.pointit("person", "pose", ANNA, code=0)
    assert "remembered" not in shown.out
    localizer.remembered_bias = remembered_bias(localizations=1)
    localizer.find(yaw_sigma_rad=math.radians(4.0))
    told = await site.pointit("person", "pose", ANNA, "--forget-bias", "--json", code=0)
    assert json.loads(told.out)["remembered_localizations"] == 0


async def test_forgetting_succeeds_where_no_pose_is_known(site: Site) -> None:
    asked: list[CancelLocalization] = []

    async def forget(query: CancelLocalization, _user: str) -> Done:
        asked.append(query)
        return Done(message="forgotten")

    site.bus.serve(CANCEL_LOCALIZATION, forget, ANNA)
    told = await site.pointit("person", "pose", ANNA, "--forget-bias", "--json", code=0)
    assert json.loads(told.out) == {"user": "anna", "remembered_localizations": 0}
    assert asked == [CancelLocalization(forget_bias=True)]


async def test_no_offset_of_a_wrong_pose(site: Site, localizer: ErringLocalizer, own_state: Path) -> None:
    localizer.position_m = (5.0, -2.0, 0.0)  # in truth at 2.0, 0.5
    localizer.truly_m = (2.0, 0.5, 0.0)
    localizer.find(yaw_sigma_rad=math.radians(4.0))
    ended = await site.pointit("person", "calibrate", "user", ANNA, code=1)
    assert "nothing is stored: the pose looks wrong, " in ended.err
    assert "localize first, or `pointit person pose anna X Y`" in ended.err
    assert not (own_state / "users" / ANNA / "offset.json").exists()
    ended = await site.pointit("person", "calibrate", "user", ANNA, "--dry-run")
    assert "too far right" in ended.out
    assert "the pose looks wrong" in ended.out + ended.err


async def test_lamps_that_somebody_has_are_waited_for_once(site: Site, localizer: ErringLocalizer) -> None:
    others = site.bus.publisher(LOCALIZATION, "ben")
    others.put(Localization(stamp_ns=1, phase="sampling", target_id="led_0", target_count=2, since_ns=1))
    localizer.refuses = "ben is being localized with these lamps; try again when they are done"
    ended = await site.pointit("person", "calibrate", "user", ANNA, "--timeout", "1")
    assert (ended.code, ended.err.count("; waiting for up to 1 s")) == (1, 1)
    assert "nothing was changed: ben is being localized with these lamps" in ended.err
    assert len(localizer.asked) == 2

    others.put(Localization(stamp_ns=2, phase="solved", since_ns=1))
    localizer.refuses = "the lamps are broken"
    ended = await site.pointit("person", "calibrate", "user", ANNA)
    assert "waiting" not in ended.err
    assert "nothing was changed: the lamps are broken" in ended.err
    assert len(localizer.asked) == 3

    others.put(Localization(stamp_ns=3, phase="sampling", target_id="led_0", target_count=2, since_ns=3))
    async with site.command("person", "calibrate", "user", ANNA, "--lamps", "led_0") as process:
        await until(lambda: len(localizer.asked) == 4, 20)
        localizer.refuses = ""
        others.put(Localization(stamp_ns=4, phase="solved", since_ns=3))
        out, err = await process.communicate()
    assert process.returncode == 0, err.decode()
    assert "the offset is in use" in out.decode()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("1", "a position has two or three numbers"),
        ("1 x", "'x' is neither a coordinate in metres"),
        ("1 --yau", "'--yau' is neither a coordinate in metres nor an option"),
        ("--yaw 3", "--yaw belongs to X Y"),
        ("1 2 --yaw 3 --facing 4", "excludes --facing"),
        ("--now", "--now belongs to --facing"),
        ("1 2 --forget-bias", "--forget-bias excludes X Y, --yaw and --facing"),
        ("--forget-bias --yaw 3", "--forget-bias excludes X Y, --yaw and --facing"),
        ("--forget-bias --facing 4", "--forget-bias excludes X Y, --yaw and --facing"),
        ("nan 2", "'nan' is neither a coordinate in metres"),
    ],
)
def test_wrong_options_of_a_calibration_are_reported(arguments: str, words: str) -> None:
    result = CliRunner().invoke(command, ["person", "pose", "anna", *arguments.split()])
    assert (result.exit_code, words in result.output) == (2, True), result.output


MOUNTING = ("person", "calibrate", "mounting", ANNA)
WORN = from_roll_pitch_yaw(math.radians(-92), math.radians(15), math.radians(4))
"""Rotation of the sensor against its configured mounting: arm_from_true."""
AHEAD = 0.0
UP = math.pi / 2


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


def points_up(sample: ImuSample) -> bool:
    return rotation.rotate(sample.orientation_xyzw, (1.0, 0.0, 0.0))[2] > 0.9999


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
            expected = rotation.multiply(MOUNTINGS["metamotion"], WORN)
            assert angle_between(tuple(found["sensor_from_arm_xyzw"]), expected) < 0.002
            # Samples come another way than the command's end: the first with the new mounting may be on it.
            await until(lambda: points_up(samples[-1]), PATIENCE_S, "the arm points straight up")
            shown = await site.pointit(*MOUNTING, "--show")
            assert (shown.code, shown.out[:35]) == (0, "anna: the mounting is as measured (")
            assert (own_state / "users" / ANNA / "mounting.json").is_file()
            erased = await site.pointit(*MOUNTING, "--erase")
            assert erased.out == "anna: the mounting is as configured (metamotion)\n"
            assert not (own_state / "users" / ANNA / "mounting.json").exists()
        finally:
            life.cancel()
            await asyncio.wait({life})


async def test_still_arm_or_missing_keyboard_is_reported_in_one_sentence(site: Site, tmp_path: Path) -> None:
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
