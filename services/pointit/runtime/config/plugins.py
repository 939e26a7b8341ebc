"""Parts of a service that installed packages add: declared as entry points, found without importing any.

A plug-in is imported when it is used. All of a kind are imported where the parameters of all are listed, such
as in the help of a service.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, TypeVar

from pydantic import ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

from pointit.runtime.config.config import Config
from pointit.runtime.config.validation_message import (
    DESCRIBED,
    first_mistake,
)
from pointit.runtime.errors import ConfigError


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


OURS = "pointit"
"""This project's package, whose names no other can take."""

P = TypeVar("P", bound=Plugin)


class PluginGroup(Generic[P]):
    """The installed plug-ins of one kind."""

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
        entries = entry_points(group=self.group)
        for entry in sorted(
            entries, key=lambda entry: (entry.name, _package(entry) != OURS, _package(entry))
        ):
            others = found.get(entry.name, ())
            if entry.value not in [other.value for other in others] and not (
                others and _package(others[0]) == OURS
            ):
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
        """Import and return the plug-in `name`.

        Raises:
            ConfigError: If none is installed under that name, or several, or it cannot be imported.
        """
        entry, *others = self._entries.get(name, (None,))
        if entry is None:
            known = ", ".join(self.names) or "none"
            raise ConfigError(f"no {self.noun} {name!r} is installed; there are {known}")
        if others:
            raise ConfigError(
                f"{self.noun} {name!r} is in two packages: uninstall {_package(entry)} or "
                f"{_package(others[0])}"
            )
        try:
            plugin = entry.load()
        except (Exception, SystemExit) as error:  # code of others, which may raise anything when imported
            package = _package(entry)
            extras = ",".join(entry.extras)
            remedy = f"install {package}[{extras}]" if extras else f"update or uninstall {package}"
            reason = f"{type(error).__name__}: {error}"
            raise ConfigError(f"{self.label(name)} cannot be imported ({reason}); {remedy}") from error
        if not isinstance(plugin, self._type):
            raise ConfigError(f"{self.noun} {name!r}: {entry.value} is no {self._type.__name__}")
        return plugin

    def label(self, name: str) -> str:
        """Return the name of a plug-in in messages, with its package, without importing it."""
        return f"{self.noun} {name!r} of {self.package(name)}"

    def module(self, name: str) -> str:
        """Return the module of the plug-in `name`, without importing it."""
        return self._entries[name][0].module

    def package(self, name: str) -> str:
        """Return the package that brings the plug-in `name`, without importing it."""
        return _package(self._entries[name][0])

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
            return kind.model_validate(values)
        except ValidationError as error:
            below, text = first_mistake(error, kind)
            raise _described((*loc, *below), text, values) from error


def _package(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist else entry.value


def _described(loc: tuple[int | str, ...], text: str, value: object) -> ValidationError:
    return ValidationError.from_exception_data(
        "plug-in",
        [
            InitErrorDetails(
                type=PydanticCustomError(DESCRIBED, "{text}", {"text": text}), loc=loc, input=value
            )
        ],
    )


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
        """Return True if `name`, of another package's plug-in, is that of a parameter of the service."""
        plugins = cls.plugins()
        return name in cls.model_fields and name in plugins.names and plugins.package(name) != OURS

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
