"""Parts that installed packages add, declared as entry points, found without importing any.

A plug-in is imported when it is used. All of a kind are imported where the parameters of all are listed, such
as in the help of a service.
"""

import sys
from collections.abc import Awaitable, Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from importlib.metadata import Distribution, EntryPoint, EntryPoints, entry_points
from pathlib import Path
from typing import Any, Generic, TypeVar

from pydantic import ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

from pointit.runtime.config.config import Config, validate
from pointit.runtime.config.validation_message import DESCRIBED, first_mistake
from pointit.runtime.errors import ConfigError

OURS = ("pointit", "pointit-lab")
"""This project's packages. Other packages cannot use their names."""
_SETUP = Path(__file__).parents[3] / "scripts" / "setup"
"""Program of a checkout that installs it."""
P = TypeVar("P")


def installed_entry_points(group: str) -> EntryPoints:
    """Return the entry points of `group` of all installed packages."""
    found: EntryPoints = _all_entry_points(_folders()).select(group=group)
    return found


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
        found: dict[str, tuple[EntryPoint, ...]] = {}
        entries = installed_entry_points(self.group)
        for entry in sorted(entries, key=lambda it: (it.name, _package(it) not in OURS, _package(it))):
            others = found.get(entry.name, ())
            is_taken = others and _package(others[0]) in OURS
            if not is_taken and entry.value not in [other.value for other in others]:
                found[entry.name] = (*others, entry)
        if not found and self._has_ours:
            raise ConfigError(
                f"no {self.noun} is installed, not even those of pointit: install it again (in a checkout: "
                "scripts/setup)"
            )
        return found

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
            known = f"{', '.join(self.names) or 'none'}; {self._remedy(name)}"
            raise ConfigError(f"no {self.noun} {name!r} is installed; there are {known}")
        if others:
            raise ConfigError(
                f"{self.noun} {name!r} is in two packages: uninstall {_package(entry)} or "
                f"{_package(others[0])}"
            )
        try:
            loaded = entry.load()
        except (Exception, SystemExit) as error:  # code of others, which may raise anything when imported
            package = _package(entry)
            extras = ",".join(entry.extras)
            remedy = f"install {package}[{extras}]" if extras else f"update or uninstall {package}"
            reason = f"{type(error).__name__}: {error}"
            raise ConfigError(f"{self.label(name)} cannot be imported ({reason}); {remedy}") from error
        if not isinstance(loaded, self._type):
            raise ConfigError(f"{self.noun} {name!r}: {entry.value} is no {self._type.__name__}")
        return loaded

    def check_name(self, name: str, *others: str) -> None:
        """Check that `name` is installed, or one of `others`.

        Raises:
            ValueError: If it is not. The message names those that are, and the package that has `name`.
        """
        if name not in (*others, *self.names):
            raise ValueError(f"use one of {', '.join((*others, *self.names))}; {self._remedy(name)}")

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

    def package(self, name: str) -> str:
        """Return the package that brings the object `name`, without importing it."""
        return _package(self._entries[name][0])

    def foreign_summary(self, name: str) -> str | None:
        """Return the line that describes the package of the object `name`, or None if it is one of ours."""
        dist = self._entries[name][0].dist
        return None if dist is None or _name(dist) in OURS else dist.metadata["Summary"] or ""


def _package(entry: EntryPoint) -> str:
    return _name(entry.dist) if entry.dist else entry.value


@lru_cache(maxsize=1)  # reads the description of the package
def _name(dist: Distribution) -> str:
    return dist.name


@dataclass(frozen=True, kw_only=True)
class Plugin:
    """A part that is chosen by the name of its entry point, such as a source of orientations.

    A package declares it in its `pyproject.toml`, under the group of its kind:

        [project.entry-points."pointit.imu_sources"]
        mine = "my_package:MINE"
    """

    summary: str
    """Description in one line."""
    config: type[Config]
    """Its parameters."""
    argument: str = ""
    """Parameter that `NAME:VALUE` on the command line sets, or `""` if the name stands alone."""
    example: str = ""
    """Example of that value."""
    argument_optional: bool = False
    """True if the name may also stand alone: the parameter then has its default, such as the first device."""

    @property
    def value(self) -> str:
        """Return the text behind the name on the command line, such as `:PORT` or `[:PORT]`, or `""`."""
        text = f":{self.example or self.argument.upper()}" if self.argument else ""
        return f"[{text}]" if text and self.argument_optional else text


@dataclass(frozen=True)
class FoundDevice:
    """A device that a search has found."""

    address: str
    """Text behind `--imu NAME:` or `--output NAME:` that chooses it, or `""` if the name alone does."""
    label: str
    """Description for people, such as model, name, battery and signal."""
    details: Mapping[str, str | float] = field(default_factory=dict[str, str | float])
    """Values for programs by name, with the unit in the name, such as `rssi_dbm`."""


Discover = Callable[[float], Awaitable[Sequence[FoundDevice]]]
"""Search for devices for a number of seconds.

It returns all devices that it found, and ends when it is cancelled. It must not block the event loop. If an
extra or an adapter is missing, it raises a ConfigError with the remedy.
"""


@dataclass(frozen=True, kw_only=True)
class DevicePlugin(Plugin):
    """A kind of device."""

    discover: Discover | None = None
    """Finds devices of this kind that are within reach. None if there is no way to find them."""


PluginT = TypeVar("PluginT", bound=Plugin)


class PluginGroup(InstalledGroup[PluginT]):
    """The installed plug-ins of one kind."""

    def choose(self, text: str) -> tuple[str, dict[str, Any]]:
        """Return the name and the parameters that `NAME` or `NAME:VALUE` chooses.

        Raises:
            ConfigError: If it is not installed, or the value is missing or too much.
        """
        name, colon, value = text.partition(":")
        plugin = self.get(name)
        missing = plugin.argument and not value and not plugin.argument_optional
        if missing or (value and not plugin.argument) or (colon and not value):
            raise ConfigError(f"write {name}{plugin.value}")
        return name, {plugin.argument: value} if value else {}

    def configs(self, among: Collection[str] | None = None) -> dict[str, type[Config]]:
        """Return parameters of all that can be imported, by name; `among` as in `PluginConfig.sections`."""
        found: dict[str, type[Config]] = {}
        for name in self.names:
            if among is not None and name.replace("_", "-") not in among:
                continue
            try:
                found[name] = self.get(name).config
            except ConfigError:
                continue  # reported if it is chosen
        return found

    def validate(self, name: str, values: Any, loc: tuple[int | str, ...] = ()) -> Config:
        """Return the parameters `values` of the plug-in `name`.

        Raises:
            ValidationError: A value at `loc` and below is wrong.
            ConfigError: If the plug-in is not installed or cannot be imported.
        """
        kind = self.get(name).config
        try:
            return validate(kind, values)
        except ValidationError as error:
            below, text = first_mistake(error, kind)
            raise _described((*loc, *below), text, values) from error


def _described(loc: tuple[int | str, ...], text: str, value: object) -> ValidationError:
    error = PydanticCustomError(DESCRIBED, "{text}", {"text": text})
    details = InitErrorDetails(type=error, loc=loc, input=value)
    return ValidationError.from_exception_data("plug-in", [details])


class PluginConfig(Config, extra="allow"):
    """Parameters of a service and, under the name of each of its plug-ins, those of the plug-in."""

    @classmethod
    def plugins(cls) -> PluginGroup[Any]:
        """Return the plug-ins of the service."""
        raise NotImplementedError

    def model_post_init(self, _context: object) -> None:
        """Validate the parameters of plug-ins, which pydantic takes as they are."""
        extra: dict[str, Any] = self.__pydantic_extra__ or {}
        plugins = self.plugins()
        for name, values in extra.items():
            if name not in plugins.names or plugins.get(name).config is type(self):
                unknown = InitErrorDetails(type="extra_forbidden", loc=(name,), input=values)
                raise ValidationError.from_exception_data(type(self).__name__, [unknown])
            extra[name] = plugins.validate(name, values, (name,))

    @classmethod
    def sections(cls, among: Collection[str] | None = None) -> Mapping[str, type[Config]]:
        """Return the parameters of installed plug-ins by name, but for those that read the service's.

        `among`: names of the plug-ins to import, with hyphens as in options. None: all.
        """
        configs = cls.plugins().configs(among).items()
        return {name: config for name, config in configs if config is not cls and not cls._is_shadowed(name)}

    @classmethod
    def _is_shadowed(cls, name: str) -> bool:
        plugins = cls.plugins()
        return name in cls.model_fields and name in plugins.names and plugins.package(name) not in OURS

    def section(self, name: str) -> Config:
        """Return the parameters of the plug-in `name`: those configured, else its defaults.

        Raises:
            ConfigError: If it cannot be imported, or has the name of a parameter of the service.
        """
        if self._is_shadowed(name):
            raise ConfigError(
                f"{self.plugins().label(name)} has the name of a parameter, so that its own cannot be set: "
                "rename its entry point"
            )
        given: Config | None = (self.__pydantic_extra__ or {}).get(name)
        if given is not None:
            return given
        kind: type[Config] = self.plugins().get(name).config
        return self if kind is type(self) else kind()
