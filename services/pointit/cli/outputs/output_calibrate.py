"""`pointit output calibrate`: the pose of a moving head, from known places that its beam is pointed at."""

import asyncio
import math
from collections.abc import Sequence
from pathlib import Path

import click

from pointit.cli.common.keyboard import has_keyboard, key_bytes
from pointit.cli.common.option_types import Finite
from pointit.cli.common.output import say
from pointit.cli.outputs.output_setup import PrintedHealth, read_setup, setup_options
from pointit.geometry.vector import Vec3
from pointit.runtime.errors import ConfigError, PointItError
from pointit.runtime.service.logs import setup_logging
from pointit.runtime.service.shutdown import run_until_shutdown
from pointit.runtime.service.surroundings import HealthSink
from pointit.services.led_driver.output.spotlight.beam import BeamState
from pointit.services.led_driver.output.spotlight.config import SpotlightConfig
from pointit.services.led_driver.output.spotlight.head import Angles, ManualAim
from pointit.services.led_driver.output.spotlight.pose_fit import MIN_PLACES, WRONG_RAD, FittedPose, fit_pose
from pointit.services.led_driver.output.spotlight.spotlight import DmxHead

WHITE = (255, 255, 255)
KEYS = "arrows turn the beam, + and - change the step, Enter when it is there"


@click.command("calibrate")
@click.option(
    "--at",
    "places",
    nargs=3,
    type=Finite(-1000, 1000),
    multiple=True,
    metavar="X Y Z",
    help="known place in the map's frame, m, in place of the map's lamps. Repeatable",
)
@setup_options
def command(
    *,
    scenario: str,
    output: str,
    files: tuple[Path, ...],
    settings: tuple[str, ...],
    places: tuple[Vec3, ...],
) -> int:
    """Find where a moving head hangs: point its beam at known places, by default the lamps of SCENARIO's map.

    The beam is lit. For each place turn it there by the arrow keys and press Enter. Three places are needed.
    With four, not all near one line, there is one answer only. Then the pose is printed, as lines for the
    output's entry in the file of `--config`.

    It sends to the fixture itself: end a running site first. Ctrl-C ends it. The beam is dark afterwards.

    Example: pointit output calibrate scenario_3 --output spotlight:192.168.1.50
    """
    setup_logging("error")
    room, driver = read_setup(scenario, output, files, settings)
    config = next((each for each in driver.outputs if isinstance(each, SpotlightConfig)), None)
    if config is None:
        raise ConfigError(f"{scenario} has no moving head: add --output, as in --output spotlight:ADDRESS")
    if not config.host:
        raise ConfigError("host: is missing; `--output spotlight:ADDRESS` sets it")
    targets = {f"({x:g}, {y:g}, {z:g}) m": (x, y, z) for x, y, z in places} or {
        f"lamp {lamp.id}": lamp.position_m for lamp in room.lamps
    }
    if len(targets) < MIN_PLACES:
        raise ConfigError(f"{len(targets)} known places, {MIN_PLACES} needed: add --at X Y Z")
    if not has_keyboard():
        raise ConfigError("there is no keyboard to turn the beam with: call it in a terminal")

    async def work() -> int:
        pressed = asyncio.Queue[bytes]()
        with key_bytes(pressed.put_nowait):
            angles = await pointed(config, list(targets), pressed, PrintedHealth())
        for line in report(config, fit_pose(angles, list(targets.values()))):
            click.echo(line)
        return 0

    return run_until_shutdown(work())


async def pointed(
    config: SpotlightConfig, targets: Sequence[str], pressed: "asyncio.Queue[bytes]", health: HealthSink
) -> list[Angles]:
    """Return the angles at which a person has pointed the beam at each of `targets` by keys."""
    head = DmxHead(config, health)
    aim = ManualAim(config.limits)
    found: list[Angles] = []
    sending = asyncio.create_task(head.run())
    try:
        say(KEYS, err=True)
        for number, target in enumerate(targets, 1):
            say(f"{number} of {len(targets)}: point the beam at {target}", err=True)
            while len(found) < number:
                head.send(BeamState(aim.angles, WHITE))
                if aim.press(await pressed.get()):
                    found.append(aim.angles)
    finally:
        sending.cancel()
        await asyncio.wait({sending})
    return found


def report(config: SpotlightConfig, pose: FittedPose) -> list[str]:
    """Return the pose as lines of YAML.

    Raises:
        PointItError: If it is wrong or ambiguous.
    """
    error_deg = math.degrees(pose.error_rad)
    if pose.error_rad > WRONG_RAD:
        raise PointItError(
            f"the beam misses the places by {error_deg:.1f}° on average: one was confused, or "
            "`pan_range_deg` or `tilt_range_deg` are not those of the fixture's manual; correct them and "
            "calibrate again"
        )
    if not pose.is_unique:
        raise PointItError(
            "another pose fits these places as well: calibrate again with one more, not on a line with "
            "others (--at X Y Z)"
        )
    x, y, z = pose.position_m
    lines = [
        f"# the beam meets the places to {error_deg:.2f}° on average",
        f"position_m: [{x:.3f}, {y:.3f}, {z:.3f}]",
        f"yaw_deg: {pose.yaw_deg:.2f}",
        f"pitch_deg: {pose.pitch_deg:.2f}",
        f"roll_deg: {pose.roll_deg:.2f}",
    ]
    if pose.is_mirrored:
        lines.append(f"invert_pan: {'false' if config.invert_pan else 'true'}")
    return lines
