"""`pointit map fetch`: the map in the parameters of a ROS 2 node."""

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from pointit.bridges.ros2.config import TOPIC, BackendConfig
from pointit.cli.common.lazy import UnknownNameError
from pointit.cli.common.output import INTERRUPTED, print_file
from pointit.cli.common.panels import Finite, PanelCommand
from pointit.cli.common.site_link import notify_if_slow as notify_if_slow_site
from pointit.cli.common.site_link import quiet
from pointit.cli.maps.map_file import WEB_ADDRESS_REMEDY, print_findings
from pointit.maps.checks.check import examined
from pointit.maps.file import parse_map_file
from pointit.runtime.config.config import Layers
from pointit.runtime.config.parameters import ParameterInfo, iter_parameters
from pointit.runtime.config.yaml_edit import dump_yaml
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import has_extra, remedy
from pointit.runtime.host.state_file import replaced_file
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
    parameters = iter_parameters(BackendConfig, ("backend",))
    return [parameter for parameter in parameters if parameter.path[-1] != "node"]


def _parameter(parameter: ParameterInfo) -> str:
    return "__".join(parameter.path)


def _options() -> list[click.Parameter]:
    options: list[click.Parameter] = []
    for parameter in _leaves():
        default = MODE if parameter.path[-1] == "mode" else parameter.default
        option = click.Option(
            [_parameter(parameter), parameter.option],
            metavar=f"<{parameter.type_name}>",
            help=f"{parameter.field.description}  [default: {default}]",
        )
        options.append(option)
    return options


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
    if "://" in node:
        raise UnknownNameError(f"NODE {node!r}: not a ROS node; {WEB_ADDRESS_REMEDY}")
    if not TOPIC.match(name):
        raise UnknownNameError(
            f"NODE {node!r}: not a full node name; write one like /pui_node or /site1/pui_node"
        )
    if parameter is not None and prefix is not None:
        raise UnknownNameError(
            "--parameter and --prefix: the map is in one parameter or in many; give one of them"
        )

    # Options are checked before the extra is asked for
    config = _config(backend)
    if not has_extra("ros2"):
        raise ConfigError(f"map fetch needs {remedy('ros2')}")
    from pointit.bridges.ros2.map_parameters import FetchRequest, fetched  # noqa: PLC0415

    quiet()
    request = FetchRequest(
        node=name, parameter=parameter, usual=PARAMETER, prefix=prefix, timeout_s=timeout_s
    )
    results: list[Mapping[str, Any]] = []

    async def fetch() -> int:
        results.append(await fetched(config, request, say=_print_progress, notice=notify_if_slow_site))
        return 0

    # The error at the end is enough: the bridge would warn of each attempt
    bridge = logging.getLogger("pointit.bridges.ros2")
    bridge.setLevel(logging.ERROR)
    try:
        run_until_shutdown(fetch())
    finally:
        bridge.setLevel(logging.NOTSET)
    if not results:
        return INTERRUPTED
    _write_fetched(name, results[0], output)
    return 0


def _print_progress(sentence: str) -> None:
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
    has_errors = any(finding.severity == "error" for finding in findings)
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
