"""Groups of commands, ours and of installed packages, that import one when it is called.

They are listed from the packages' files, since `importlib.metadata` takes as long as the rest of the help,
and `pathlib` a twentieth of it. They are imported when they are called.
"""

import contextlib
import os
import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from pointit.runtime.config.nearest_name import nearest

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem


COMPLETE = "_POINTIT_COMPLETE"
"""Variable by which a shell asks for completion."""

GROUP = "pointit.commands"
LAB = "pointit-lab"
"""Distribution of the laboratory, `lab/`, which has commands of the table."""
LABORATORY = "Laboratory"
"""Heading of its commands, which the help names in one line."""
HEADING = "Of other packages"


class UnknownNameError(click.ClickException):
    """The operator typed something that does not exist: one sentence, exit code 2."""

    exit_code = 2


@dataclass(frozen=True, kw_only=True)
class LazyEntry:
    """A command that is not loaded yet."""

    name: str
    about: str
    """One line, shown without loading the command."""
    load: Callable[[], click.Command]
    actions: tuple["LazyEntry", ...] = ()
    """The commands of a noun. Empty for a command, or a group whose names are known once it is loaded."""
    package: str = ""
    """Distribution that brings it, which may not be installed, or `""` for this one."""


class LazyGroup(click.Group):
    """A group with a name and a line for each command, which imports only the one that is called."""

    def __init__(
        self,
        *,
        entries: Sequence[LazyEntry] | Mapping[str, Sequence[LazyEntry]],
        kind: str = "command",
        **attributes: Any,
    ) -> None:
        """Create a group of `entries`, each called a `kind` in messages.

        A mapping has the headings of its parts in the help; the heading of a sequence is the `kind`.
        """
        super().__init__(**attributes)
        if not isinstance(entries, Mapping):
            entries = {f"{kind.capitalize()}s": entries}
        self._parts = entries
        self._entries = {entry.name: entry for entry in chain.from_iterable(entries.values())}
        self._kind = kind

    @property
    def parts(self) -> Mapping[str, Sequence[LazyEntry]]:
        """Return the commands that are shown, by heading."""
        return self._parts

    @property
    def entries(self) -> Sequence[LazyEntry]:
        """Return the commands that are shown, in the order of the table."""
        return list(chain.from_iterable(self.parts.values()))

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order of the table."""
        del ctx
        return [entry.name for entry in self.entries]

    def entry(self, name: str) -> LazyEntry | None:
        """Return the command of that name, or None."""
        return self._entries.get(name)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the command, or None if there is no such name, or a completion cannot load it."""
        entry = self.entry(cmd_name) or self.entry(cmd_name.replace("_", "-"))
        if entry is None:
            return None
        if entry.actions or not ctx.resilient_parsing:
            return entry.load()
        from pointit.runtime.errors import ConfigError  # noqa: PLC0415 - takes longer than the help

        with contextlib.suppress(ConfigError):  # reported when it is called
            return entry.load()
        return None

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
        typed = args[0]
        raise UnknownNameError(f"no {self._kind} {typed!r}; {self.advice(typed)}")

    def advice(self, typed: str) -> str:
        """Return a clause with the names that are similar to `typed`, or with all."""
        return nearest(typed, [entry.name for entry in self.entries])

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write one line a command, without loading any; the parts are aligned with each other."""
        del ctx
        width = max((len(entry.name) for entry in self.entries), default=0)
        for heading, part in self.parts.items():
            with formatter.section(heading):
                formatter.write_dl([(entry.name.ljust(width), entry.about) for entry in part])

    def shell_complete(self, ctx: click.Context, incomplete: str) -> "list[CompletionItem]":
        """Return the names that begin with `incomplete`, without loading any, and the options."""
        from pointit.cli.common.completions import beginning  # noqa: PLC0415 - only in a completion

        entries = ((entry.name, entry.about) for entry in self.entries)
        names = beginning(entries, incomplete)
        return [*names, *click.Command.shell_complete(self, ctx, incomplete)]


def command(name: str, about: str, target: str) -> LazyEntry:
    """Return the command at `target`, `module:attribute`."""

    def load() -> click.Command:
        from pointit.runtime.host.extras import load_object  # noqa: PLC0415 - not for help

        command: click.Command = load_object(target, "this command")
        return command

    return LazyEntry(name=name, about=about, load=load)


def noun(name: str, about: str, text: str, *entry: LazyEntry) -> LazyEntry:
    """Return a group of actions on a thing, with its help `text`, which it prints if no action is given."""
    return LazyEntry(name=name, about=about, load=partial(group, name, text, entry), actions=entry)


def group(name: str, text: str, entries: tuple[LazyEntry, ...]) -> LazyGroup:
    """Return the group that a noun loads."""
    return LazyGroup(
        name=name,
        entries=entries,
        kind="action",
        help=text,
        callback=print_help_without_action,
        invoke_without_command=True,
        subcommand_metavar="ACTION ...",
    )


@click.pass_context
def print_help_without_action(ctx: click.Context) -> None:
    """Print the help of a group that is called without a command."""
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())


def walk(
    entries: Iterable[LazyEntry], path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], LazyEntry]]:
    """Yield every command below `entries` with the words to type, groups before their commands."""
    for entry in entries:
        words = (*path, entry.name)
        yield words, entry
        yield from walk(entry.actions, words)


class DeclaredCommand(NamedTuple):
    """An entry point of an installed package, and the line that describes the package."""

    name: str
    package: str
    summary: str


class Installed:
    """Commands that are installed: those of the table that are there, and those that other packages add."""

    def __init__(self, table: Mapping[str, Sequence[LazyEntry]]) -> None:
        """Look for packages with commands. None may have a name of `table`."""
        commands = list(declared())
        ours = {entry.name: entry.package for entry in chain.from_iterable(table.values())}
        added: dict[str, LazyEntry] = {}
        self.refused: dict[DeclaredCommand, str] = {}
        """A sentence for each command that is not added."""
        for declaration in commands:
            name = declaration.name
            package = declaration.package
            if ours.get(name) == package:
                continue
            if name in ours:
                self.refused[declaration] = (
                    f"{package} adds no command {name!r}, which is a name of PointIt's own: "
                    "rename its entry point."
                )
            else:
                about = f"{declaration.summary} ({package})"
                added[name] = of_package(package, name, about)

        # Commands of the table that other packages bring are shown only where these are installed
        installed = {(declaration.name, declaration.package) for declaration in commands}
        self.parts: dict[str, list[LazyEntry]] = {}
        for heading, part in table.items():
            shown = [entry for entry in part if _is_present(entry, installed)]
            if shown:
                self.parts[heading] = shown
        if added:
            self.parts[HEADING] = list(added.values())


def _is_present(entry: LazyEntry, installed: Collection[tuple[str, str]]) -> bool:
    return not entry.package or (entry.name, entry.package) in installed


def of_package(package: str, name: str, about: str) -> LazyEntry:
    """Return the command `name` that the distribution `package` adds; `about` is its line in the help."""
    return LazyEntry(name=name, about=about, load=partial(load, package, name), package=package)


def load(package: str, name: str) -> click.Command:
    """Import and return a command of `package`.

    Raises:
        ConfigError: If the package is not installed, or its command cannot be imported.
    """
    from pointit.runtime.config.installed import InstalledGroup  # noqa: PLC0415 - takes as long as the help
    from pointit.runtime.errors import ConfigError  # noqa: PLC0415 - as above
    from pointit.runtime.host.extras import remedy  # noqa: PLC0415 - as above

    group = InstalledGroup(GROUP, click.Command, "command", has_ours=False)
    if package == LAB:
        is_installed = name in group.names and group.package(name) == LAB
        if not is_installed:
            raise ConfigError(
                f"`pointit {name}` is a command of {LAB}, which is not installed; run {remedy('lab')}"
            )
    return group.get(name)


def declared() -> Iterator[DeclaredCommand]:
    """Yield the commands of all installed packages. Of two with one name, the first on the path counts."""
    seen = set[str]()
    for folder in dict.fromkeys(sys.path):
        for name in _packages(folder or "."):
            with contextlib.suppress(OSError, ValueError):  # `load` says more if it is called
                package_folder = f"{folder or '.'}/{name}"

                # The lines of our section of an INI file, up to the next heading
                text = _content(f"{package_folder}/entry_points.txt")
                _, _, after_heading = text.partition(f"[{GROUP}]\n")
                section = f"\n{after_heading}".partition("\n[")[0]
                distribution = name.partition("-")[0].lower()
                if not section or distribution in seen:
                    continue
                seen.add(distribution)

                # Its metadata, of which the description follows an empty line
                head = _content(f"{package_folder}/METADATA").partition("\n\n")[0]
                package = _field("Name", head)
                summary = _field("Summary", head)
                for command in re.findall(r"^([^#=\s][^=]*?)\s*=", section, re.MULTILINE):
                    yield DeclaredCommand(name=command, package=package, summary=summary)


def _packages(folder: str) -> list[str]:
    try:
        return sorted(name for name in os.listdir(folder) if name.endswith(".dist-info"))  # noqa: PTH208 - see above
    except OSError:  # such as an archive
        return []


def _content(path: str) -> str:
    with open(path, encoding="utf-8") as file:  # noqa: PTH123 - see above
        return file.read()


def _field(name: str, head: str) -> str:
    field = re.search(rf"^{name}: *(.*)$", head, re.MULTILINE)
    return field[1] if field else ""
