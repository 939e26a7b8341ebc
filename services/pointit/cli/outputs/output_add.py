"""`pointit output add`: a further output for strips of a running site."""

import time
from typing import Any, Unpack

import click

from pointit.cli.common.output import json_option, say, to_json
from pointit.cli.common.site_link import AtSite, join_site, quiet, site_options
from pointit.runtime.clock import WallClock
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import plugin_folder
from pointit.runtime.service.shutdown import run_until_shutdown
from pointit.runtime.service.surroundings import NullHealth, Surroundings
from pointit.schemas import Environment, LampColor, StripFrame, StripsFrame
from pointit.schemas.topics import LAMP_COLOR, MAP, SERVICE_ALIVE, STRIPS_FRAME
from pointit.services.led_driver.guarded_output import GuardedOutput
from pointit.services.led_driver.outputs import OUTPUTS, OutputConfig, make_outputs

LED_DRIVER = "led-driver"
"""Instance whose frames are shown. Without it the strips are dark."""


class PrintedWarnings(NullHealth):
    """Prints all warnings whenever they change."""

    def __init__(self, well: str, *, as_json: bool) -> None:
        """Create without warnings. `well`: the sentence that is printed when there are none any more."""
        self._well = well
        self._as_json = as_json
        self._warnings: dict[str, str] = {}

    def warn(self, topic: str, sentence: str) -> None:
        """Set the warning of a topic, or clear it by `""`."""
        if self._warnings.get(topic, "") == sentence:
            return
        self._warnings[topic] = sentence
        self.tell()

    def clear(self, topic: str) -> None:
        """Clear the warning of a topic."""
        self.warn(topic, "")

    def tell(self) -> None:
        """Print the warnings, or that all is well."""
        warnings = [sentence for sentence in self._warnings.values() if sentence]
        if self._as_json:
            click.echo(to_json({"warnings": warnings}))
        else:
            say("; ".join(warnings) or self._well, err=True)


@click.command("add", params=site_options())
@click.argument("output")
@click.option(
    "--strip",
    "strips",
    multiple=True,
    metavar="STRIP",
    help="strip of the map to show, behind the pixels of the strip before. Repeatable  [default: all]",
)
@json_option
def command(output: str, *, strips: tuple[str, ...], as_json: bool, **at: Unpack[AtSite]) -> int:
    """Show strips of a running site on one more OUTPUT, such as ddp:HOST for a WLED.

    The site keeps running, and its other outputs do not change. The lights go dark after Ctrl-C, and while
    the site's led-driver does not run. With --json, each line is an object with the `warnings` from then on.

    Example: pointit output add ddp:wled-kitchen.local --strip shelf
    """
    quiet()
    config = _config(output, strips)
    frames = ", ".join(f"strip {strip}" for strip in strips) or "all strips"
    return run_until_shutdown(
        _show(config, PrintedWarnings(f"{output} shows {frames}", as_json=as_json), **at)
    )


def _config(output: str, strips: tuple[str, ...]) -> OutputConfig:
    try:
        kind, parameters = OUTPUTS.choose(output)
        segments = [{"strip": strip} for strip in strips]
        values = {"kind": kind, **parameters, **({"segments": segments} if segments else {})}
        config: Any = OUTPUTS.validate(kind, values)
    except (ConfigError, ValueError) as error:
        raise ConfigError(f"{output}: {error}") from error
    assert isinstance(config, OutputConfig)  # noqa: S101 - of the group of outputs
    return config


async def _show(config: OutputConfig, health: PrintedWarnings, **at: Unpack[AtSite]) -> int:
    async with join_site(**at) as bus:
        folder = plugin_folder(bus.site, "", OUTPUTS.kind, config.kind)
        surroundings = Surroundings(clock=WallClock(), health=health, folder=folder)
        (output,) = make_outputs([config], lambda _kind, _name, _user, _which: surroundings, health)
        if output.follows_cursors:
            raise ConfigError(f"{config.kind}: follows people's cursors; give it to `pointit run --output`")
        frames = SiteFrames(output)
        bus.subscribe(MAP, frames.on_map)
        bus.subscribe(STRIPS_FRAME, frames.on_frame)
        bus.subscribe(LAMP_COLOR, frames.on_lamp)
        bus.watch(SERVICE_ALIVE, frames.on_service)
        health.tell()
        await output.run()
    return 0


class SiteFrames:
    """Passes on to an output what the site shows; nothing is lit without `LED_DRIVER`."""

    def __init__(self, output: GuardedOutput) -> None:
        self._output = output
        self._frame = StripsFrame(stamp_ns=0, strips=())
        self._lamps: set[str] = set()

    def on_map(self, room: Environment, _name: str) -> None:
        """Set the map, and show the last frame again."""
        self._output.set_map(room)
        self._output.show(self._frame)

    def on_frame(self, frame: StripsFrame, _name: str) -> None:
        """Show a frame."""
        self._frame = frame
        self._output.show(frame)

    def on_lamp(self, lamp: LampColor, name: str) -> None:
        """Show the colour of a lamp."""
        self._lamps.add(name)
        self._output.show_lamp(name, lamp.color)

    def on_service(self, instance: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
        """Show darkness when `LED_DRIVER` has left."""
        if instance == LED_DRIVER and not present:
            dark = tuple(StripFrame(id=each.id, rgb=bytes(len(each.rgb))) for each in self._frame.strips)
            self.on_frame(StripsFrame(stamp_ns=time.time_ns(), strips=dark), "")
            for name in self._lamps:
                self._output.show_lamp(name, (0, 0, 0))
