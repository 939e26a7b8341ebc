"""The map in the parameters of another node: `strips.1.line: [x, y, z, x, y, z]`.

A parameter is called SECTION.NAME.KEY. The name may have dots in it, so nothing is nested deeper, whatever a
node says. Bays have no keys, `bays.1: side`; links have numbers, `links.0.from: main`. Only the light and the
place of a thing are nested: `things.nuts.light.strip`, `things.exit.at.belt`.

No core: it waits for another node.
"""

import contextlib
import logging
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backends import check_endpoint, opened
from pointit.bridges.ros2.node_parameters import GET, LIST, MAX_SHOWN, NodeParameters, Value
from pointit.bridges.ros2.over_zenoh.backend import NEEDS
from pointit.bridges.ros2.types.types import Types
from pointit.runtime.config.yaml_file import parse_yaml, read_yaml
from pointit.runtime.errors import ConfigError, ConnectError
from pointit.runtime.service.plugin_guard import NullHealth
from pointit.schemas.text import first_of, one_line

log = logging.getLogger(__name__)

Say = Callable[[str], None]
"""Prints a message for the user."""

ProgressNotice = Callable[[str], contextlib.AbstractContextManager[None]]
"""Wraps a wait that the message describes, to print it if the wait gets long."""

BAYS = "bays"
LINKS = "links"
SECTIONS = frozenset(
    (
        "lamps",
        "leds",  # of the ROS toolkit
        "strips",
        "belts",
        LINKS,
        BAYS,
        "boxes",
        "planes",
        "cylinders",
        "spheres",
        "clouds",
        "paced_from",
        "fences",
        "frames",
        "things",
    )
)
"""Sections of a map's file; docs/reference/maps.md describes them."""
LINES = {"line": "x, y, z", "centerline": "x, y, z", "outline": "x, y"}
"""Keys of lists of points, flattened: ROS has no lists of lists. Coordinates of each point."""

NESTED = ("light", "at")
"""Keys of a thing whose value may be a part of a strip or belt."""
PART = frozenset(("strip", "belt", "from", "to"))
"""Keys of such a part."""

NUMBER = re.compile(r"[0-9]{1,6}")
"""Number of a link."""

APPEARS_S = 2.0
"""Time (s) within which a present node is seen through a router. Discovery is slow on DDS."""
CONNECT_TIMEOUT_S = 2.0
"""Time (s) to look for a ROS router."""
MAX_PATH = 1000
"""Maximum characters of a path to look for here, and of a foreign word in a message."""
SUFFIXES = (".yaml", ".yml")
"""Extensions of files that are read because a foreign node names them: others are no maps, and some never
end."""


def of_maps(names: Iterable[str], prefix: str = "") -> list[str]:
    """Return those of `names` that belong to a map below `prefix` (`site.map`).

    Without a prefix those that begin with a section, below one all names.
    """
    starts: tuple[str, ...] = (_start(prefix),)
    if not prefix:
        starts = tuple(f"{section}." for section in SECTIONS)
    return [name for name in names if name.startswith(starts)]


def tree_of(parameters: Mapping[str, Value], prefix: str = "") -> dict[str, Any]:
    """Return the map in `parameters` below `prefix` as in its file, unchecked.

    Raises:
        ValueError: If a parameter's name or its list is not one of a map; names it and says what to write.
    """
    tree: dict[str, Any] = {}
    start = _start(prefix)
    for name, value in parameters.items():
        section, _, rest = name.removeprefix(start).partition(".")

        # Bays are values themselves; all else has keys
        if section == BAYS and rest:
            tree.setdefault(section, {})[rest] = value
            continue
        entry, _, key = rest.rpartition(".")
        if not all((section, entry, key)):
            raise ValueError(
                f"{name} is not a parameter of a map; they are called {start}SECTION.NAME.KEY, as in "
                f"{start}leds.door.position"
            )
        if section == LINKS and not NUMBER.fullmatch(entry):
            raise ValueError(f"{name}: links have numbers, as in {start}links.0.{key}")
        entries = tree.setdefault(section, {})

        # A part of a strip or belt, which is nested in a thing: `nuts.light`, not a thing of that name
        thing, _, outer = entry.rpartition(".")
        is_part = thing and outer in NESTED and key in PART
        if section == "things" and is_part:
            entries.setdefault(thing, {}).setdefault(outer, {})[key] = value
            continue

        converted = value
        if key in LINES:
            converted = _points(name, value, LINES[key])
        entries.setdefault(entry, {})[key] = converted

    # Links are a list in the file, in the order of their numbers
    if LINKS in tree:
        links = cast("dict[str, Any]", tree[LINKS])
        numbers = sorted(links, key=int)
        tree[LINKS] = [links[number] for number in numbers]
    return tree


def _start(prefix: str) -> str:
    return f"{prefix}." if prefix else ""


def _points(name: str, value: Value, coordinates: str) -> Value:
    """Return a list of numbers as a list of points. Other values are left to the map's check."""
    if not isinstance(value, list):
        return value
    size = len(coordinates.split())
    if len(value) % size:
        size_word = ("two", "three")[size - 2]
        raise ValueError(
            f"{name} has {len(value)} numbers; write {coordinates} of one point after the other, "
            f"{size_word} for each"
        )
    starts = range(0, len(value), size)
    return [value[start : start + size] for start in starts]


@dataclass(frozen=True, kw_only=True)
class FetchRequest:
    """Node and parameter of the wanted map."""

    node: str
    """Its full name."""
    parameter: str | None
    """Parameter that holds the map's text or path."""
    usual: str
    """Default of `parameter`, if the node has it."""
    prefix: str | None
    """Prefix under which the map's values are separate parameters."""
    timeout_s: float
    """Timeout of the node's answer."""


async def fetched(
    config: BackendConfig,
    request: FetchRequest,
    *,
    say: Say = log.info,
    notice: ProgressNotice = lambda _: contextlib.nullcontext(),
) -> dict[str, Any]:
    """Return the map as in its file, unchecked.

    Args:
        config: how to join the ROS graph.
        request: which map of which node.
        say: prints which file was read instead of the node.
        notice: wraps each wait, with a description.

    Raises:
        ConfigError: If nothing there is a map, or it cannot be read.
        ConnectError, ListenError: If the ROS graph cannot be joined.
        NoAnswerError: If there is no such node, or it does not answer.
    """
    check_endpoint(config.endpoint)
    types = Types(config.distro)
    types.prepare(LIST, GET)
    try:
        with notice(f"looking for a ROS router at {config.endpoint} …"):
            backend = await opened(config, NullHealth(), patience_s=CONNECT_TIMEOUT_S)
    except ConnectError as error:
        raise ConnectError(f"{error}; --backend.endpoint says where it is") from error

    # Discovery of DDS may take all of the time; a router knows its nodes at once
    try:
        appears_s = min(APPEARS_S, request.timeout_s)
        if config.kind == "dds":
            appears_s = request.timeout_s
        needs = NEEDS if config.kind == "rmw_zenoh" else ""
        parameters = NodeParameters(
            backend,
            types,
            request.node,
            domain=config.domain_id,
            appears_s=appears_s,
            timeout_s=request.timeout_s,
            needs=needs,
        )
        with notice(f"asking {request.node} for its parameters …"):
            return await _map_of(parameters, request, say)
    finally:
        await backend.close()


async def _map_of(parameters: NodeParameters, request: FetchRequest, say: Say) -> dict[str, Any]:
    names = await parameters.names()
    holder = request.usual if request.parameter is None else request.parameter
    if request.parameter is not None and holder not in names:
        raise ConfigError(f"node {request.node} has no parameter {holder!r}; {_listing(names)}")

    # The parameter that holds all of the map
    if request.prefix is None and holder in names:
        values = await parameters.values([holder])
        text = values.get(holder)
        if isinstance(text, str) and text.strip():
            return _map_of_text(text, f"parameter {holder} of {request.node}", say)
        if request.parameter is not None:
            raise ConfigError(
                f"parameter {holder} of {request.node} is not the text of a map or its path; --parameter "
                "names another"
            )

    # A parameter for each of its values
    prefix = (request.prefix or "").rstrip(".")
    values = await parameters.values(of_maps(names, prefix))
    if not values:
        raise ConfigError(_absence(request, names))
    try:
        return tree_of(values, prefix)
    except ValueError as error:
        raise ConfigError(f"node {request.node}: {error}") from error


def _map_of_text(text: str, origin: str, say: Say) -> dict[str, Any]:
    """Return the map in `text`, or in the YAML file of this machine that it names.

    Raises:
        ConfigError: If it is neither; `origin` names the parameter in messages.
    """
    word = text.strip()
    has_entries = "\n" in word or ": " in word
    if has_entries or word.startswith("{"):
        return parse_yaml(text.encode(), origin)  # unstripped: all its lines may be indented

    # Only a file that can be a map is opened: a foreign node names it
    path = Path(word)
    can_be_map = path.is_absolute() and path.suffix in SUFFIXES
    if can_be_map and len(word) <= MAX_PATH and _is_file(path):
        say(f"{origin} is the path {one_line(word, MAX_PATH)}, of a file that is here too")
        return read_yaml(path)
    raise ConfigError(
        f"{origin} is a path, {one_line(word, MAX_PATH)!r}, of a file on that node's machine; copy the file "
        "to this one, and give it as it is: --set pui.map=FILE"
    )


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # in a folder without permission
        return False


def _absence(request: FetchRequest, names: Sequence[str]) -> str:
    """Return a message that the node has no map in its parameters `names`, with the remedy."""
    problem = f"nothing in the parameters of {request.node} is a map"
    if request.prefix:
        start = request.prefix.rstrip(".")
        problem = f"no parameter of {request.node} begins with '{start}.'"
    return (
        f"{problem}; {_listing(names)}; --parameter names the one that holds a map, --prefix what stands "
        "before lamps., strips., belts."
    )


def _listing(names: Sequence[str]) -> str:
    return f"it has {first_of(names, MAX_SHOWN) or 'none'}"
