"""Names for authors of commands: what the commands of PointIt print, ask and refuse with.

A package adds a command by an entry point of the group `pointit.commands`: see the page "Write a plug-in".
A command joins a site by `pointit.open` or `pointit.connect`.
"""

import click

from pointit.cli.common.lazy import UnknownNameError
from pointit.cli.common.output import (
    OutputSection,
    ProgressCallback,
    console,
    interruptible,
    json_option,
    print_json,
    print_table,
    progress,
    say,
    show,
)
from pointit.cli.common.panels import Finite
from pointit.runtime.address_config import parse_address
from pointit.runtime.config.nearest_name import nearest
from pointit.runtime.errors import ConfigError, PointItError, RefusedError
from pointit.runtime.host.extras import pointit_version, remedy
from pointit.runtime.host.state_file import replaced_file
from pointit.runtime.service.process import EXIT_FAILED, run_until_shutdown

__all__ = [
    "EXIT_FAILED",
    "ConfigError",
    "Finite",
    "OutputSection",
    "PointItError",
    "ProgressCallback",
    "RefusedError",
    "UnknownNameError",
    "console",
    "host_port",
    "interruptible",
    "json_option",
    "nearest",
    "pointit_version",
    "print_json",
    "print_table",
    "progress",
    "remedy",
    "replaced_file",
    "run_until_shutdown",
    "say",
    "show",
]


def host_port(_ctx: click.Context, _parameter: click.Parameter, text: str | None) -> tuple[str, int] | None:
    """Return host and port of `text`, an IPv6 address in brackets, or None without a text.

    Raises:
        click.BadParameter: If it is anything else.
    """
    if text is None:
        return None
    try:
        host, port = parse_address(text)
    except ValueError as error:
        raise click.BadParameter(str(error)) from error
    if port is None:
        raise click.BadParameter(f"{text!r} has no port; write an address such as 127.0.0.1:9464")
    return host, port
