"""`pointit leds test`: shows which pixel is where, strip by strip."""

import asyncio
import contextlib
import itertools
import tempfile
from collections.abc import Sequence
from pathlib import Path

import click

from pointit.cli.common.keyboard import has_keyboard, keys
from pointit.cli.common.progress import interruptible
from pointit.cli.leds.leds_setup import PrintedHealth, read_setup, setup_options
from pointit.cli.leds.strip_test import Step, steps_of
from pointit.runtime.clock import WallClock
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.logs import setup_logging
from pointit.runtime.service.surroundings import Surroundings
from pointit.schemas import Environment, Strip, StripFrame, StripsFrame
from pointit.services.led_driver.guarded_output import GuardedOutput
from pointit.services.led_driver.outputs import make_outputs

CONNECT_S = 1.0
"""Time for outputs to connect before the first step, s."""


@click.command("test")
@click.option(
    "--strip", "names", multiple=True, metavar="STRIP", help="test only this strip of the map. Repeatable"
)
@setup_options
def command(
    *, scenario: str, leds: str, names: tuple[str, ...], files: tuple[Path, ...], settings: tuple[str, ...]
) -> None:
    """Light the pixels of each strip of SCENARIO's map one after the other, to test the connection.

    Steps for each strip: its first pixel green and its last one red, with their positions in the map. A white
    pixel that runs from the first to the last. The first pixels red, green and blue. Enter goes on to the
    next step at once.

    If the ends are mirrored, set `reversed` in the segment, or `direction: -1` in the map. If colours are
    wrong, set another `order`. If another strip lights, correct `segments`. If nothing lights, a warning
    tells why.

    It opens the outputs itself. End a running site first: a serial port has one user, and a controller in
    the network would show both. Ctrl-C ends it. The strips are dark afterwards.

    Example: pointit leds test scenario_3 --leds ddp:wled-kitchen.local
    """
    setup_logging("error")
    room, driver = read_setup(scenario, leds, files, settings)
    known = [strip.id for strip in room.strips]
    if missing := [name for name in names if name not in known]:
        raise ConfigError(f"--strip {missing[0]}: the map has no such strip; it has {', '.join(known)}")
    tested = [strip for strip in room.strips if not names or strip.id in names]
    with tempfile.TemporaryDirectory() as folder, interruptible():
        health = PrintedHealth()
        around = Surroundings(clock=WallClock(), health=health, folder=Path(folder))

        def same(_kind: str, _name: str, _user: str, _which: str) -> Surroundings:
            return around

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
    step: Step,
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
