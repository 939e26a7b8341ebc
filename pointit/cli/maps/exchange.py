"""`pointit map import`, `export` and `fetch`: exchange of maps with other programs."""

import asyncio
import codecs
import logging
import os
import unicodedata
from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, cast

import click

from pointit.bridges.home_assistant.config import HomeAssistantConfig
from pointit.bridges.home_assistant.connection import HomeAssistantConnection, connected, is_list
from pointit.bridges.ros2.config import TOPIC, BackendConfig
from pointit.cli.common.completions import maps
from pointit.cli.common.lazy import UnknownNameError
from pointit.cli.common.output import INTERRUPTED, OutputSection, print_file, say, show
from pointit.cli.common.panels import Finite, PanelCommand
from pointit.cli.common.site_link import notify_if_slow as notify_if_slow_site
from pointit.cli.common.site_link import quiet
from pointit.cli.maps.map_file import notify_if_slow, print_findings
from pointit.maps import exchange
from pointit.maps.checks.check import examined
from pointit.maps.checks.lines import has_detours
from pointit.maps.edit import Add, dump_yaml, edited, write_new
from pointit.maps.file import map_path, parse_map_file, read_map_file
from pointit.maps.light_files.pixel_table import parse_pixel_columns
from pointit.maps.light_files.strip_fit import free_name, unused_pixels
from pointit.maps.model import MAX_LABEL, StripEntry
from pointit.runtime.config.config import Layers, environment_prefix
from pointit.runtime.config.nearest_name import nearest
from pointit.runtime.config.parameters import ParameterInfo, iter_parameters
from pointit.runtime.config.validation_message import join_names
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.host.extras import has_extra, remedy
from pointit.runtime.host.state_file import read_limited, replaced_file
from pointit.runtime.service.process import run_until_shutdown

PARAMETER = "map"
"""Default name of a parameter with the text or the path of a map."""
OUR_NODE = "/pointit_map"
"""Name of our node in the graph, different from the bridge's, which may also run."""
MODE = "client"
"""Zenoh mode: a missing router is reported at once, and no node mistakes us for a router."""
ANSWER_S = 5.0
STANDARD = Path("-")
"""Stands for standard output."""


def _leaves() -> list[ParameterInfo]:
    """Return the parameters of the bridge's backend that are also options here."""
    return [
        parameter
        for parameter in iter_parameters(BackendConfig, ("backend",))
        if parameter.path[-1] != "node"
    ]


def _parameter(parameter: ParameterInfo) -> str:
    return "__".join(parameter.path)


def _options() -> list[click.Parameter]:
    return [
        click.Option(
            [_parameter(parameter), parameter.option],
            metavar=f"<{parameter.type_name}>",
            help=f"{parameter.field.description}  "
            f"[default: {MODE if parameter.path[-1] == 'mode' else parameter.default}]",
        )
        for parameter in _leaves()
    ]


@click.command(
    "fetch",
    params=_options(),
    cls=PanelCommand,
    usual=("output", "parameter", "prefix", "backend__kind", "backend__endpoint", "backend__distro"),
)
@click.argument("node")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="file to write  [default: standard output]",
)
@click.option(
    "--parameter",
    metavar="NAME",
    help=f"the parameter that holds the map's text or its path  [default: {PARAMETER}, if there is one]",
)
@click.option(
    "--prefix",
    metavar="NAME",
    help="prefix of lamps., strips., belts. if each has parameters of its own: site.map",
)
@click.option(
    "--timeout",
    "timeout_s",
    type=Finite(min=0.1, max=600),
    default=ANSWER_S,
    help="timeout to find the node, on DDS, and for its reply, s",
)
def command(
    *,
    node: str,
    output: Path | None,
    parameter: str | None,
    prefix: str | None,
    timeout_s: float,
    **backend: str | None,
) -> int:
    """Fetch the map from the parameters of the ROS 2 node NODE, check it and write it to a file.

    Either one parameter holds its text or its path, or each value is a parameter, nested as in ROS:
    lamps.door.position [x, y, z], strips.1.line [x, y, z, x, y, z], strips.1.pixels 25. A map with an error
    is not written; the exit code is 1 then. No ROS is needed here: it joins as `pointit service run ros2`
    does.

    Example: pointit map fetch /pui_node -o site.yaml && pointit run scenario_4 --set pui.map=./site.yaml
    """
    name = node if node.startswith("/") else f"/{node}"
    if not TOPIC.match(name):
        raise UnknownNameError(
            f"NODE {node!r}: not a full node name; write one like /pui_node or /site1/pui_node"
        )
    if parameter is not None and prefix is not None:
        raise UnknownNameError(
            "--parameter and --prefix: the map is in one parameter or in many; give one of them"
        )
    config = _config(backend)
    if not has_extra("ros2"):
        raise ConfigError(f"map fetch needs {remedy('ros2')}")
    from pointit.bridges.ros2.parameters import FetchRequest, fetched  # noqa: PLC0415

    quiet()
    request = FetchRequest(
        node=name, parameter=parameter, usual=PARAMETER, prefix=prefix, timeout_s=timeout_s
    )
    found: list[Mapping[str, Any]] = []

    async def fetch() -> int:
        found.append(await fetched(config, request, say=_say, notice=notify_if_slow_site))
        return 0

    bridge = logging.getLogger("pointit.bridges.ros2")
    bridge.setLevel(logging.ERROR)  # the error at the end is enough
    try:
        run_until_shutdown(fetch())
    finally:
        bridge.setLevel(logging.NOTSET)
    if not found:
        return INTERRUPTED
    _write_fetched(name, found[0], output)
    return 0


def _say(sentence: str) -> None:
    click.echo(sentence, err=True)


def _config(options: Mapping[str, str | None]) -> BackendConfig:
    layers = Layers()
    layers.add({"mode": MODE, "node": OUR_NODE}, "defaults")
    for parameter in _leaves():
        text = options[_parameter(parameter)]
        if text is not None:
            layers.add_text(parameter.path[1:], text, parameter.option)
    return layers.build(BackendConfig)


def _write_fetched(node: str, tree: Mapping[str, Any], output: Path | None) -> None:
    """Write the map if its check finds no error, else end with exit code 1."""
    if output == STANDARD:
        output = None
    text = f"# The map of the ROS node {node}, from its parameters.\n"
    text += dump_yaml(dict(tree))
    content = text.encode()
    name = f"the map of {node}" if output is None else str(output)
    path = Path("map.yaml") if output is None else output
    has, findings = examined(name, path, lambda: parse_map_file(content, path))
    has_errors = any(each.severity == "error" for each in findings)
    if not has_errors:
        if output is None:
            print_file(text)
        else:
            with replaced_file(output) as part:
                part.write_bytes(content)
    print_findings(name, has, findings, err=output is None or has_errors)
    if has_errors:
        click.echo(f"{name}: not written because of errors; correct the parameters of {node}", err=True)
        raise SystemExit(1)


SOURCE = "home-assistant"
DOMAINS = ("light", "switch", "cover", "fan", "media_player", "scene", "script", "input_boolean")
"""Domains of entities that people point at."""
NEEDED_FEATURES = {"cover": 1 | 2, "media_player": 128 | 256}
"""Bits of `supported_features` of entities that can be switched on and off, such as opened and closed."""
MAX_MAP_BYTES = 16 * 2**20


class HomeEntity(NamedTuple):
    """An entity of Home Assistant as its user knows it."""

    area: str
    entity: str
    name: str
    state: str


def import_entities(
    *,
    url: str,
    token_file: str,
    patterns: Sequence[str],
    areas: Sequence[str],
    into: Path | None,
    output: Path | None,
) -> None:
    """List the entities by area, or write those that `patterns` and `areas` choose as things.

    Raises:
        ConfigError: If there is no Home Assistant, a pattern fits no entity, or a file cannot be used.
    """
    layers = Layers()
    layers.add_environment(os.environ, environment_prefix(SOURCE))
    for option, name, value in (("--url", "url", url), ("--token-file", "token_file", token_file)):
        if value:
            layers.add({name: value}, option)
    config = layers.build(HomeAssistantConfig)
    entities = asyncio.run(_read(config))
    if not patterns and not areas:
        rows = tuple(each._asdict() for each in entities)
        show([OutputSection(name="entities", about=f"of {config.url}", rows=rows)], as_json=False)
        say("choose some with --entity or --area, and a map with --into or -o", err=True)
        return
    chosen = chosen_entities(entities, patterns, areas)
    content, path = (
        (b"", output or Path("things.yaml")) if into is None else (read_limited(into, MAX_MAP_BYTES), into)
    )
    text, names = with_things(content, path, chosen)
    if into is not None:
        with replaced_file(into) as part:
            part.write_bytes(text)
    elif output is not None:
        write_new(output, text)
    else:
        print_file(text.decode())
    say(f"things without a position: {', '.join(names) or 'no new ones'}", err=True)
    if names:
        say(f"place them: pointit map point USER {' '.join(names)} --into {path}", err=True)


async def _read(config: HomeAssistantConfig) -> list[HomeEntity]:
    async with connected(config) as connection:
        reading = asyncio.create_task(connection.read())
        try:
            return await entities_of(connection)
        except (TimeoutError, asyncio.CancelledError):
            raise ConfigError(f"{config.url} does not answer: restart Home Assistant") from None
        finally:
            reading.cancel()
            await asyncio.gather(reading, return_exceptions=True)


async def entities_of(connection: HomeAssistantConnection) -> list[HomeEntity]:
    """Return the entities that people can point at, by area and name, without hidden and technical ones."""
    states = await connection.states()
    registry: dict[str, dict[str, Mapping[str, Any]]] = {}
    for kind, key in (("area", "area_id"), ("device", "id"), ("entity", "entity_id")):
        try:
            listed: object = await connection.request(f"config/{kind}_registry/list")
        except RefusedError:  # not for users without rights of an administrator
            listed = []
        entries = [
            cast("Mapping[str, Any]", each)
            for each in (listed if is_list(listed) else ())
            if isinstance(each, dict)
        ]
        registry[kind] = {str(each.get(key)): each for each in entries}
    entities: list[HomeEntity] = []
    for entity, state in states.items():
        entry = registry["entity"].get(entity, {})
        if entity.partition(".")[0] not in DOMAINS or entry.get("hidden_by") or entry.get("entity_category"):
            continue
        needed = NEEDED_FEATURES.get(entity.partition(".")[0], 0)
        features = state.get("attributes", {}).get("supported_features")
        if isinstance(features, int) and features & needed != needed:
            continue
        device = registry["device"].get(entry.get("device_id") or "", {})
        area = registry["area"].get(entry.get("area_id") or device.get("area_id") or "", {})
        name = state.get("attributes", {}).get("friendly_name") or entity
        entities.append(HomeEntity(area.get("name") or "", entity, str(name), str(state.get("state"))))
    return sorted(entities, key=lambda each: (each.area == "", each.area.casefold(), each.entity))


def _folded(area: str) -> str:
    """Return a name as it is compared: letters with accents come composed or, from macOS, decomposed."""
    return unicodedata.normalize("NFC", area).casefold()


def chosen_entities(
    entities: Sequence[HomeEntity], patterns: Sequence[str], areas: Sequence[str]
) -> list[HomeEntity]:
    """Return the entities that one of `patterns` fits, such as `light.*`, and those in `areas`.

    Raises:
        ConfigError: If one fits none.
    """
    chosen: dict[str, HomeEntity] = {}
    for pattern in patterns:
        fitting = {each.entity: each for each in entities if fnmatchcase(each.entity, pattern)}
        if not fitting:
            raise ConfigError(
                f"--entity {pattern}: fits no entity; {nearest(pattern, [each.entity for each in entities])}"
            )
        chosen |= fitting
    for area in areas:
        fitting = {each.entity: each for each in entities if _folded(each.area) == _folded(area)}
        if not fitting:
            known = {each.area for each in entities if each.area}
            raise ConfigError(f"--area {area}: has no entities; {nearest(area, known)}")
        chosen |= fitting
    return list(chosen.values())


def with_things(content: bytes, path: Path, entities: Sequence[HomeEntity]) -> tuple[bytes, list[str]]:
    """Return a map with a thing for each entity that it has not yet, and the names of these things.

    Raises:
        ConfigError: If `content` is no map.
        RefusedError: If its form does not allow to add them.
    """
    things = parse_map_file(content, path).things if content else {}
    known = {each.home_assistant for each in things.values()}
    adds: list[Add] = []
    for each in entities:
        if each.entity in known:
            continue
        name = free_name(each.entity.partition(".")[2][:64], things, [add.name for add in adds])
        value: dict[str, Any] = {"home_assistant": each.entity}
        if each.name.isprintable() and each.name != name and len(each.name) <= MAX_LABEL:
            value["label"] = each.name
        adds.append(Add(section="things", name=name, value=value))
    return edited(content, adds, path), [add.name for add in adds]


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
    "--per-metre", type=Finite(1, 1000), default=60.0, metavar="N", help="pixels a metre of segments"
)
@click.option(
    "--preset", type=click.IntRange(min=0), metavar="N", help="number of the preset in WLED's presets.json"
)
@click.option(
    "--columns",
    default="",
    show_default=False,
    metavar="LIST",
    help="of csv: columns by name or number and unit, x=1/cm,y=2/cm,z=3/cm,strip=Model,pixel=Node",
)
@click.option(
    "--gap",
    "gap_m",
    type=Finite(0.001, 1000),
    metavar="M",
    help="of csv and ledmap: longest step within a strip, m  [default: of ledmap a cell beside]",
)
@click.option("--first", type=click.IntRange(0, 1), help="of csv: number of the first pixel  [default: 0]")
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

    csv has a pixel a line, below the names x,y,z in metres, and strip, pixel or wire; --columns declares
    others. ledmap is WLED's, with width and height, laid on an upright plane. segments are WLED's names and
    counts (http://WLED/json/state): they have no positions, so strips lie one above the other until they
    are scanned or moved. A matrix in WLED's configuration (cfg.json) is laid out by its panels.

    home-assistant lists lights, switches, covers, fans, media players, scenes and scripts of the Home
    Assistant at --url by area. --entity and --area choose those that become things.

    Example: pointit map import state.json --as segments --per-metre 30 -o wled.yaml
    """
    if kind is None and str(source) == SOURCE:
        import_entities(
            url=url, token_file=token_file, patterns=entities, areas=areas, into=into, output=output
        )
        return
    if kind is None:
        raise click.UsageError(f"Missing option '--as'. Choose from: {', '.join(FORMATS)}")
    path = output or Path(f"{source.stem}.yaml")
    with notify_if_slow(f"reading {source} …"):
        text = _read_text(source)
        try:
            if kind == "csv":
                strips = exchange.from_csv(text, _print_note, parse_pixel_columns(columns), first, gap_m)
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
    if uneven := [name for name, strip in strips.items() if has_detours(strip)]:
        names = join_names(uneven[:MAX_NOTES])
        _print_note(f"{names}: pixels are irregular, so that the line makes detours between them")


def _strips_of_segments(text: str, preset: int | None, pitch_m: float) -> dict[str, StripEntry]:
    segments = exchange.from_segments(text, preset, _print_note)
    for name, each in segments.items():
        if each.rows > 1:
            size = f"{each.columns} x {each.rows}"
            _print_note(f"{name} is a matrix of {size} pixels, laid out as one line")
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

    csv has a pixel a line: x,y,z in metres, its strip and number. segments and ledmap are for WLED with all
    strips on one wire, in the order of the map.

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
