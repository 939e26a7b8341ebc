"""The parameters of a configuration as people see them: the option, the type and the default of each."""

import shlex
import types
import typing
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from pointit.runtime.config.plugins import PluginConfig


def set_option(service: str, parameter: str, value: object) -> str:
    """Return the option that sets a parameter, as it must be typed: `--set imu-bridge.udp.host=0.0.0.0`."""
    assignment = f"{service}.{parameter}={value}"
    return f"--set {shlex.quote(assignment)}"


@dataclass(frozen=True)
class ParameterInfo:
    """One parameter of a configuration tree."""

    path: tuple[str, ...]
    field: FieldInfo

    @property
    def option(self) -> str:
        """Return the command-line option, `--body.arm-m`."""
        return "--" + ".".join(self.path).replace("_", "-")

    @property
    def default(self) -> str:
        """Return the default as text."""
        value: Any = self.field.get_default(call_default_factory=True)
        if value is PydanticUndefined:
            return "required"
        if isinstance(value, BaseModel):
            return str(value.model_dump(mode="json"))
        if isinstance(value, tuple):
            return str(list(typing.cast("tuple[object, ...]", value)))
        return "none" if value is None else str(value)

    @property
    def type_name(self) -> str:
        """Return the type for people: `float`, `text`, `one of a, b`."""
        return _type_name(self.field.annotation)


def iter_parameters(
    kind: type[BaseModel], prefix: tuple[str, ...] = (), *, plugins: Collection[str] | None = None
) -> Iterator[ParameterInfo]:
    """Yield the parameters of `kind`, nested trees flattened, and last those of `plugins`, by default all."""
    for name, field in kind.model_fields.items():
        annotation = field.annotation
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            yield from iter_parameters(annotation, (*prefix, name))
        else:
            yield ParameterInfo((*prefix, name), field)
    if issubclass(kind, PluginConfig):
        for name, section in kind.sections(plugins).items():
            yield from iter_parameters(section, (*prefix, name))


def _type_name(annotation: Any) -> str:
    origin = typing.get_origin(annotation)
    if origin is typing.Annotated:
        return _type_name(typing.get_args(annotation)[0])
    if origin is typing.Literal:
        values = typing.get_args(annotation)
        return "one of " + ", ".join(str(value) for value in values)
    if origin in (typing.Union, types.UnionType):
        kinds = [kind for kind in typing.get_args(annotation) if kind is not type(None)]
        return " or ".join(_type_name(kind) for kind in kinds)
    if origin is tuple:
        inner = [arg for arg in typing.get_args(annotation) if arg is not Ellipsis]
        return "list of " + _type_name(inner[0]) if inner else "list"
    if origin is dict:
        key, value = typing.get_args(annotation)
        return f"mapping of {_type_name(key)} to {_type_name(value)}"
    if annotation is str:
        return "text"
    return getattr(annotation, "__name__", str(annotation))
