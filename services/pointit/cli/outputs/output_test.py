"""`pointit output test`: shows which pixel is where, strip by strip."""

import asyncio
import contextlib
import itertools
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import click

from pointit.cli.common.keyboard import has_keyboard, keys
from pointit.cli.common.progress import interruptible
from pointit.cli.outputs.output_setup import PrintedHealth, read_setup, setup_options
from pointit.runtime.clock import WallClock
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.logs import setup_logging
from pointit.runtime.service.surroundings import Surroundings
from pointit.schemas import Environment, Strip, StripFrame, StripsFrame
from pointit.schemas.base import Rgb, Vec3
from pointit.services.led_driver.guarded_output import GuardedOutput
from pointit.services.led_driver.outputs import make_outputs

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
    first_m, last_m = strip.line_m[:: len(strip.line_m) - 1][:: strip.direction]
    ends = {0: COLORS["green"], strip.pixels - 1: COLORS["red"]}
    count = min(strip.pixels, RUN_PICTURES)
    run = [number * (strip.pixels - 1) // max(1, count - 1) for number in range(count)]
    begin = range(min(COLORED_PIXELS, strip.pixels))
    return [
        TestStep(
            f"first of {strip.pixels} pixels green, at {_place(first_m)} in the map; last red, at "
            f"{_place(last_m)}",
            (_picture(strip, ends),),
            ENDS_S,
        ),
        TestStep(
            "a white pixel runs from the green to the red end",
            tuple(_picture(strip, {pixel: (255, 255, 255)}) for pixel in run),
            RUN_S / count,
        ),
        *(
            TestStep(f"the first pixels are {name}", (_picture(strip, dict.fromkeys(begin, color)),), COLOR_S)
            for name, color in COLORS.items()
        ),
    ]


def _picture(strip: Strip, lit: dict[int, Rgb]) -> bytes:
    return b"".join(bytes(lit.get(pixel, DARK)) for pixel in range(strip.pixels))


def _place(position_m: Vec3) -> str:
    return "(" + ", ".join(f"{value:g}" for value in position_m) + ") m"


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
    wrong, set another `order`. If another strip lights, correct `segments`. If nothing lights, a warning has
    the reason.

    It opens the outputs itself. End a running site first: a serial port has one user, and a controller in
    the network would show both. Ctrl-C ends it. The strips are dark afterwards.

    Example: pointit output test scenario_3 --output ddp:wled-kitchen.local
    """
    setup_logging("error")
    room, driver = read_setup(scenario, output, files, settings)
    known = [strip.id for strip in room.strips]
    if missing := [name for name in names if name not in known]:
        raise ConfigError(f"--strip {missing[0]}: the map has no such strip; it has {', '.join(known)}")
    tested = [strip for strip in room.strips if not names or strip.id in names]
    with tempfile.TemporaryDirectory() as folder, interruptible():
        health = PrintedHealth()
        surroundings = Surroundings(clock=WallClock(), health=health, folder=Path(folder))

        def same(_kind: str, _name: str, _user: str, _which: str) -> Surroundings:
            return surroundings

        outputs = make_outputs(driver.outputs, same, health)
        asyncio.run(_show(outputs, room, tested))


async def _show(outputs: Sequence[GuardedOutput], room: Environment, strips: Sequence[Strip]) -> None:
    """Show the steps of each strip on all outputs, which are dark afterwards."""
    running = [asyncio.create_task(output.run()) for output in outputs]
    numbers = itertools.count(1)
    pressed = asyncio.Event()
    try:
        for output in outputs:
            output.set_map(room)
        await asyncio.sleep(CONNECT_S)
        with keys(pressed.set) if has_keyboard() else contextlib.nullcontext():
            for strip, step in [(each, step) for each in strips for step in steps_of(each)]:
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
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(step.period_s):
                await pressed.wait()
            return
