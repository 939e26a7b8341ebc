"""`pointit`: the table of commands; each is imported when it is called."""

import shutil
import sys
import textwrap
from typing import Any, NoReturn

import click

from pointit.cli.common.lazy import Entry, LazyGroup, from_module

COMMANDS = (
    ("run", "start a scenario: its services, simulated people, a live view", "pointit.cli.run.run:run"),
    ("user", "add one person's services to a running site", "pointit.cli.run.user:command"),
    (
        "dashboard",
        "open the page of a site that runs elsewhere, in the browser",
        "pointit.cli.run.dashboard:command",
    ),
    ("service", "run one service; its --help documents every parameter", "pointit.cli.run.service:command"),
    ("list", "list scenarios, maps and services", "pointit.cli.run.list:command"),
    (
        "topics",
        "show the topic table: keys, messages, rates, writers",
        "pointit.cli.inspect.topics:command",
    ),
    ("echo", "print messages as they arrive", "pointit.cli.inspect.echo:command"),
    ("press", "press a person's button from here", "pointit.cli.people.press:command"),
    (
        "map",
        "check a map, draw it, fetch it from ROS 2, list the shipped ones",
        "pointit.cli.maps.map:command",
    ),
    (
        "calibrate",
        "measure a sensor's mounting, or a person's pointing offset",
        "pointit.cli.people.calibrate:command",
    ),
    ("anchor", "point at one lamp to correct a person's pose", "pointit.cli.people.anchor:command"),
    ("pose", "show or set a person's pose", "pointit.cli.people.pose:command"),
    (
        "call",
        "send a request to a service; without arguments, list requests",
        "pointit.cli.inspect.call:command",
    ),
    ("hz", "measure rates against the nominal ones", "pointit.cli.inspect.hz:command"),
    (
        "doctor",
        "show what runs, what is stale, what is wrong and what to do",
        "pointit.cli.inspect.doctor:command",
    ),
    (
        "evaluate",
        "measure the accuracy of the estimates on recordings of people",
        "pointit.cli.evaluate.command:command",
    ),
    (
        "load",
        "measure the number of people this machine, or a site, carries",
        "pointit.cli.loadtest.command:command",
    ),
    ("audit", "show who selected what, when and how confidently", "pointit.cli.inspect.audit:command"),
    ("schema", "write or check the catalogue of messages", "pointit.cli.inspect.schema:command"),
    ("router", "run a router that joins several machines", "pointit.cli.site.router:command"),
    ("site", "manage who may join a site, and their rights", "pointit.cli.site.site:command"),
)
"""Name, one line, and location of the command: `module:attribute`."""

EXAMPLES = (
    ("pointit run", "a person in a room with a conveyor, in your browser; then point yourself"),
    ("pointit hz --all", "all messages and their rates, from another terminal"),
    ("pointit doctor", "problems of a site, and what to do"),
)


ERROR = "Error: "
"""Prefix of error messages."""


class RootGroup(LazyGroup):
    """The top-level help: commands, three examples, first steps."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; error messages are wrapped to the terminal's width, if there is one."""
        try:
            return super().invoke(ctx)
        except click.ClickException as error:
            text = wrap_message(error.format_message())
            vars(error)["format_message"] = lambda: text
            raise
        except Exception as error:
            from pointit.runtime.errors import PointItError  # noqa: PLC0415 - most commands have it loaded
            from pointit.schemas import SchemaError  # noqa: PLC0415 - as above

            if isinstance(error, PointItError | SchemaError):
                error.args = (wrap_message(str(error)),)
            raise

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the examples."""
        del ctx
        with formatter.section("Examples"):
            formatter.write_dl(list(EXAMPLES))
        formatter.write_paragraph()
        formatter.write_text("More on a command: pointit COMMAND --help")


def wrap_message(text: str, width: int | None = None) -> str:
    """Return `text` wrapped to fit behind and below `Error: `, without breaking words; unchanged in a pipe.

    Args:
        text: one sentence.
        width: of the terminal. None: that of standard error, if it is a terminal.
    """
    if width is None:
        if not sys.stderr.isatty():
            return text
        width = shutil.get_terminal_size().columns
    lines = textwrap.wrap(text, width, initial_indent=ERROR, break_long_words=False, break_on_hyphens=False)
    return "\n".join(lines).removeprefix(ERROR)


def front() -> click.Group:
    """Return the group of all commands."""

    @click.pass_context
    def callback(ctx: click.Context) -> None:
        if ctx.invoked_subcommand is None:
            click.echo(ctx.get_help())

    group = RootGroup(
        name="pointit",
        entries=[Entry(name=name, about=about, load=from_module(where)) for name, about, where in COMMANDS],
        callback=callback,
        invoke_without_command=True,
        context_settings={"help_option_names": ["-h", "--help"]},
        help=(
            "Point at things and the things react.\n\n"
            "Start with `pointit run`: it needs no hardware, no router and no configuration. "
            "Ctrl-C ends every command at once."
        ),
    )
    version = click.version_option(
        package_name="pointit", prog_name="pointit", message="%(prog)s %(version)s"
    )
    return version(group)


command = front()


def main() -> NoReturn:
    """Run the command line; entry point of `pointit` and `python -m pointit.cli`."""
    from pointit.runtime.service.process import run_program  # noqa: PLC0415 - the table above is wanted without it

    run_program(command)
