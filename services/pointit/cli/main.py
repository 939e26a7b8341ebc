"""`pointit`: collects the commands; each is imported when it is called."""

from typing import NoReturn

import click

from pointit.cli.lazy import Entry, LazyGroup, from_module

COMMANDS = (
    ("run", "start a scenario: its services, simulated people, a live view", "pointit.cli.run:run"),
    ("user", "add one person's services to a running site", "pointit.cli.run:user"),
    ("service", "run one service; its --help documents every parameter", "pointit.cli.service:command"),
    ("list", "list what there is to run", "pointit.cli.list:command"),
    ("topics", "show the topic table: what travels, how often, who writes it", "pointit.cli.topics:command"),
    ("echo", "print messages as they come", "pointit.cli.echo:command"),
    ("press", "press a person's button from here", "pointit.cli.press:command"),
    ("calibrate", "measure how a sensor is worn, and how a person points", "pointit.cli.calibrate:command"),
    ("anchor", "point at one lamp, to set a person's pose right", "pointit.cli.anchor:command"),
    ("pose", "show where a person stands and how sure that is, or say it", "pointit.cli.pose:command"),
    ("call", "ask a service for something; alone, list what can be asked", "pointit.cli.call:command"),
    ("hz", "measure rates against the nominal ones", "pointit.cli.hz:command"),
    ("doctor", "say what runs, what is stale, what is wrong and what to do", "pointit.cli.doctor:command"),
    (
        "evaluate",
        "measure on recordings of people how good the estimates are",
        "pointit.cli.evaluate:command",
    ),
    ("schema", "write or check the catalogue of messages", "pointit.cli.schema:command"),
    ("router", "run a router that joins several machines", "pointit.cli.router:command"),
)
"""Name, one line, and where the command is: `module:attribute`."""

EXAMPLES = (
    ("pointit run", "a simulated person selects moving segments, in this terminal"),
    ("pointit hz --all", "what travels and how often, from another terminal"),
    ("pointit doctor", "is everything well, and if not, what to do"),
)


class Front(LazyGroup):
    """The front page: commands, three examples, where to begin."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the examples."""
        del ctx
        with formatter.section("Examples"):
            formatter.write_dl(list(EXAMPLES))
        formatter.write_paragraph()
        formatter.write_text("More on a command: pointit COMMAND --help")


def front() -> click.Group:
    """Return the group of all commands."""

    @click.pass_context
    def callback(ctx: click.Context) -> None:
        if ctx.invoked_subcommand is None:
            click.echo(ctx.get_help())

    group = Front(
        name="pointit",
        entries=[Entry(name=name, about=about, load=from_module(where)) for name, about, where in COMMANDS],
        callback=callback,
        invoke_without_command=True,
        context_settings={"help_option_names": ["-h", "--help"]},
        help=(
            "Point at things and the things react.\n\n"
            "Begin with `pointit run`: it needs no hardware, no router and no configuration. "
            "Ctrl-C ends every command at once."
        ),
    )
    version = click.version_option(
        package_name="pointit", prog_name="pointit", message="%(prog)s %(version)s"
    )
    return version(group)


command = front()


def main() -> NoReturn:
    """Run the command line; what `pointit` and `python -m pointit.cli` call."""
    from pointit.runtime.process import run_command  # noqa: PLC0415 - the table above is wanted without it

    run_command(command)
