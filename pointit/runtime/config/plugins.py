"""Parts that installed packages add, declared as entry points, found without importing any.

A plug-in is imported when it is used. All of a kind are imported where the parameters of all are listed, such
as in the help of a service.
"""

import ast
from collections.abc import Awaitable, Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

from pointit.runtime.config.config import Config, validate
from pointit.runtime.config.installed import OURS, InstalledGroup
from pointit.runtime.config.validation_message import DESCRIBED, first_mistake
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
        return value_text(self.argument, self.example, is_optional=self.argument_optional)


def value_text(argument: str, example: str, *, is_optional: bool) -> str:
    """Return the text of `Plugin.value` for its fields."""
    if not argument:
        return ""
    text = f":{example or argument.upper()}"
    return f"[{text}]" if is_optional else text


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
        if value:
            is_valid = bool(plugin.argument)
        else:
            is_required = plugin.argument and not plugin.argument_optional
            is_valid = not colon and not is_required
        if not is_valid:
            raise ConfigError(f"write {name}{plugin.value}")
        return name, {plugin.argument: value} if value else {}

    def stated_value(self, name: str) -> str:
        """Return `Plugin.value` of the plug-in `name` as its source states it, without importing it.

        `""` if the source is not found, or states it otherwise than by literals.
        """
        try:
            source = _source(self.module(name))
        except (OSError, ImportError, SyntaxError, ValueError):  # code of others
            return ""
        variable = self.attribute(name)
        for statement in source.body:
            if isinstance(statement, ast.Assign):
                targets = statement.targets
            elif isinstance(statement, ast.AnnAssign):
                targets = [statement.target]
            else:
                continue
            is_plugin = any(isinstance(target, ast.Name) and target.id == variable for target in targets)
            if is_plugin and isinstance(statement.value, ast.Call):
                return _value_of(statement.value)
        return ""

    def configs(self, among: Collection[str] | None = None) -> dict[str, type[Config]]:
        """Return parameters of all that can be imported, by name; `among` as in `PluginConfig.sections`."""
        configs: dict[str, type[Config]] = {}
        for name in self.names:
            if among is not None and name.replace("_", "-") not in among:
                continue
            try:
                configs[name] = self.get(name).config
            except ConfigError:
                continue  # reported if it is chosen
        return configs

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


def _source(module: str) -> ast.Module:
    """Return the parsed source of `module`.

    Raises:
        ImportError: If there is no such file below its topmost package.
        OSError, SyntaxError, ValueError: If it cannot be read.
    """
    # Only a module without a package is found without importing a package above it
    top, *below = module.split(".")
    spec = find_spec(top)
    if spec is None or spec.origin is None:
        raise ImportError(f"{top} is not found")
    path = Path(spec.origin)
    if below:
        path = path.parent.joinpath(*below)
        path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    return ast.parse(path.read_text(encoding="utf-8"))


def _value_of(call: ast.Call) -> str:
    literals: dict[str, Any] = {}
    for keyword in call.keywords:
        if keyword.arg is not None and isinstance(keyword.value, ast.Constant):
            literals[keyword.arg] = keyword.value.value
    return value_text(
        str(literals.get("argument", "")),
        str(literals.get("example", "")),
        is_optional=bool(literals.get("argument_optional", False)),
    )


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
        configs = cls.plugins().configs(among)
        own_configs = {name: config for name, config in configs.items() if config is not cls}
        return {name: config for name, config in own_configs.items() if not cls._is_shadowed(name)}

    @classmethod
    def _is_shadowed(cls, name: str) -> bool:
        plugins = cls.plugins()
        if name not in cls.model_fields or name not in plugins.names:
            return False
        return plugins.package(name) not in OURS

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
        configured: Config | None = (self.__pydantic_extra__ or {}).get(name)
        if configured is not None:
            return configured
        kind: type[Config] = self.plugins().get(name).config
        return self if kind is type(self) else kind()
