"""The map of a ROS node: finds out how its parameters hold it, and takes it."""

import contextlib
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backends import NEEDS, check_endpoint, opened
from pointit.bridges.ros2.message_format import listed, shown
from pointit.bridges.ros2.parameters.map_parameters import of_maps, prefixes, tree_of
from pointit.bridges.ros2.parameters.node_parameters import GET, LIST, MAX_SHOWN, NodeParameters
from pointit.bridges.ros2.parameters.values import Value
from pointit.bridges.ros2.types.types import Types
from pointit.runtime.config.yaml_file import parse_yaml, read_yaml
from pointit.runtime.errors import ConfigError, ConnectError

log = logging.getLogger(__name__)

APPEARS_S = 2.0
"""Within which a node that is there is seen through a router; who is there on DDS is found out slowly."""
PATIENCE_S = 2.0
"""How long to look for a ROS router."""
MAX_PATH = 1000
"""Characters of a path that is looked for here, and of a foreign word in a sentence."""
SUFFIXES = (".yaml", ".yml")
"""Of files that are read because a foreign node names them: others are no maps, and some never end."""


Say = Callable[[str], None]
"""Takes a sentence for the person who asked for the map."""

Telling = Callable[[str], contextlib.AbstractContextManager[None]]
"""Wraps a wait that the sentence describes, for who says it when the wait gets long."""


@dataclass(frozen=True, kw_only=True)
class FetchRequest:
    """What to take, from whom."""

    node: str
    """Its full name."""
    parameter: str | None
    """What holds the map's text or path."""
    usual: str
    """The same where nothing is said of it, if the node has it."""
    prefix: str | None
    """Below what the map's values are parameters of their own."""
    timeout_s: float
    """How long the node may take to answer."""


class _Unheard:
    """What a node complains about while it is there; that of so short a visit is in the error."""

    def warn(self, topic: str, sentence: str) -> None:
        log.debug("%s: %s", topic, sentence)

    def clear(self, topic: str) -> None:
        log.debug("%s: well", topic)


async def fetched(
    config: BackendConfig,
    wish: FetchRequest,
    *,
    say: Say = log.info,
    telling: Telling = lambda _: contextlib.nullcontext(),
) -> dict[str, Any]:
    """Return the map, as its file would have it; nothing in it is checked yet.

    Args:
        config: how to join the ROS graph.
        wish: which map of which node.
        say: is told which file was read in the node's place.
        telling: wraps each wait, with what is waited for.

    Raises:
        ConfigError: nothing there is a map, or it cannot be read.
        ConnectError, ListenError: the ROS graph cannot be joined.
        NoAnswerError: there is no such node, or it does not answer.
    """
    check_endpoint(config.endpoint)
    types = Types(config.distro)
    types.prepare(LIST, GET)
    try:
        with telling(f"looking for a ROS router at {config.endpoint} …"):
            backend = await opened(config, _Unheard(), patience_s=PATIENCE_S)
    except ConnectError as error:
        raise ConnectError(f"{error}; --backend.endpoint says where it is") from error
    try:
        parameters = NodeParameters(
            backend,
            types,
            wish.node,
            domain=config.domain_id,
            appears_s=wish.timeout_s if config.kind == "dds" else min(APPEARS_S, wish.timeout_s),
            timeout_s=wish.timeout_s,
            max_bytes=config.max_message_bytes,
            needs=NEEDS if config.kind == "rmw_zenoh" else "",
        )
        with telling(f"asking {wish.node} for its parameters …"):
            return await _taken(parameters, wish, say)
    finally:
        await backend.close()


async def _taken(parameters: NodeParameters, wish: FetchRequest, say: Say) -> dict[str, Any]:
    names = await parameters.names()
    holder = wish.usual if wish.parameter is None else wish.parameter
    if wish.parameter is not None and holder not in names:
        raise ConfigError(f"node {wish.node} has no parameter {holder!r}; {_there(names)}")
    if wish.prefix is None and holder in names:
        held = (await parameters.values([holder])).get(holder)
        if isinstance(held, str) and held.strip():
            return _of_text(held, f"parameter {holder} of {wish.node}", say)
        if wish.parameter is not None:
            raise ConfigError(
                f"parameter {holder} of {wish.node} is {_kind(held)}, not the text of a map or its path; "
                "--parameter names another"
            )
    prefix = (wish.prefix or "").rstrip(".")
    values = await parameters.values(of_maps(names, prefix))
    if not values:
        raise ConfigError(_nothing(wish, names))
    try:
        return tree_of(values, prefix)
    except ValueError as error:
        raise ConfigError(f"node {wish.node}: {error}") from error


def _of_text(text: str, where: str, say: Say) -> dict[str, Any]:
    """Return the map that `text` is, or that is in the YAML file whose path it is, if that is here too.

    Raises:
        ConfigError: it is neither; `where` says whose it is.
    """
    word = text.strip()
    if "\n" in word or ": " in word or word.startswith("{"):
        return parse_yaml(text.encode(), where)  # as it is: all its lines may be indented
    path = Path(word)
    if path.is_absolute() and len(word) <= MAX_PATH and path.suffix in SUFFIXES and _is_file(path):
        say(f"{where} is the path {shown(word, MAX_PATH)}, of a file that is here too")
        return read_yaml(path)
    raise ConfigError(
        f"{where} is a path, {shown(word, MAX_PATH)!r}, of a file on that node's machine; copy the file to "
        "this one, and give it as it is: --set pui.map=FILE"
    )


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # in a folder that is not ours
        return False


def _nothing(wish: FetchRequest, names: Sequence[str]) -> str:
    """Return that there is no map, and what to do."""
    if wish.prefix:
        what = f"no parameter of {wish.node} begins with '{wish.prefix.rstrip('.')}.'"
    else:
        what = f"nothing in the parameters of {wish.node} is a map"
    below = prefixes(names)
    if below:
        advice = f"try --prefix {shown(below[0], MAX_PATH)}"
    else:
        advice = (
            "--parameter names the one that holds a map, --prefix what stands before leds., strips., belts."
        )
    return f"{what}; {_there(names)}; {advice}"


def _there(names: Sequence[str]) -> str:
    return f"it has {listed(names, MAX_SHOWN) or 'none'}"


def _kind(value: Value | None) -> str:
    if value is None or value == "":
        return "empty"
    kinds: Mapping[type, str] = {bool: "true or false", int: "a number", float: "a number", list: "a list"}
    return kinds.get(type(value), "blank")
