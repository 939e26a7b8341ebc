"""`pointit map new`, `check` and `plot`: the file of a map."""

import importlib.util
import math
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import click

from pointit.cli.common.completions import maps
from pointit.cli.common.output import json_option, print_json
from pointit.cli.common.panels import Finite
from pointit.cli.maps.point import Point, person_option, point
from pointit.maps.checks.check import contents, examined
from pointit.maps.checks.finding import MapFinding
from pointit.maps.checks.things import check_labels, separability
from pointit.maps.edit import write_new
from pointit.maps.file import map_path, parse_map_file, read_map_file, read_whole_map
from pointit.maps.things import things_of
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy
from pointit.schemas.text import all_of, one_line, system_reason

F = TypeVar("F", bound=Callable[..., Any])

COLORS = {"error": "red", "warning": "yellow"}
MAX_PRINTED = 100
"""Maximum of printed findings; a file in millimetres or of another kind has thousands."""
SLOW_S = 2.0
"""Time after which a notice says that the map is being read, s."""
LONGEST = 1000
"""Limit of one finding in characters, since it contains names from the file."""
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

SUFFIXES = (".svg", ".png", ".pdf")
WEB_ADDRESS_REMEDY = (
    "fetch what a WLED has with `curl -o state.json http://WLED/json/state`, then `pointit map import "
    "state.json --as segments`"
)
"""Remedy in the error message if a web server's address is given instead of a file or a ROS node."""


def _points(ctx: click.Context, parameter: click.Parameter, texts: Sequence[str]) -> list[Point | None]:
    return [point(ctx, parameter, text) for text in texts]


@click.command("check")
@click.argument("name_or_path", metavar="MAP", shell_complete=maps)
@person_option
@click.option(
    "--pose",
    "poses_m",
    metavar="X,Y",
    multiple=True,
    callback=_points,
    help="position from which people point at things, m: names those that are hard to tell apart; repeatable",
)
@click.option("--spoken", is_flag=True, help="also report labels that sound alike or take long to speak")
@click.option("--strict", is_flag=True, help="exit with code 1 also for warnings")
@json_option
def check(
    *,
    name_or_path: str,
    person_m: Point | None,
    poses_m: Sequence[Point],
    spoken: bool,
    strict: bool,
    as_json: bool,
) -> None:
    """Show errors and warnings of MAP, a shipped one or the path of a file, with remedies.

    Errors make something impossible: belts that do not meet, positions off a belt, bays on belts that
    continue, loops without an exit, lamps that determine no position. Warnings are probably mistakes: strips
    beside no belt, pixels that do not fit a strip's length, belts without links. The exit code is 1 if there
    is an error.

    Example: pointit map check ./site.yaml
    """
    with map_path(name_or_path) as path, notify_if_slow(f"reading {name_or_path} …"):
        has, findings = examined(str(path), path, lambda: read_map_file(path), person_m, poses_m)
        if has and spoken:
            things = things_of(read_map_file(path))
            findings = [*findings, *check_labels(things)]

    if as_json:
        rows: list[dict[str, str]] = []
        for finding in findings:
            rows.append({"severity": finding.severity, "where": finding.where, "text": finding.text})
        print_json({"map": name_or_path, "has": has, "findings": rows})
    else:
        print_findings(name_or_path, has, findings)

    # With --strict each finding counts as an error
    has_error = any(finding.severity == "error" for finding in findings)
    if has_error or (strict and findings):
        raise SystemExit(1)


@contextmanager
def notify_if_slow(text: str) -> Generator[None]:
    """Print `text` to standard error if the block takes longer than `SLOW_S`."""
    timer = threading.Timer(SLOW_S, lambda: click.echo(text, err=True))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def print_findings(name: str, has: str, findings: Sequence[MapFinding], *, err: bool = False) -> None:
    """Print the first `MAX_PRINTED` findings, and their number; `err`: to standard error."""
    for finding in findings[:MAX_PRINTED]:
        severity = click.style(finding.severity, fg=COLORS[finding.severity], bold=True)
        text = _escape_control_characters(f"{finding.where}: {finding.text}")
        click.echo(f"{severity} {text}", err=err)
    if len(findings) > MAX_PRINTED:
        click.echo(f"... and {len(findings) - MAX_PRINTED} more: --json lists all", err=err)
    errors = sum(finding.severity == "error" for finding in findings)
    warnings = len(findings) - errors
    counts = _counts((errors, "error"), (warnings, "warning"))
    summary = f"{name}: {', '.join(counts) or 'no findings'}"
    if has:
        summary += f"; {has}"
    click.echo(summary, err=err)


def _counts(*numbers: tuple[int, str]) -> list[str]:
    """Return each number with its noun, such as `2 errors`, without zeros."""
    counts: list[str] = []
    for number, noun in numbers:
        if number == 1:
            counts.append(f"1 {noun}")
        elif number:
            counts.append(f"{number} {noun}s")
    return counts


def _escape_control_characters(text: str) -> str:
    """Return `text`, which contains names from the file, without terminal control characters, shortened."""
    return one_line(text[:LONGEST])


class PromptedOption(click.Option):
    """An option that is asked for in a terminal unless it is given; elsewhere its default holds."""

    def prompt_for_value(self, ctx: click.Context) -> Any:
        """Return the answer of the operator, or the default if there is no terminal."""
        if not sys.stdin.isatty():
            return self.get_default(ctx)
        return super().prompt_for_value(ctx)


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
def new(*, file: Path, width: float, depth: float, lamps: int, strips: int) -> None:
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
    has = all_of(_counts((lamps, "lamp"), (strips, "strip")))
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
        right = math.cos(azimuth_rad)
        ahead = math.sin(azimuth_rad)

        # The wall that the direction meets first
        reach_m = 1 / max(abs(right) / x_m, abs(ahead) / y_m)
        lamp_x_m = reach_m * right
        lamp_y_m = reach_m * ahead
        height_m = LAMP_HEIGHTS_M[index % len(LAMP_HEIGHTS_M)]
        position = f"[{lamp_x_m:.3f}, {lamp_y_m:.3f}, {height_m}]"
        yield f"  lamp_{index + 1}: {{position: {position}}}"


def _strips(x_m: float, y_m: float, count: int) -> Iterator[str]:
    """Yield strips along the walls ahead, right, left and behind, then above these."""
    a = x_m - MARGIN_M
    b = y_m - MARGIN_M
    walls = (
        ("ahead", (-a, y_m), (a, y_m)),
        ("right", (x_m, b), (x_m, -b)),
        ("left", (-x_m, -b), (-x_m, b)),
        ("behind", (a, -y_m), (-a, -y_m)),
    )
    for index in range(count):
        wall, first, last = walls[index % len(walls)]
        height_m = STRIP_HEIGHTS_M[index // len(walls)]
        ends = [f"[{x:.3f}, {y:.3f}, {height_m}]" for x, y in (first, last)]
        pixels = round(math.dist(first, last) * PIXELS_PER_M)
        name = wall if index < len(walls) else f"{wall}_high"
        yield f"  {name}:"
        yield f"    line: [{', '.join(ends)}]"
        yield f"    pixels: {pixels}"


@click.command("plot")
@click.argument("name_or_path", metavar="MAP", shell_complete=maps)
@click.option(
    "-o",
    "--output",
    "picture",
    required=True,
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="file of the picture: .svg, .png or .pdf",
)
@person_option
@click.option(
    "--told-apart",
    "shades",
    is_flag=True,
    help="colour the floor by the share of things that pointing from there distinguishes",
)
def command(*, name_or_path: str, picture: Path, person_m: Point | None, shades: bool) -> None:
    """Draw MAP, a shipped one or the path of a file, from above and to scale.

    Shows belts with their direction, strips with their pixel 0, lamps with their height, links, bays,
    solids and point clouds. Needs the extra `plot`: matplotlib

    Example: pointit map plot shelf -o shelf.png --told-apart --person 0.5,-0.5
    """
    if picture.suffix.lower() not in SUFFIXES:
        raise ConfigError(
            f"-o {picture}: not a picture format; give a file that ends in {', '.join(SUFFIXES)}"
        )
    if importlib.util.find_spec("matplotlib") is None:
        raise ConfigError(f"pictures need matplotlib, which is not installed; run {remedy('plot')}")

    # Errors of the map are found before the library is loaded
    with map_path(name_or_path) as path:
        file, room, clouds = read_whole_map(path, 0)
    shares = separability(room.fixed_things, room.paced_from) if shades else None
    from pointit.maps.picture import draw_map  # noqa: PLC0415 - takes half a second and an extra

    try:
        title = f"{room.name}: {contents(file, clouds)}"
        lacks_letters = draw_map(picture, room, clouds, title, person_m, separability=shares)
    except OSError as error:
        raise ConfigError(f"-o {picture}: cannot be written ({system_reason(error)})") from error
    click.echo(f"{picture}: {contents(file, clouds)}")
    if lacks_letters:
        click.echo(
            "note: letters are drawn as boxes: no font here has them; install one, such as Noto Sans CJK",
            err=True,
        )
