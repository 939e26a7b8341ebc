"""Objects that installed packages declare as entry points, found without importing any."""

import sys
from functools import cached_property, lru_cache
from importlib.metadata import Distribution, EntryPoint, EntryPoints, entry_points
from pathlib import Path
from typing import Any, Generic, TypeVar

from pointit.runtime.errors import ConfigError

P = TypeVar("P")

OURS = ("pointit", "pointit-lab")
"""This project's packages. Other packages cannot use their names."""
_SETUP = Path(__file__).parents[3] / "scripts" / "setup"
"""Program of a checkout that installs it."""


def installed_entry_points(group: str) -> EntryPoints:
    """Return the entry points of `group` of all installed packages."""
    entries: EntryPoints = _all_entry_points(_folders()).select(group=group)
    return entries


def _folders() -> tuple[tuple[str, int], ...]:
    return tuple((folder, _changed_ns(folder)) for folder in sys.path)


@lru_cache(maxsize=1)  # reads a file of each package
def _all_entry_points(_folders: tuple[tuple[str, int], ...]) -> Any:  # not EntryPoints before Python 3.12
    return entry_points()


def _changed_ns(folder: str) -> int:
    try:
        return Path(folder).stat().st_mtime_ns
    except OSError:
        return 0


class InstalledGroup(Generic[P]):
    """The installed objects of one kind, by name."""

    def __init__(self, group: str, kind: type[P], noun: str, *, has_ours: bool = True) -> None:
        """Look for entry points of `group`, each a `kind`. Errors call one a `noun`.

        `has_ours`: this project has some, so that none at all is a fault of the installation.
        """
        self._has_ours = has_ours
        self.group = group
        self.kind = group.rpartition(".")[2]
        """Last part of the group's name, such as `imu_sources`."""
        self.noun = noun
        self._type = kind

    @cached_property
    def _entries(self) -> dict[str, tuple[EntryPoint, ...]]:
        return self.find()

    def find(self) -> dict[str, tuple[EntryPoint, ...]]:
        """Return the entry points of all installed packages, by name: several if packages share it.

        A name that this project uses is its own.

        Raises:
            ConfigError: If there is none where there must be.
        """
        by_name: dict[str, tuple[EntryPoint, ...]] = {}
        entries = installed_entry_points(self.group)

        def own_first(entry: EntryPoint) -> tuple[str, bool, str]:
            package = _package(entry)
            return entry.name, package not in OURS, package

        for entry in sorted(entries, key=own_first):
            others = by_name.get(entry.name, ())
            if others and _package(others[0]) in OURS:
                continue
            # the same object listed twice is no conflict
            if entry.value not in [other.value for other in others]:
                by_name[entry.name] = (*others, entry)
        if not by_name and self._has_ours:
            raise ConfigError(
                f"no {self.noun} is installed, not even those of pointit: install it again (in a checkout: "
                "scripts/setup)"
            )
        return by_name

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of all installed ones, without importing any."""
        return tuple(self._entries)

    def get(self, name: str) -> P:
        """Import and return the object `name`.

        Raises:
            ConfigError: If none is installed under that name, or several, or it cannot be imported.
        """
        entry, *others = self._entries.get(name, (None,))
        if entry is None:
            names = ", ".join(self.names) or "none"
            raise ConfigError(
                f"no {self.noun} {name!r} is installed; there are {names}; {self._remedy(name)}"
            )
        if others:
            packages = f"{_package(entry)} or {_package(others[0])}"
            raise ConfigError(f"{self.noun} {name!r} is in two packages: uninstall {packages}")

        # Code of others, which may raise anything when it is imported
        try:
            loaded = entry.load()
        except (Exception, SystemExit) as error:
            package = _package(entry)
            extras = ",".join(entry.extras)
            remedy = f"update or uninstall {package}"
            if extras:
                remedy = f"install {package}[{extras}]"
            reason = f"{type(error).__name__}: {error}"
            raise ConfigError(f"{self.label(name)} cannot be imported ({reason}); {remedy}") from error
        if not isinstance(loaded, self._type):
            kind = self._type.__name__
            raise ConfigError(f"{self.noun} {name!r}: {entry.value} is no {kind}")
        return loaded

    def check_name(self, name: str, *others: str) -> None:
        """Check that `name` is installed, or one of `others`.

        Raises:
            ValueError: If it is not. The message names those that are, and the package that has `name`.
        """
        names = (*others, *self.names)
        if name not in names:
            raise ValueError(f"use one of {', '.join(names)}; {self._remedy(name)}")

    def _remedy(self, name: str) -> str:
        for entry in _all_entry_points(_folders()).select(name=name):
            if entry.group.startswith("pointit.") and not entry.group.endswith(".fake_devices"):
                return f"{name!r} of {_package(entry)} is of another kind, {entry.group}"
        place = ", or is in pyproject.toml: then run scripts/setup" if _SETUP.is_file() else ""
        return f"another one comes from a package with an entry point {name!r} of {self.group}{place}"

    def label(self, name: str) -> str:
        """Return the name of an object in messages, with its package, without importing it."""
        return f"{self.noun} {name!r} of {self.package(name)}"

    def module(self, name: str) -> str:
        """Return the module of the object `name`, without importing it."""
        return self._entries[name][0].module

    def attribute(self, name: str) -> str:
        """Return the name of the object `name` in its module, without importing it."""
        return self._entries[name][0].attr

    def package(self, name: str) -> str:
        """Return the package that brings the object `name`, without importing it."""
        return _package(self._entries[name][0])

    def foreign_summary(self, name: str) -> str | None:
        """Return the line that describes the package of the object `name`, or None if it is one of ours."""
        dist = self._entries[name][0].dist
        if dist is None or _name(dist) in OURS:
            return None
        return dist.metadata["Summary"] or ""


def _package(entry: EntryPoint) -> str:
    return _name(entry.dist) if entry.dist else entry.value


@lru_cache(maxsize=1)  # reads the description of the package
def _name(dist: Distribution) -> str:
    return dist.name
