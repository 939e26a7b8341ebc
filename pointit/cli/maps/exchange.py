"""`pointit map import` and `export`: exchange of maps with WLED, xLights and Home Assistant."""

import codecs
from collections.abc import Mapping
from itertools import islice
from pathlib import Path

import click

from pointit.cli.common.completions import maps
from pointit.cli.common.output import print_file
from pointit.cli.common.panels import Finite, PanelCommand
from pointit.cli.maps.home_assistant import SOURCE, import_entities
from pointit.cli.maps.map_file import WEB_ADDRESS_REMEDY, notify_if_slow, print_findings
from pointit.maps import exchange
from pointit.maps.checks.check import examined
from pointit.maps.checks.lines import has_detours
from pointit.maps.edit import write_new
from pointit.maps.file import map_path, parse_map_file, read_map_file
from pointit.maps.light_files.pixel_table import parse_pixel_columns
from pointit.maps.light_files.strip_fit import unused_pixels
from pointit.maps.model import StripEntry
from pointit.runtime.config.validation_message import join_names
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import read_limited

MAX_NOTES = 20
"""Limit of notes about the pixels in no strip."""
MAX_FILE = 16 * 2**20
FORMATS = ("csv", "segments", "ledmap")
OUTPUT = click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="file to write; an existing one is never overwritten  [default: standard output]",
)
CELL = click.option(
    "--cell",
    "cell_m",
    type=Finite(0.001, 10),
    default=0.05,
    metavar="M",
    help="size of a cell of a ledmap, m",
)


@click.command(
    "import", cls=PanelCommand, usual=("kind", "url", "token_file", "entities", "areas", "into", "output")
)
@click.argument("source", metavar="FILE", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--as", "kind", type=click.Choice(FORMATS), help="format of FILE; not for home-assistant")
@click.option(
    "--url",
    default="",
    show_default=False,
    help="address of Home Assistant, such as http://homeassistant.local:8123",
)
@click.option(
    "--token-file", default="", show_default=False, metavar="FILE", help="file with a token of Home Assistant"
)
@click.option(
    "--entity", "entities", multiple=True, help="entity of Home Assistant, `light.*` for all lights"
)
@click.option("--area", "areas", multiple=True, help="area of Home Assistant, for all its entities")
@click.option(
    "--into",
    type=click.Path(path_type=Path, dir_okay=False, exists=True),
    metavar="MAP",
    help="map that gets the entities as things without a position; its text stays",
)
@click.option(
    "--per-metre", type=Finite(1, 1000), default=60.0, metavar="N", help="pixels per metre of segments"
)
@click.option(
    "--preset", type=click.IntRange(min=0), metavar="N", help="number of the preset in WLED's presets.json"
)
@click.option(
    "--columns",
    default="",
    show_default=False,
    metavar="LIST",
    help="for csv: columns by name or number and unit, x=1/cm,y=2/cm,z=3/cm,strip=Model,pixel=Node",
)
@click.option(
    "--gap",
    "gap_m",
    type=Finite(0.001, 1000),
    metavar="M",
    help="for csv and ledmap: longest step within a strip, m  [default: for ledmap, the next cell]",
)
@click.option("--first", type=click.IntRange(0, 1), help="for csv: number of the first pixel  [default: 0]")
@CELL
@OUTPUT
def import_(
    *,
    source: Path,
    kind: str | None,
    url: str,
    token_file: str,
    entities: tuple[str, ...],
    areas: tuple[str, ...],
    into: Path | None,
    per_metre: float,
    preset: int | None,
    columns: str,
    first: int | None,
    gap_m: float | None,
    cell_m: float,
    output: Path | None,
) -> None:
    """Make a map of strips from FILE, or a map of things from `home-assistant`.

    csv has one pixel per line, below the names x,y,z in metres, and strip, pixel or wire; --columns declares
    others. ledmap is WLED's, with width and height, laid on an upright plane. segments are WLED's names and
    counts (http://WLED/json/state): they have no positions, so strips lie one above the other until they are
    scanned or moved. A matrix is laid out as one line, also the panels in WLED's cfg.json.

    home-assistant lists lights, switches, covers, fans, media players, scenes and scripts of the Home
    Assistant at --url by area. --entity and --area choose those that become things.

    Example: pointit map import state.json --as segments --per-metre 30 -o wled.yaml
    """
    if kind is None and str(source) == SOURCE:
        import_entities(
            url=url, token_file=token_file, patterns=entities, areas=areas, into=into, output=output
        )
        return
    _check_is_no_address(source)
    if kind is None:
        raise click.UsageError(f"Missing option '--as'. Choose from: {', '.join(FORMATS)}")

    # Strips by format, then the map, which is checked as `pointit map check` does
    path = output or Path(f"{source.stem}.yaml")
    with notify_if_slow(f"reading {source} …"):
        text = _read_text(source)
        try:
            if kind == "csv":
                pixel_columns = parse_pixel_columns(columns, text)
                strips = exchange.from_csv(text, _print_note, pixel_columns, first, gap_m)
            elif kind == "ledmap":
                strips = exchange.from_ledmap(text, cell_m, gap_m)
            else:
                strips = _strips_of_segments(text, preset, 1.0 / per_metre)
        except ConfigError as error:
            raise ConfigError(f"{source}: {error}") from None
        _print_notes(strips)
        content = exchange.strips_text(strips)
        has, findings = examined(str(path), path, lambda: parse_map_file(content.encode(), path))
    print_findings(str(path), has, findings, err=True)
    if not has:
        raise ConfigError(f"{source}: gives a map with the errors above; correct the file")
    _write(output, content)


def _check_is_no_address(source: Path) -> None:
    """Raise ConfigError, with the way to its file, if `source` is an address of a web server."""
    scheme, _, rest = str(source).partition(":/")  # a path has one slash where the address had two
    if scheme in ("http", "https"):
        url = f"{scheme}://{rest}"
        raise ConfigError(f"{url}: not a file; {WEB_ADDRESS_REMEDY}")


def _read_text(source: Path) -> str:
    try:
        data = read_limited(source, MAX_FILE + 1)
        is_utf_16 = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        text = data.decode("utf-16" if is_utf_16 else "utf-8-sig")
    except FileNotFoundError:
        raise ConfigError(f"{source}: there is no such file") from None
    except UnicodeDecodeError as error:
        line = len(error.object[: error.start + 1].splitlines())
        raise ConfigError(f"{source}: line {line} is not UTF-8; save the file as UTF-8") from None
    if len(data) > MAX_FILE:
        raise ConfigError(f"{source}: more than {MAX_FILE} bytes")
    return text


def _print_note(sentence: str) -> None:
    click.echo(f"note: {sentence}", err=True)


def _print_notes(strips: Mapping[str, StripEntry]) -> None:
    for first, last in islice(unused_pixels(strips), MAX_NOTES):
        _print_note(
            f"pixels {first} to {last} of the wire are in no strip; "
            "describe the output by the segments at the end of the map"
        )
    irregular = [name for name, strip in strips.items() if has_detours(strip)]
    if irregular:
        names = join_names(irregular[:MAX_NOTES])
        _print_note(f"{names}: pixels are irregular, so that the line makes detours between them")


def _strips_of_segments(text: str, preset: int | None, pitch_m: float) -> dict[str, StripEntry]:
    segments = exchange.from_segments(text, preset, _print_note)
    for name, segment in segments.items():
        if segment.rows > 1:
            size = f"{segment.columns} x {segment.rows}"
            _print_note(f"{name} is a matrix of {size} pixels, laid out as one line")
        if segment.panels:
            _print_note(
                f"{name} has {segment.pixels} pixels on {segment.panels} panels of a matrix, laid out as one "
                "line: for their positions, scan them, or give WLED's ledmap by --as ledmap"
            )
    return exchange.laid_out(segments, pitch_m)


@click.command("export")
@click.argument("name_or_path", metavar="MAP", shell_complete=maps)
@click.option("--as", "kind", type=click.Choice(FORMATS), required=True, help="format to write")
@click.option(
    "--view",
    type=click.Choice(list(exchange.VIEWS)),
    default="front",
    help="side from which a ledmap is seen",
)
@CELL
@OUTPUT
def export(*, name_or_path: str, kind: str, view: str, cell_m: float, output: Path | None) -> None:
    """Write the pixels of MAP for other programs.

    csv has one pixel per line: x,y,z in metres, its strip and number. segments and ledmap are for WLED with
    all strips on one wire, in the order of the map.

    Example: pointit map export ./room.yaml --as csv -o room.csv
    """
    with map_path(name_or_path) as path:
        file = read_map_file(path)
    if not file.strips:
        raise ConfigError(f"{name_or_path}: has no strips")
    if kind == "csv":
        content = exchange.to_csv(file)
    elif kind == "segments":
        content = exchange.to_segments(file) + "\n"
    else:
        content = exchange.to_ledmap(file, view, cell_m) + "\n"
    _write(output, content)


def _write(output: Path | None, content: str) -> None:
    if output is None:
        print_file(content)
    else:
        write_new(output, content)
