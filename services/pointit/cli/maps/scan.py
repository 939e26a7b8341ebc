"""`pointit map scan`: a map from photographs of blinking strips and lamps, taken now or in a file."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from pointit.cli.common.output import print_file
from pointit.cli.common.panels import PanelCommand
from pointit.cli.maps.check import print_findings
from pointit.cli.maps.scan_live import live_options, scan_live
from pointit.maps.checks.examine import examined
from pointit.maps.edit.new_file import write_new
from pointit.maps.file import parse_map_file
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.shutdown import EXIT_FAILED
from pointit.scan.advice import next_view
from pointit.scan.as_map import map_text
from pointit.scan.result import Scan, ScannedLamp, ScannedStrip
from pointit.scan.solver import solve
from pointit.scan.views import KnownLength, Mark, read_survey

FORM = """\b
FILE is JSON:
  {"strips": [{"name": "desk", "count": 60, "pitch_m": 0.01667}],
   "lamps": [{"name": "door"}],
   "views": [{"width": 1280, "height": 720, "gravity": [0.02, 0.98, 0.17],
     "sightings": [{"name": "desk", "pixel": 0, "u": 401.2, "v": 311.9}]}]}
A pitch is the distance from pixel to pixel, m. u and v are image pixels,
right and down. gravity is the unit vector of down in the camera's frame
(x right, y down, z forward), and may be left out."""


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
@click.option("--all", "also_doubtful", is_flag=True, help="write what is not identified, too")
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
    """Map a room by a camera: its strips blink their numbers, and a phone's page finds where they are.

    Starts a site with the strips, and prints a link, and a QR code for a phone in the same network. The page
    leads from view to view, and writes the map. No picture leaves the phone. With --from, the map is
    computed from views in a file. Arguments after `--` are options of `pointit run`.

    Three photographs suffice for what all show, a step apart, and four to six for a room. Each should
    show three strips of an earlier one. Strips are found to about 1 cm, with the standard deviation of each
    stated. What is doubtful is left out, with the reason and from where to take one more photograph: with
    --from, the exit code is 1 then.

    Example: pointit map scan -o room.yaml --strip shelf=90 --leds ddp:192.168.1.40
    """
    if source is None:
        if known is not None or also_doubtful:
            raise ConfigError("--known and --all go with --from only; the page has such a choice")
        return scan_live(context, output or Path("room.yaml"), **live)
    survey = read_survey(source)
    if known is not None:
        survey = replace(survey, known_length=known)
    try:
        scan = solve(survey.strips, survey.lamps, survey.views, known_length=survey.known_length)
    except ConfigError as error:
        raise ConfigError(f"{source}: {error}") from None
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
    scanned: list[ScannedStrip | ScannedLamp] = [*scan.strips.values(), *scan.lamps.values()]
    is_whole = not scan.missing and (also_doubtful or all(each.identified for each in scanned))
    return 0 if is_whole else EXIT_FAILED


def _sentences(scan: Scan) -> list[str]:
    """Return sentences about a scan: problems, doubts, the next step."""
    scanned: list[ScannedStrip | ScannedLamp] = [*scan.strips.values(), *scan.lamps.values()]
    uncertain = [f"{each.name}: {each.reason}" for each in scanned if each.reason]
    advice = next_view(scan)
    return [*scan.problems, *uncertain, *([f"next: {advice.text}"] if advice else ["complete"])]
