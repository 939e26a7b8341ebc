"""Names for authors of commands: what the commands of PointIt print, ask and refuse with.

A package adds a command by an entry point of the group `pointit.commands`: see the page "Write a plug-in".
A command joins a site by `pointit.open` or `pointit.connect`.
"""

from pointit.cli.address_option import host_port
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
