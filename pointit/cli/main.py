"""`pointit`: the group of all commands, and errors as wide as the terminal."""

import difflib
import functools
import gc
import os
import shutil
import sys
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

import click

from pointit.cli.commands import COMMANDS
from pointit.cli.common.lazy import (
    COMPLETE,
    LABORATORY,
    DeclaredCommand,
    Installed,
    LazyEntry,
    LazyGroup,
    print_help_without_action,
    walk,
)
from pointit.runtime.host.text_output import assume_dumb_terminal, escape_unencodable

EXAMPLES = (
    ("pointit run", "a person in a room with a conveyor, in your browser; then point yourself"),
    ("pointit topic hz --all", "all messages and their rates, from another terminal"),
    ("pointit doctor", "problems of a site, and their remedies"),
)


ERROR = "Error: "
"""Prefix of error messages."""

PATHS = [path for path, _ in walk(entry for part in COMMANDS.values() for entry in part if not entry.package)]
"""Words of every command and group of this package, a group before its commands."""

GROUPS = {path[:-1] for path in PATHS}
"""Words of the groups, () among them."""


class RootGroup(LazyGroup):
    """The top-level help: commands by heading, three examples, first steps."""

    @functools.cached_property
    def _installed(self) -> Installed:
        return Installed(super().parts)

    @property
    def refused(self) -> Mapping[DeclaredCommand, str]:
        """Return a sentence for each command of other packages that is not added."""
        return self._installed.refused

    @property
    def parts(self) -> Mapping[str, Sequence[LazyEntry]]:
        """Return the commands of this and of other installed packages, by heading."""
        return self._installed.parts

    def entry(self, name: str) -> LazyEntry | None:
        """Return the command of that name, or None; looks at other packages for those that are not ours."""
        entry = super().entry(name)
        if entry is not None:
            return entry
        for installed in self.entries:
            if installed.name == name:
                return installed
        return None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command named first in `args`.

        Raises:
            UnknownNameError: If there is none; suggests similar names.
        """
        try:
            return super().resolve_command(ctx, args)
        finally:
            if not gc.isenabled():  # see `pointit.__main__`
                gc.freeze()
                gc.enable()

    def advice(self, typed: str) -> str:
        """Return a clause with the similar names, those of actions among them: `map plot` for `plott`."""
        words = {entry.name: entry.name for entry in self.entries}
        words |= {path[-1]: " ".join(path) for path in reversed(PATHS)}
        near = difflib.get_close_matches(typed, words, n=3, cutoff=0.6)
        if not near:
            return super().advice(typed)
        suggestions = [words[word] for word in near]
        return f"did you mean {' or '.join(suggestions)}?"

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; error messages are wrapped to the terminal's width, if there is one."""
        try:
            return super().invoke(ctx)
        except (click.exceptions.Exit, click.exceptions.Abort):  # help, or Ctrl-C
            raise
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

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write a line for each command that is not the laboratory's."""
        shown = dict(self.parts)
        shown.pop(LABORATORY, None)
        LazyGroup(entries=shown).format_commands(ctx, formatter)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the examples, the laboratory's commands, and which of other packages are not there."""
        del ctx
        with formatter.section("Examples"):
            formatter.write_dl(list(EXAMPLES))
        formatter.write_paragraph()
        formatter.write_text("More on a command: pointit COMMAND --help")
        entries = self.parts.get(LABORATORY, ())
        laboratory = [f"pointit {entry.name}" for entry in entries]
        if laboratory:
            formatter.write_text(f"To measure, from the laboratory: {', '.join(laboratory)}")
        for sentence in self._installed.refused.values():
            formatter.write_paragraph()
            formatter.write_text(sentence)


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
    group = RootGroup(
        name="pointit",
        entries=COMMANDS,
        callback=print_help_without_action,
        invoke_without_command=True,
        context_settings={"help_option_names": ["-h", "--help", "--help-all"], "show_default": True},
        help=(
            "Point at things and the things react.\n\n"
            "Start with `pointit run`, or just `pointit`. It needs no hardware or configuration. "
            "Ctrl-C ends every command at once."
        ),
    )
    version = click.version_option(
        package_name="pointit", prog_name="pointit", message="%(prog)s %(version)s"
    )
    return version(group)


command = front()


def main() -> NoReturn:
    """Run the command line; entry point of `pointit` and `python -m pointit`."""
    escape_unencodable()
    assume_dumb_terminal()
    if len(sys.argv) == 1 and COMPLETE not in os.environ:
        click.echo("`pointit` alone is `pointit run`; `pointit --help` shows all commands", err=True)
        sys.argv.append("run")
    # Help and completion need no services, so they do without the modules of a process
    words = tuple(word for word in sys.argv[1:] if word not in ("-h", "--help", "--version"))
    if COMPLETE in os.environ or words in GROUPS:
        command.main(prog_name="pointit", complete_var=COMPLETE)
    from pointit.runtime.service.process import run_program  # noqa: PLC0415 - takes longer than help and completion

    run_program(command)
