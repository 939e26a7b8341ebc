"""`pointit map new`: the map of a room with lamps and strips on its walls."""

import math
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import click

from pointit.cli.common.option_types import Finite
from pointit.cli.maps.check import print_findings
from pointit.maps.checks.examine import examined
from pointit.maps.edit.new_file import write_new
from pointit.maps.file import parse_map_file
from pointit.runtime.errors import ConfigError

F = TypeVar("F", bound=Callable[..., Any])

PIXELS_PER_M = 30
STRIP_HEIGHTS_M = (1.0, 1.6)
"""Heights of the first strip on each wall, and of the second."""
LAMP_HEIGHTS_M = (1.2, 1.8)
"""Heights of lamps, in turn: lamps at one height all round tell less about a position."""
MARGIN_M = 0.1
"""Distance of a strip's ends from the corners of the room."""

HEADER = """\
# A room of {width:g} m by {depth:g} m: {has}.
# Positions in metres: the origin is on the floor in the middle of the room, x to the right, y ahead, z up.
# Measure where your lamps and strips are, change their positions and pixels here, and check the file:
# pointit map check {path}
"""


class PromptedOption(click.Option):
    """An option that is asked for in a terminal unless it is given; elsewhere its default holds."""

    def prompt_for_value(self, ctx: click.Context) -> Any:
        """Return the answer of the operator, or the default if there is no terminal."""
        return super().prompt_for_value(ctx) if sys.stdin.isatty() else self.get_default(ctx)


def _prompted(name: str, kind: "click.ParamType[Any]", default: float, text: str) -> Callable[[F], F]:
    return click.option(
        f"--{name}", cls=PromptedOption, type=kind, default=default, show_default=True, prompt=text, help=text
    )


@click.command("new")
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False), default=Path("room.yaml"))
@_prompted("width", Finite(1, 100), 5.0, "width of the room, m")
@_prompted("depth", Finite(1, 100), 4.0, "depth of the room, m")
@_prompted("lamps", click.IntRange(0, 32), 4, "number of lamps")
@_prompted("strips", click.IntRange(0, 8), 2, "number of LED strips")
def command(*, file: Path, width: float, depth: float, lamps: int, strips: int) -> None:
    """Write the map of a room of your own to FILE, room.yaml by default.

    Asks for each value that no option gives. Lamps and strips are spread over the walls; replace their
    positions with measured ones. Prints the next commands.

    Example: pointit map new room.yaml --width 6 --depth 4 --lamps 4 --strips 2
    """
    if lamps + strips == 0:
        raise ConfigError("--lamps 0 and --strips 0: there is nothing to point at; give at least one of them")
    if file.suffix not in (".yaml", ".yml"):
        raise ConfigError(f"{file}: a map ends in .yaml; write {file}.yaml")
    text = room_map(file, width, depth, lamps, strips)
    has, findings = examined(str(file), file, lambda: parse_map_file(text.encode(), file))
    write_new(file, text)
    print_findings(str(file), has, findings)
    path = file if len(file.parts) > 1 else f"./{file}"
    scenario = "scenario_2" if strips else "scenario_1"
    click.echo(f"run it: pointit run {scenario} --set pui.map={path} --pose 0,0")
    click.echo(f"check it after each change: pointit map check {path}")


def room_map(file: Path, width_m: float, depth_m: float, lamps: int, strips: int) -> str:
    """Return the text of the map of a room, in {W} with the origin in the middle of its floor."""
    counts = ((lamps, "lamp"), (strips, "strip"))
    has = " and ".join(f"{count} {word}{'s' * (count > 1)}" for count, word in counts if count)
    sections = [HEADER.format(width=width_m, depth=depth_m, has=has, path=file)]
    if lamps:
        sections += ["lamps:", *_lamps(width_m / 2, depth_m / 2, lamps)]
    if strips:
        sections += ["strips:", *_strips(width_m / 2, depth_m / 2, strips)]
    return "\n".join([*sections, ""])


def _lamps(x_m: float, y_m: float, count: int) -> Iterator[str]:
    """Yield lamps on the walls, clockwise from ahead on the left, 11° or more apart from the middle."""
    step_rad = min(2 * math.pi / count, math.pi / 2)
    for index in range(count):
        azimuth_rad = math.atan2(1, -1) - index * step_rad
        right, ahead = math.cos(azimuth_rad), math.sin(azimuth_rad)
        reach_m = 1 / max(abs(right) / x_m, abs(ahead) / y_m)
        height_m = LAMP_HEIGHTS_M[index % len(LAMP_HEIGHTS_M)]
        position = f"[{reach_m * right:.3f}, {reach_m * ahead:.3f}, {height_m}]"
        yield f"  lamp_{index + 1}: {{position: {position}}}"


def _strips(x_m: float, y_m: float, count: int) -> Iterator[str]:
    """Yield strips along the walls ahead, right, left and behind, then above these."""
    a, b = x_m - MARGIN_M, y_m - MARGIN_M
    walls = (
        ("ahead", (-a, y_m), (a, y_m)),
        ("right", (x_m, b), (x_m, -b)),
        ("left", (-x_m, -b), (-x_m, b)),
        ("behind", (a, -y_m), (-a, -y_m)),
    )
    for index in range(count):
        wall, first, last = walls[index % len(walls)]
        height_m = STRIP_HEIGHTS_M[index // len(walls)]
        ends = ", ".join(f"[{x:.3f}, {y:.3f}, {height_m}]" for x, y in (first, last))
        yield f"  {wall if index < len(walls) else f'{wall}_high'}:"
        yield f"    line: [{ends}]"
        yield f"    pixels: {round(math.dist(first, last) * PIXELS_PER_M)}"
