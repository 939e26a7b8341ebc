"""`pointit output calibrate`: keys turn the beam, and the pose of the head is printed."""

import asyncio
import functools
import math

import pytest
import yaml
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from pointit.cli import outputs
from pointit.cli.outputs import pointed, report
from pointit.runtime.errors import PointItError
from pointit.runtime.service.plugin_guard import NullHealth
from pointit.services.led_driver.output.pose_fit import FittedPose, fit_pose
from pointit.services.led_driver.output.spotlight import (
    HOME,
    Angles,
    HeadMounting,
    ManualAim,
    SpotlightConfig,
)
from pointit.testing import UdpDevice
from pointit_lab.devices.contracts.led import e131_frames
from tests.support.bench import until

LAMPS = {"a": (0.0, 0.0, 0.5), "b": (4.0, 0.3, 1.0), "c": (3.5, 3.0, 0.0), "d": (0.4, 3.2, 2.0)}
TRUTH = HeadMounting.from_degrees((2.0, 1.5, 3.0), 30.0, 3.0, 176.0)
STEP_RAD = math.radians(0.25)
FINER = b"-" * 4
"""From the first step to that one."""
UP, DOWN, RIGHT, LEFT = (b"\x1b[" + letter for letter in (b"A", b"B", b"C", b"D"))


@pytest.fixture(autouse=True)
def _same_logs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the logs of the tests that follow as they are."""
    monkeypatch.setattr(outputs, "setup_logging", str)


def keys(start: Angles, end: Angles) -> bytes:
    pan = round(end.pan_rad / STEP_RAD) - round(start.pan_rad / STEP_RAD)
    tilt = round(end.tilt_rad / STEP_RAD) - round(start.tilt_rad / STEP_RAD)
    return (RIGHT if pan > 0 else LEFT) * abs(pan) + (UP if tilt > 0 else DOWN) * abs(tilt)


def lit(device: UdpDevice) -> list[bytes]:
    """Return the angles of the frames that have arrived in which the beam is lit."""
    return [slots[:4] for slots in e131_frames(bytes(device.received)) if slots[4]]


def turned(device: UdpDevice, before: list[bytes]) -> bool:
    return lit(device)[-1:] not in (before, [])


async def test_calibration_finds_the_pose_from_four_lamps_pointed_at() -> None:
    device = UdpDevice()
    pressed = asyncio.Queue[bytes]()
    at = HOME
    await device.plug()
    config = SpotlightConfig(host=device.host, port=device.port)
    pressed.put_nowait(FINER)
    pointing = asyncio.create_task(pointed(config, list(LAMPS), pressed, NullHealth()))
    for lamp_m in LAMPS.values():
        there = TRUTH.angles(lamp_m, at, config.limits)
        assert there is not None
        before = lit(device)[-1:]
        pressed.put_nowait(keys(at, there))
        await until(functools.partial(turned, device, before))
        pressed.put_nowait(b"\n")
        at = there
    angles = await pointing

    await until(lambda: not any(e131_frames(bytes(device.received))[-1][4:]))  # dark in the end
    await device.unplug()
    device.close()
    found = yaml.safe_load("\n".join(report(config, fit_pose(angles, list(LAMPS.values())))))
    assert math.dist(found["position_m"], TRUTH.position_m) < 0.05

    values = SpotlightConfig.model_validate(found)
    assert values.mounting.beam(HOME) == pytest.approx(TRUTH.beam(HOME), abs=0.02)


@given(st.lists(st.sampled_from([UP, DOWN, RIGHT, LEFT, b"+", b"-", b"\x1bOC", b"x", b"\x1b"]), max_size=200))
def test_keys_never_turn_the_head_beyond_its_range(pressed: list[bytes]) -> None:
    limits = SpotlightConfig().limits
    aim = ManualAim(limits)
    assert aim.press(b"".join(pressed)) == 0
    assert limits.allow(aim.angles)
    assert math.radians(0.05) < aim.step_rad < math.radians(20)
    assert aim.press(b"\r \n") == 3


def fitted(**values: object) -> FittedPose:
    known = {"position_m": (1.0, 2.0, 3.0), "yaw_deg": 1.0, "pitch_deg": 2.0, "roll_deg": 3.0}
    fit = {"is_mirrored": False, "error_rad": 0.001, "is_unique": True}
    return FittedPose(**(known | fit | values))  # pyrefly: ignore[bad-argument-type]


def test_wrong_and_ambiguous_poses_are_refused() -> None:
    with pytest.raises(PointItError, match=r"by 2\.9° on average"):
        report(SpotlightConfig(), fitted(error_rad=0.05))
    with pytest.raises(PointItError, match="one more"):
        report(SpotlightConfig(), fitted(is_unique=False))


def test_pan_that_turns_the_other_way_is_to_be_configured() -> None:
    assert "invert_pan: true" in report(SpotlightConfig(), fitted(is_mirrored=True))
    assert "invert_pan: false" in report(SpotlightConfig(invert_pan=True), fitted(is_mirrored=True))
    assert not any("invert" in line for line in report(SpotlightConfig(), fitted()))


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["scenario_3", "--output", "ddp:x"], "no moving head"),
        (["scenario_3", "--output", "spotlight:x", "--at", "1", "2", "3"], "1 known places, 3 needed"),
        (["scenario_3", "--output", "spotlight:x"], "no keyboard"),
    ],
)
def test_calibration_reports_missing_arguments(arguments: list[str], problem: str) -> None:
    done = CliRunner().invoke(outputs.calibrate, arguments)
    assert problem in str(done.exception)
