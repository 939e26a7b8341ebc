"""Groups of commands that import a command when it is called, and suggest names for a typo."""

import difflib
import importlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import click


class UnknownNameError(click.ClickException):
    """The operator typed something that does not exist: one sentence, exit code 2."""

    exit_code = 2


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A command that is not loaded yet."""

    name: str
    about: str
    """One line, shown without loading the command."""
    load: Callable[[], click.Command]


class LazyGroup(click.Group):
    """A group with a name and a line for each command, which imports only the one that is called."""

    def __init__(self, *, entries: Sequence[Entry], kind: str = "command", **attributes: Any) -> None:
        """Create a group of `entries`, each called a `kind` in messages and headings."""
        super().__init__(**attributes)
        self._entries = {entry.name: entry for entry in entries}
        self._kind = kind

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order of the table."""
        del ctx
        return list(self._entries)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Load and return the command, or None if there is no such name."""
        del ctx
        entry = self._entries.get(cmd_name) or self._entries.get(cmd_name.replace("_", "-"))
        return None if entry is None else entry.load()

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command named first in `args`.

        Raises:
            UnknownNameError: If there is none; suggests similar names.
        """
        command = self.get_command(ctx, args[0])
        if command is not None:
            return command.name, command, args[1:]
        if ctx.resilient_parsing:  # completion in a shell
            return None, None, args[1:]
        raise UnknownNameError(f"no {self._kind} {args[0]!r}; {nearest(args[0], self._entries)}")

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write one line a command, without loading any."""
        del ctx
        with formatter.section(f"{self._kind.capitalize()}s"):
            formatter.write_dl([(entry.name, entry.about) for entry in self._entries.values()])


def from_module(target: str) -> Callable[[], click.Command]:
    """Return a loader of the command at `target`, `module:attribute`."""

    def load() -> click.Command:
        module, _, attribute = target.partition(":")
        command: click.Command = getattr(importlib.import_module(module), attribute)
        return command

    return load


def nearest(name: str, names: Iterable[str]) -> str:
    """Return `did you mean a or b?`, or `there are a, b, c` if no name is similar."""
    known = list(names)
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.6)
    if near:
        return f"did you mean {' or '.join(near)}?"
    return f"there are {', '.join(known)}"
