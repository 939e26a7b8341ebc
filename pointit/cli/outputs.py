"""`pointit output`: adds one to a running site, calibrates a moving head, shows which pixel is where."""

import asyncio
import contextlib
import itertools
import math
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import click

from pointit.cli.common.completions import scenarios
from pointit.cli.common.keyboard import has_keyboard, key_bytes, keys
from pointit.cli.common.output import interruptible, json_option, say, to_json
from pointit.cli.common.panels import Finite
from pointit.cli.common.site_link import SiteAddress, site_command
from pointit.geometry.vector import Vec3
from pointit.launch.plan.launches import Choices
from pointit.launch.plan.plan import USUAL, read_scenario
from pointit.launch.plan.scenario_catalog import scenario_launches
from pointit.maps.file import load_map
from pointit.runtime.bus.contract import Bus
from pointit.runtime.clock import WallClock, wait_up_to
from pointit.runtime.errors import ConfigError, PointItError
from pointit.runtime.host.state_file import plugin_folder
from pointit.runtime.machine import this_machine
from pointit.runtime.service.logs import setup_logging
from pointit.runtime.service.plugin_guard import HealthSink, NullHealth, Surroundings
from pointit.runtime.service.process import run_until_shutdown
from pointit.schemas import Environment, LampColor, Message, Strip, StripFrame, StripsFrame
from pointit.schemas.base import Rgb
from pointit.schemas.base import Vec3 as ConfiguredVec3
from pointit.schemas.topics import LAMP_COLOR, MAP, STRIPS_FRAME
from pointit.services.led_driver.config import LedDriverConfig
from pointit.services.led_driver.output.pose_fit import MIN_PLACES, WRONG_RAD, FittedPose, fit_pose
from pointit.services.led_driver.output.spotlight import (
    Angles,
    BeamState,
    DmxHead,
    ManualAim,
    SpotlightConfig,
)
from pointit.services.led_driver.outputs import NONE, OUTPUTS, GuardedOutput, OutputConfig, make_outputs
from pointit.services.pui.config import PuiConfig
from pointit.site.following import follow_site
from pointit.site.site_state import Change, SiteState

F = TypeVar("F", bound=Callable[..., Any])
C = TypeVar("C")

WHITE = (255, 255, 255)
WELL = "no warning any more"
KEYS = "arrows turn the beam, + and - change the step, Enter when it is there"

CONNECT_S = 1.0
"""Time for outputs to connect before the first step, s."""

DARK: Rgb = (0, 0, 0)
ENDS_S = 3.0
RUN_S = 4.0
"""Time in which a pixel runs along the strip, s."""
COLOR_S = 1.5
RUN_PICTURES = 120
"""Maximum number of pictures of the running pixel."""
COLORED_PIXELS = 10
COLORS: dict[str, Rgb] = {"red": (255, 0, 0), "green": (0, 255, 0), "blue": (0, 0, 255)}


def setup_options(function: F) -> F:
    """Add the argument and options that `read_setup` takes: `scenario`, `output`, `files`, `settings`."""
    for add in (
        click.option(
            "--set", "settings", multiple=True, metavar="SERVICE.PARAMETER=VALUE", help="change one parameter"
        ),
        click.option(
            "--config",
            "files",
            multiple=True,
            type=click.Path(path_type=Path),
            help="YAML file that maps services to parameters, as for `pointit run`",
        ),
        click.option(
            "--output",
            "output",
            default="",
            show_default=False,
            metavar="OUTPUT",
            help="output, as for `pointit run`",
        ),
        click.argument("scenario", default=USUAL, shell_complete=scenarios),
    ):
        function = add(function)
    return function


def read_setup(
    scenario: str, output: str, files: Sequence[Path], settings: Sequence[str]
) -> tuple[Environment, LedDriverConfig]:
    """Return the map of a scenario, and the parameters of its outputs, of which there is at least one.

    Raises:
        ConfigError: If there is none, or anything is wrong.
    """
    choices = Choices(output=output, files=tuple(files), settings=tuple(settings))
    launches = scenario_launches(read_scenario(scenario), choices, 1)
    configs = [launch.config for launch in launches]
    pui = _first_of(configs, PuiConfig)
    room = None if pui is None else load_map(pui.map_to_read, 0)
    driver = _first_of(configs, LedDriverConfig)
    message = f"{scenario} has no output: add --output, as in --output ddp:HOST"
    if room is None or driver is None:
        raise ConfigError(message)
    if all(config.kind == NONE for config in driver.outputs):
        raise ConfigError(message)
    return room, driver


def _first_of(configs: Iterable[object], kind: type[C]) -> C | None:
    for config in configs:
        if isinstance(config, kind):
            return config
    return None


class PrintedWarnings(NullHealth):
    """Prints all warnings whenever they change."""

    def __init__(self, well: str, *, as_json: bool) -> None:
        """Create without warnings. `well`: the sentence that is printed when there are none any more."""
        self._well = well
        self._as_json = as_json
        self._warnings: dict[tuple[str, str], str] = {}

    def warn(self, code: str, sentence: str, subject: str = "") -> None:
        """Set the warning of a code and subject, or clear it by `""`."""
        if self._warnings.get((code, subject), "") == sentence:
            return
        self._warnings[code, subject] = sentence
        self.tell()

    def clear(self, code: str, subject: str = "") -> None:
        """Clear the warning of a code and subject."""
        self.warn(code, "", subject)

    def tell(self) -> None:
        """Print the warnings, or that all is well."""
        warnings = list(filter(None, self._warnings.values()))
        if self._as_json:
            click.echo(to_json({"warnings": warnings}))
        else:
            say("; ".join(warnings) or self._well, err=True)


@site_command("add")
@click.argument("output")
@click.option(
    "--strip",
    "strips",
    multiple=True,
    metavar="STRIP",
    help="strip of the map to show, after the pixels of the previous strip. Repeatable  [default: all]",
)
@json_option
async def add(site: SiteAddress, output: str, *, strips: tuple[str, ...], as_json: bool) -> int:
    """Show strips of a running site on one more OUTPUT, such as ddp:HOST for a WLED.

    The site keeps running, and its other outputs do not change. The lights go dark after Ctrl-C, and while
    the site's led-driver does not run. With --json, each line is an object with the `warnings` from then on.

    Example: pointit output add ddp:wled-kitchen.local --strip shelf
    """
    config = _config(output, strips)
    shown = "all strips"
    if strips:
        shown = ", ".join(f"strip {strip}" for strip in strips)
    health = PrintedWarnings(f"{output} shows {shown}", as_json=as_json)
    async with site.join() as bus:
        await _show_added(bus, config, health)
    return 0


def _config(output: str, strips: tuple[str, ...]) -> OutputConfig:
    try:
        kind, parameters = OUTPUTS.choose(output)
        values: dict[str, Any] = {"kind": kind, **parameters}
        if strips:
            values["segments"] = [{"strip": strip} for strip in strips]
        config: Any = OUTPUTS.validate(kind, values)
    except (ConfigError, ValueError) as error:
        raise ConfigError(f"{output}: {error}") from error
    assert isinstance(config, OutputConfig)  # noqa: S101 - of the group of outputs
    return config


async def _show_added(bus: Bus, config: OutputConfig, health: PrintedWarnings) -> None:
    folder = plugin_folder(bus.site, "", OUTPUTS.kind, config.kind)
    surroundings = Surroundings(clock=WallClock(), health=health, folder=folder)
    (output,) = make_outputs([config], lambda _kind, _name, _user, _which: surroundings, health)
    if output.follows_cursors:
        raise ConfigError(f"{config.kind}: follows people's cursors; give it to `pointit run --output`")
    frames = SiteFrames(output)
    now_s = asyncio.get_running_loop().time
    follow_site(SiteState(frames.on_change), bus, now_s, (MAP, STRIPS_FRAME, LAMP_COLOR))
    health.tell()
    await output.run()


class SiteFrames:
    """Passes on to an output what the site shows; nothing is lit without its writer, the LED driver."""

    def __init__(self, output: GuardedOutput) -> None:
        self._output = output
        self._frame = StripsFrame(stamp_ns=0, strips=())

    def on_change(self, change: Change) -> None:
        """Show a frame or a lamp, or the last frame again after a change of the map."""
        match change.message or _dark(change.previous):
            case Environment() as room:
                self._output.set_map(room)
                self._output.show(self._frame)
            case StripsFrame() as frame:
                self._frame = frame
                self._output.show(frame)
            case LampColor() as lamp:
                self._output.show_lamp(change.name, lamp.color)
            case _:
                pass


def _dark(message: Message | None) -> Message | None:
    """Return the frame or lamp without light."""
    now_ns = this_machine().now_ns()
    if isinstance(message, LampColor):
        return LampColor(stamp_ns=now_ns, color=(0, 0, 0))
    if isinstance(message, StripsFrame):
        strips = [StripFrame(id=strip.id, rgb=bytes(len(strip.rgb))) for strip in message.strips]
        return StripsFrame(stamp_ns=now_ns, strips=tuple(strips))
    return None


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
def calibrate(
    *,
    scenario: str,
    output: str,
    files: tuple[Path, ...],
    settings: tuple[str, ...],
    places: tuple[Vec3, ...],
) -> int:
    """Find where a moving head hangs: point its beam at known places, by default the lamps of SCENARIO's map.

    The beam is lit. For each place, turn the beam there with the arrow keys and press Enter. Three places are
    needed. With four that are not all near one line, the answer is unique. Then the pose is printed, as lines
    for the output's entry in the file of `--config`.

    It sends to the fixture itself: end a running site first. Ctrl-C ends it. The beam is dark afterwards.

    Example: pointit output calibrate scenario_3 --output spotlight:192.168.1.50
    """
    setup_logging("error")
    room, driver = read_setup(scenario, output, files, settings)
    config = _first_of(driver.outputs, SpotlightConfig)
    if config is None:
        raise ConfigError(f"{scenario} has no moving head: add --output, as in --output spotlight:ADDRESS")
    if not config.host:
        raise ConfigError("host: is missing; `--output spotlight:ADDRESS` sets it")

    # Places of the command line replace the lamps: they may be measured more exactly
    targets = {_place(place): place for place in places}
    if not targets:
        targets = {f"lamp {lamp.id}": lamp.position_m for lamp in room.lamps}
    if len(targets) < MIN_PLACES:
        raise ConfigError(f"{len(targets)} known places, {MIN_PLACES} needed: add --at X Y Z")
    if not has_keyboard():
        raise ConfigError("there is no keyboard to turn the beam with: call it in a terminal")

    async def work() -> int:
        pressed = asyncio.Queue[bytes]()
        with key_bytes(pressed.put_nowait):
            angles = await pointed(config, list(targets), pressed, PrintedWarnings(WELL, as_json=False))
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
    angles: list[Angles] = []
    sending = asyncio.create_task(head.run())
    try:
        say(KEYS, err=True)
        for number, target in enumerate(targets, 1):
            count = f"{number} of {len(targets)}"
            say(f"{count}: point the beam at {target}", err=True)
            while len(angles) < number:
                head.send(BeamState(aim.angles, WHITE))
                if aim.press(await pressed.get()):
                    angles.append(aim.angles)
    finally:
        # The task makes the beam dark at its end, so it must have ended
        sending.cancel()
        await asyncio.wait({sending})
    return angles


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

    # A comment of YAML and fields of the output, to paste into the file of `--config`
    x, y, z = pose.position_m
    lines = [f"# the beam meets the places to {error_deg:.2f}° on average"]
    lines.append(f"position_m: [{x:.3f}, {y:.3f}, {z:.3f}]")
    lines.append(f"yaw_deg: {pose.yaw_deg:.2f}")
    lines.append(f"pitch_deg: {pose.pitch_deg:.2f}")
    lines.append(f"roll_deg: {pose.roll_deg:.2f}")
    if pose.is_mirrored:
        invert_pan = "false" if config.invert_pan else "true"
        lines.append(f"invert_pan: {invert_pan}")
    return lines


@dataclass(frozen=True)
class TestStep:
    """Pictures that show one property of a strip."""

    text: str
    """Description of the lit pixels, for the operator."""
    pictures: tuple[bytes, ...]
    """Pixels of the strip, 3 bytes each."""
    period_s: float
    """Time for which each picture is shown, s."""


def steps_of(strip: Strip) -> list[TestStep]:
    """Return the steps that test `strip`."""
    # Both ends, where they are in the map
    ends_m = (strip.line_m[0], strip.line_m[-1])
    first_m, last_m = ends_m[:: strip.direction]
    ends = {0: COLORS["green"], strip.pixels - 1: COLORS["red"]}
    text = (
        f"first of {strip.pixels} pixels green, at {_place(first_m)} in the map; last red, at "
        f"{_place(last_m)}"
    )
    steps = [TestStep(text, (_picture(strip, ends),), ENDS_S)]

    # A pixel that runs: of a long strip not every one, since each picture takes a frame
    count = min(strip.pixels, RUN_PICTURES)
    last = strip.pixels - 1
    run: list[bytes] = []
    for number in range(count):
        pixel = number * last // max(1, count - 1)
        run.append(_picture(strip, {pixel: WHITE}))
    steps.append(TestStep("a white pixel runs from the green to the red end", tuple(run), RUN_S / count))

    # The order of colours
    colored_pixels = range(min(COLORED_PIXELS, strip.pixels))
    for name, color in COLORS.items():
        picture = _picture(strip, dict.fromkeys(colored_pixels, color))
        steps.append(TestStep(f"the first pixels are {name}", (picture,), COLOR_S))
    return steps


def _picture(strip: Strip, lit: dict[int, Rgb]) -> bytes:
    pixels = [lit.get(pixel, DARK) for pixel in range(strip.pixels)]
    return b"".join(map(bytes, pixels))


def _place(position_m: ConfiguredVec3) -> str:
    coordinates = ", ".join(f"{value:g}" for value in position_m)
    return f"({coordinates}) m"


@click.command("test")
@click.option(
    "--strip", "names", multiple=True, metavar="STRIP", help="test only this strip of the map. Repeatable"
)
@setup_options
def command(
    *, scenario: str, output: str, names: tuple[str, ...], files: tuple[Path, ...], settings: tuple[str, ...]
) -> None:
    """Light the pixels of each strip of SCENARIO's map one after the other, to test the connection.

    Steps for each strip: its first pixel green and its last one red, with their positions in the map. A white
    pixel that runs from the first to the last. The first pixels red, green and blue. Enter starts the next
    step at once.

    If the ends are mirrored, set `reversed` in the segment, or `direction: -1` in the map. If colours are
    wrong, set another `order`. If another strip lights, correct `segments`. If nothing lights, a warning
    gives the reason.

    It opens the outputs itself. End a running site first: a serial port has one user, and a controller in
    the network would show both. Ctrl-C ends it. The strips are dark afterwards.

    Example: pointit output test scenario_3 --output ddp:wled-kitchen.local
    """
    setup_logging("error")
    room, driver = read_setup(scenario, output, files, settings)
    strips = {strip.id: strip for strip in room.strips}
    for name in names:
        if name not in strips:
            raise ConfigError(f"--strip {name}: the map has no such strip; it has {', '.join(strips)}")
    tested: Sequence[Strip] = room.strips
    if names:
        tested = [strip for strip in room.strips if strip.id in names]

    # The outputs keep nothing: their folder ends with the test
    with tempfile.TemporaryDirectory() as folder, interruptible():
        health = PrintedWarnings(WELL, as_json=False)
        surroundings = Surroundings(clock=WallClock(), health=health, folder=Path(folder))

        def same(_kind: str, _name: str, _user: str, _which: str) -> Surroundings:
            return surroundings

        outputs = make_outputs(driver.outputs, same, health)
        asyncio.run(_show_steps(outputs, room, tested))


async def _show_steps(outputs: Sequence[GuardedOutput], room: Environment, strips: Sequence[Strip]) -> None:
    """Show the steps of each strip on all outputs, which are dark afterwards."""
    running = [asyncio.create_task(output.run()) for output in outputs]
    numbers = itertools.count(1)  # of frames, as one writer numbers them
    pressed = asyncio.Event()
    try:
        for output in outputs:
            output.set_map(room)
        await asyncio.sleep(CONNECT_S)
        with keys(pressed.set) if has_keyboard() else contextlib.nullcontext():
            for strip in strips:
                for step in steps_of(strip):
                    pressed.clear()
                    click.echo(f"strip {strip.id}: {step.text}")
                    await _show_step(outputs, strip, step, numbers, pressed)
    finally:
        for task in running:
            task.cancel()
        await asyncio.wait(running)


async def _show_step(
    outputs: Sequence[GuardedOutput],
    strip: Strip,
    step: TestStep,
    numbers: "itertools.count[int]",
    pressed: asyncio.Event,
) -> None:
    """Show the pictures of `step`, each for its time, until a key is `pressed`."""
    clock = WallClock()
    for picture in step.pictures:
        shown = (StripFrame(id=strip.id, rgb=picture),)
        frame = StripsFrame(stamp_ns=clock.now_ns(), seq=next(numbers), strips=shown)
        for output in outputs:
            output.show(frame)
        if await wait_up_to(pressed, step.period_s):
            return
