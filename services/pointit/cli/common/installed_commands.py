"""Commands that other packages add by entry points `pointit.commands`, each a click command.

They are listed from the packages' files, since `importlib.metadata` takes as long as the rest of the help,
and `pathlib` a twentieth of it. They are imported when they are called.
"""

import contextlib
import os
import re
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import click

from pointit.cli.common.lazy import LazyEntry

GROUP = "pointit.commands"
LAB = "pointit-lab"
"""Distribution of the laboratory, `lab/`, which has commands of the table."""
LABORATORY = "Laboratory"
"""Heading of its commands, which the help names in one line."""
HEADING = "Of other packages"


class DeclaredCommand(NamedTuple):
    """An entry point of an installed package, and the line that describes the package."""

    name: str
    package: str
    summary: str


class Installed:
    """Commands that are installed: those of the table that are there, and those that other packages add."""

    def __init__(self, table: Mapping[str, Sequence[LazyEntry]], taken: Collection[str]) -> None:
        """Look for packages with commands. None may have a name of `table` or of `taken`."""
        found = list(declared())
        pairs = {(each.name, each.package) for each in found}
        ours = {entry.name: entry.package for part in table.values() for entry in part}
        added: dict[str, LazyEntry] = {}
        self.refused: dict[DeclaredCommand, str] = {}
        """A sentence for each command that is not added."""
        for each in found:
            if ours.get(each.name) == each.package:
                continue
            if each.name in ours or each.name in taken:
                self.refused[each] = (
                    f"{each.package} adds no command {each.name!r}, which is a name of PointIt's own: "
                    "rename its entry point."
                )
            else:
                added[each.name] = of_package(each.package, each.name, f"{each.summary} ({each.package})")
        shown = {
            heading: [entry for entry in part if not entry.package or (entry.name, entry.package) in pairs]
            for heading, part in table.items()
        }
        self.parts = {heading: part for heading, part in shown.items() if part}
        if added:
            self.parts[HEADING] = list(added.values())


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
    if package == LAB and (name not in group.names or group.package(name) != LAB):
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
                text = _content(f"{folder or '.'}/{name}/entry_points.txt")
                section = "\n".join(["", text.partition(f"[{GROUP}]\n")[2]]).partition("\n[")[0]
                distribution = name.partition("-")[0].lower()
                if not section or distribution in seen:
                    continue
                seen.add(distribution)
                head = _content(f"{folder or '.'}/{name}/METADATA").partition("\n\n")[0]
                package, summary = _field("Name", head), _field("Summary", head)
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
    found = re.search(rf"^{name}: *(.*)$", head, re.MULTILINE)
    return found[1] if found else ""
