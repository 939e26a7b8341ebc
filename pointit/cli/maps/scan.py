"""`pointit map scan`: a map from photographs of blinking strips and lamps, taken now or in a file."""

import json
import re
import secrets
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import click

from pointit.cli.common.output import print_file
from pointit.cli.common.panels import Finite, PanelCommand
from pointit.cli.maps.map_file import print_findings
from pointit.geometry.polyline import Polyline
from pointit.maps.checks.check import examined
from pointit.maps.edit import write_new
from pointit.maps.file import load_map, parse_map_file
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.process import EXIT_FAILED
from pointit.scan.advice import next_view
from pointit.scan.result import Scan, ScannedLamp, ScannedStrip, map_text
from pointit.scan.solver import solve
from pointit.scan.views import KnownLength, Mark, read_survey
from pointit.schemas.topics import check_name

F = TypeVar("F", bound=Callable[..., Any])

ROW_M = 0.1
"""Distance of the strips in the map to begin with, of which only names and numbers are right."""
SCENARIO = """\
about: a room that is being mapped
places: [{position_m: [0, 0, 0]}]
site:
  pui: {map: begin.yaml, surfaces: [strip]}
  led-driver: {}
  keeper: {}
user: {}
"""

FORM = """\b
FILE is JSON:
  {"strips": [{"name": "desk", "count": 60, "pitch_m": 0.01667}],
   "lamps": [{"name": "door"}],
   "views": [{"width": 1280, "height": 720, "gravity": [0.02, 0.98, 0.17],
     "sightings": [{"name": "desk", "pixel": 0, "u": 401.2, "v": 311.9}]}]}
A pitch is the distance from pixel to pixel, m. u and v are image pixels,
right and down. gravity is the unit vector of down in the camera's frame
(x right, y down, z forward), and may be left out."""


def scan_live(
    context: click.Context,
    file: Path,
    *,
    map_name: str,
    strips: Sequence[str],
    lamps: Sequence[str],
    per_m: float,
    leds: str,
    simulated: bool,
    run_options: Sequence[str] = (),
) -> int:
    """Run a site with these strips until Ctrl-C, and print the link of the page.

    Args:
        context: of the command.
        file: map to write.
        map_name: a map whose strips' names and numbers of pixels are right, and whose lamps blink, too, or
            `""`. For a simulated camera it is the room.
        strips: `NAME=PIXELS` of further strips.
        lamps: names of further lamps.
        per_m: LEDs per metre of `strips`; the page asks for each.
        leds: output, as for `pointit run`, or `""`.
        simulated: True for a simulated camera in a simulated room.
        run_options: further options of `pointit run`.

    Raises:
        ConfigError: If there are no strips, something is wrong with them, or the file exists.
    """
    if file.exists():
        raise ConfigError(f"{file}: exists already; choose another name or move it away")
    if not file.absolute().parent.is_dir():
        raise ConfigError(f"{file}: there is no folder {file.parent}")
    for name in lamps:
        check_name(name, "--lamp")
    counts = dict(map(_strip, strips))
    lengths_m = {name: count / per_m for name, count in counts.items()}
    if simulated:
        from pointit.bridges.web.scan.simulated_room import ROOM  # noqa: PLC0415 - of the page's extra

        map_name = map_name or str(ROOM)
    if map_name:
        known = load_map(map_name, 0)
        known_counts = {strip.id: strip.pixels for strip in known.strips}
        known_lengths_m = {strip.id: Polyline(strip.line_m).length_m for strip in known.strips}
        counts = known_counts | counts
        lengths_m = known_lengths_m | lengths_m
        lamps = [*(lamp.id for lamp in known.lamps), *lamps]
    if not counts:
        raise ConfigError("no strips are given: add --strip NAME=PIXELS for each, or --simulated to try it")

    # The site is a run with a scenario of its own, and a map to begin with
    command = context.find_root().command
    assert isinstance(command, click.Group)  # noqa: S101 - the root of all commands
    run = command.get_command(context, "run")
    assert run is not None  # noqa: S101 - of the core
    with tempfile.TemporaryDirectory(prefix="pointit-scan-") as folder:
        scenario = Path(folder) / "scan.yaml"
        scenario.write_text(SCENARIO, encoding="utf-8")
        begin = Path(folder) / "begin.yaml"
        begin.write_text(first_map(counts, lengths_m, lamps), encoding="utf-8")
        settings = {
            "pui.map": str(begin),
            "web.scan_file": str(file.absolute()),
            "web.scan_token": secrets.token_urlsafe(18),
            "web.scan_room": map_name if simulated else "",
        }
        arguments = [str(scenario), "--site-only", "--no-view", *run_options]
        for name, value in settings.items():
            arguments.append(f"--set={name}={json.dumps(value)}")
        if not simulated:  # a phone has the camera
            arguments.append("--lan")
        if leds:
            arguments.append(f"--output={leds}")
        result: int = run.main(arguments, prog_name="pointit map scan", standalone_mode=False)
    return result


def first_map(counts: Mapping[str, int], lengths_m: Mapping[str, float], lamps: Sequence[str]) -> str:
    """Return a map of lamps and strips side by side, with placeholder positions, as YAML."""
    rows = ["lamps:"] if lamps else []
    for row, name in enumerate(dict.fromkeys(lamps), 1):
        y_m = -ROW_M * row
        rows.append(f"  {json.dumps(name)}: {{position: [0, {y_m:.1f}, 1]}}")
    rows.append("strips:")
    for row, (name, count) in enumerate(counts.items()):
        y_m = ROW_M * row
        first = f"[0, {y_m:.1f}, 1]"
        last = f"[{lengths_m[name]:.3f}, {y_m:.1f}, 1]"
        rows.append(f"  {json.dumps(name)}: {{line: [{first}, {last}], pixels: {count}}}")
    return "\n".join([*rows, ""])


def _strip(text: str) -> tuple[str, int]:
    parts = re.fullmatch(r"([A-Za-z0-9_][A-Za-z0-9_.-]{0,63})=([0-9]{1,4})", text)
    if parts is None or not 2 <= int(parts[2]) <= 4096:
        raise ConfigError(f"--strip {text}: write NAME=PIXELS, such as shelf=90, with 2 to 4096 pixels")
    return parts[1], int(parts[2])


def live_options(function: F) -> F:
    """Add the options and the argument that `scan_live` takes."""
    # click shows the option first that was added last
    for add in (
        click.argument("run_options", nargs=-1, type=click.UNPROCESSED),
        click.option("--simulated", is_flag=True, help="a simulated camera in a simulated room"),
        click.option(
            "--leds", default="", show_default=False, metavar="OUTPUT", help="output, as for `pointit run`"
        ),
        click.option(
            "--leds-per-m",
            "per_m",
            type=Finite(2, 1000),
            default=60.0,
            help="LEDs per metre of the strips; the page asks for each strip",
        ),
        click.option(
            "--map",
            "map_name",
            default="",
            show_default=False,
            metavar="MAP",
            help="map that has the strips, at any position; with --simulated, the room",
        ),
        click.option(
            "--strip",
            "strips",
            multiple=True,
            metavar="NAME=PIXELS",
            help="a strip, in the order of the controller's pixels. Repeatable",
        ),
        click.option(
            "--lamp", "lamps", multiple=True, metavar="NAME", help="a lamp of the output. Repeatable"
        ),
    ):
        function = add(function)
    return function


def _known(ctx: click.Context, parameter: click.Parameter, text: str | None) -> KnownLength | None:
    if text is None:
        return None
    try:
        start, end, metres = text.split(",")
        return KnownLength(_mark(start), _mark(end), float(metres))
    except ValueError:
        raise click.BadParameter(
            f"{text!r} is no known length; write NAME:PIXEL,NAME:PIXEL,METRES such as desk:0,desk:59,0.98",
            ctx,
            parameter,
        ) from None


def _mark(text: str) -> Mark:
    name, _, pixel = text.rpartition(":")
    return Mark(name, int(pixel)) if name else Mark(text)


@click.command(
    "scan",
    epilog=FORM,
    cls=PanelCommand,
    usual=("output", "strips", "lamps", "leds", "map_name", "source", "simulated"),
)
@click.option(
    "--from",
    "source",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="file of views, see below, instead of a camera",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="MAP",
    help="map to write; a new file  [default: room.yaml; with --from, standard output]",
)
@click.option(
    "--known",
    callback=_known,
    metavar="NAME:PIXEL,NAME:PIXEL,M",
    help="a measured distance between two pixels or lamps, m; scales everything",
)
@click.option("--all", "also_doubtful", is_flag=True, help="also write lights that are not identified")
@live_options
@click.pass_context
def command(
    context: click.Context,
    /,
    *,
    source: Path | None,
    output: Path | None,
    known: KnownLength | None,
    also_doubtful: bool,
    **live: Any,
) -> int:
    """Map a room with a camera. Its strips blink their numbers, and a page on a phone finds their positions.

    Starts a site with the strips, and prints a link, and a QR code for a phone in the same network. The page
    leads from view to view, and writes the map. No picture leaves the phone. With --from, the map is
    computed from views in a file. Arguments after `--` are options of `pointit run`.

    Three photographs, a step apart, suffice for strips that all of them show, and four to six for a room.
    Each should show three strips of an earlier one. Strips are found to about 1 cm, with the standard
    deviation of each stated. Doubtful strips are omitted, with the reason and the position for one more
    photograph: with --from, the exit code is 1 then.

    Example: pointit map scan -o room.yaml --strip shelf=90 --leds ddp:192.168.1.40
    """
    if source is None:
        if known is not None or also_doubtful:
            raise ConfigError("--known and --all need --from; without it, choose in the page")
        return scan_live(context, output or Path("room.yaml"), **live)

    # Views in a file
    survey = read_survey(source)
    if known is not None:
        survey = replace(survey, known_length=known)
    try:
        scan = solve(survey.strips, survey.lamps, survey.views, known_length=survey.known_length)
    except ConfigError as error:
        raise ConfigError(f"{source}: {error}") from None

    # The map is checked but written in any case: its findings concern what was measured
    text = map_text(scan, only_identified=not also_doubtful)
    if output is not None:
        path = output
        has, findings = examined(str(path), path, lambda: parse_map_file(text.encode(), path))
        write_new(path, text)
        print_findings(str(path), has, findings, err=True)
    else:
        print_file(text)
    for sentence in _sentences(scan):
        click.echo(sentence, err=True)
    has_all = also_doubtful or all(light.identified for light in _lights(scan))
    is_whole = has_all and not scan.missing
    return 0 if is_whole else EXIT_FAILED


def _lights(scan: Scan) -> list[ScannedStrip | ScannedLamp]:
    return [*scan.strips.values(), *scan.lamps.values()]


def _sentences(scan: Scan) -> list[str]:
    """Return sentences about a scan: problems, doubts, the next step."""
    sentences = [*scan.problems]
    for light in _lights(scan):
        if light.reason:
            sentences.append(f"{light.name}: {light.reason}")
    advice = next_view(scan)
    sentences.append(f"next: {advice.text}" if advice else "complete")
    return sentences
