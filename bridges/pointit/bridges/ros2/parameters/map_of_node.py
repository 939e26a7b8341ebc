"""Fetching the map of a ROS node from its parameters, in any of the supported forms."""

import contextlib
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backends import check_endpoint, opened
from pointit.bridges.ros2.message_format import listed, shown
from pointit.bridges.ros2.over_zenoh.backend import NEEDS
from pointit.bridges.ros2.parameters.map_parameters import of_maps, prefixes, tree_of
from pointit.bridges.ros2.parameters.node_parameters import GET, LIST, MAX_SHOWN, NodeParameters
from pointit.bridges.ros2.parameters.values import Value
from pointit.bridges.ros2.types.types import Types
from pointit.runtime.config.yaml_file import parse_yaml, read_yaml
from pointit.runtime.errors import ConfigError, ConnectError

log = logging.getLogger(__name__)

APPEARS_S = 2.0
"""Time (s) within which a present node is seen through a router. Discovery is slow on DDS."""
PATIENCE_S = 2.0
"""Time (s) to look for a ROS router."""
MAX_PATH = 1000
"""Maximum characters of a path to look for here, and of a foreign word in a message."""
SUFFIXES = (".yaml", ".yml")
"""Extensions of files that are read because a foreign node names them: others are no maps, and some never
end."""


Say = Callable[[str], None]
"""Prints a message for the user."""

Telling = Callable[[str], contextlib.AbstractContextManager[None]]
"""Wraps a wait that the message describes, to print it if the wait gets long."""


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


class _IgnoredWarnings:
    """Ignores warnings: those of so short a connection are in the error."""

    def warn(self, topic: str, sentence: str) -> None:
        log.debug("%s: %s", topic, sentence)

    def clear(self, topic: str) -> None:
        log.debug("%s: well", topic)


async def fetched(
    config: BackendConfig,
    request: FetchRequest,
    *,
    say: Say = log.info,
    telling: Telling = lambda _: contextlib.nullcontext(),
) -> dict[str, Any]:
    """Return the map as in its file, unchecked.

    Args:
        config: how to join the ROS graph.
        request: which map of which node.
        say: prints which file was read instead of the node.
        telling: wraps each wait, with a description.

    Raises:
        ConfigError: If nothing there is a map, or it cannot be read.
        ConnectError, ListenError: If the ROS graph cannot be joined.
        NoAnswerError: If there is no such node, or it does not answer.
    """
    check_endpoint(config.endpoint)
    types = Types(config.distro)
    types.prepare(LIST, GET)
    try:
        with telling(f"looking for a ROS router at {config.endpoint} …"):
            backend = await opened(config, _IgnoredWarnings(), patience_s=PATIENCE_S)
    except ConnectError as error:
        raise ConnectError(f"{error}; --backend.endpoint says where it is") from error
    try:
        parameters = NodeParameters(
            backend,
            types,
            request.node,
            domain=config.domain_id,
            appears_s=request.timeout_s if config.kind == "dds" else min(APPEARS_S, request.timeout_s),
            timeout_s=request.timeout_s,
            max_bytes=config.max_message_bytes,
            needs=NEEDS if config.kind == "rmw_zenoh" else "",
        )
        with telling(f"asking {request.node} for its parameters …"):
            return await _taken(parameters, request, say)
    finally:
        await backend.close()


async def _taken(parameters: NodeParameters, request: FetchRequest, say: Say) -> dict[str, Any]:
    names = await parameters.names()
    holder = request.usual if request.parameter is None else request.parameter
    if request.parameter is not None and holder not in names:
        raise ConfigError(f"node {request.node} has no parameter {holder!r}; {_there(names)}")
    if request.prefix is None and holder in names:
        held = (await parameters.values([holder])).get(holder)
        if isinstance(held, str) and held.strip():
            return _of_text(held, f"parameter {holder} of {request.node}", say)
        if request.parameter is not None:
            raise ConfigError(
                f"parameter {holder} of {request.node} is {_kind(held)}, not the text of a map or its path; "
                "--parameter names another"
            )
    prefix = (request.prefix or "").rstrip(".")
    values = await parameters.values(of_maps(names, prefix))
    if not values:
        raise ConfigError(_nothing(request, names))
    try:
        return tree_of(values, prefix)
    except ValueError as error:
        raise ConfigError(f"node {request.node}: {error}") from error


def _of_text(text: str, where: str, say: Say) -> dict[str, Any]:
    """Return the map in `text`, or in the YAML file of this machine that it names.

    Raises:
        ConfigError: If it is neither; `where` names the origin in messages.
    """
    word = text.strip()
    if "\n" in word or ": " in word or word.startswith("{"):
        return parse_yaml(text.encode(), where)  # unstripped: all its lines may be indented
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
    except OSError:  # in a folder without permission
        return False


def _nothing(request: FetchRequest, names: Sequence[str]) -> str:
    if request.prefix:
        what = f"no parameter of {request.node} begins with '{request.prefix.rstrip('.')}.'"
    else:
        what = f"nothing in the parameters of {request.node} is a map"
    below = prefixes(names)
    if below:
        advice = f"try --prefix {shown(below[0], MAX_PATH)}"
    else:
        advice = (
            "--parameter names the one that holds a map, --prefix what stands before lamps., strips., belts."
        )
    return f"{what}; {_there(names)}; {advice}"


def _there(names: Sequence[str]) -> str:
    return f"it has {listed(names, MAX_SHOWN) or 'none'}"


def _kind(value: Value | None) -> str:
    if value is None or value == "":
        return "empty"
    kinds: Mapping[type, str] = {bool: "true or false", int: "a number", float: "a number", list: "a list"}
    return kinds.get(type(value), "blank")
