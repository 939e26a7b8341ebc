"""Parameters of services from files, variables and `--set`, in ascending precedence."""

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from pointit.runtime.config.config import Layers
from pointit.runtime.config.environment import environment_prefix
from pointit.runtime.config.similar_names import nearest
from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import ConfigError
from pointit.services import registry


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Parameters of services from the command line."""

    files: Sequence[Path] = ()
    """YAML files that map services to parameters."""
    settings: Sequence[str] = ()
    """`service.parameter=value`."""


def layers_of(name: str, below: Mapping[str, Mapping[str, Any]], chosen: Settings) -> Layers:
    """Return the parameters of the service `name`: `below`, by source, then files, variables and `--set`.

    Raises:
        ConfigError: a file or setting is wrong.
    """
    layers = Layers(registry.process(name).config().REPLACED)
    for source, values in below.items():
        layers.add(values, f"{source}, {name}")
    for path in chosen.files:
        layers.add(_section(path, name), f"{path}, {name}")
    layers.add_environment(os.environ, environment_prefix(name))
    for setting in chosen.settings:
        target, text = _split(setting)
        if target[0] == name:
            layers.add_text(target[1:], text, f"--set {setting}")
    return layers


def check_settings(running: Collection[str], chosen: Settings) -> None:
    """Check that every `--set` has an effect.

    Raises:
        ConfigError: If one is for a service that is not among `running`.
    """
    for setting in chosen.settings:
        service = service_of(setting)
        if service not in running:
            raise ConfigError(
                f"--set {setting!r}: {service} is not among what this starts: {', '.join(sorted(running))}"
            )


def service_of(setting: str) -> str:
    """Return the service named in a `--set`.

    Raises:
        ConfigError: If it is malformed, or there is no such service.
    """
    return _split(setting)[0][0]


def _section(path: Path, name: str) -> Mapping[str, Any]:
    sections = read_yaml(path)
    for section in sections:
        _check_service(section, str(path))
    value = sections.get(name, {})
    if not isinstance(value, dict):
        raise ConfigError(f"{path}: {name}: a mapping of parameters was expected, got {value!r}")
    return cast("dict[str, Any]", value)


def _split(setting: str) -> tuple[list[str], str]:
    target, separator, text = setting.partition("=")
    path = target.split(".")
    if not separator or len(path) < 2:
        raise ConfigError(f"--set {setting!r}: write service.parameter=value, such as pui.map=conveyor")
    _check_service(path[0], f"--set {setting!r}")
    return path, text


def _check_service(name: str, source: str) -> None:
    known = registry.names()
    if name not in known:
        raise ConfigError(f"{source}: {name!r} is no service; {nearest(name, known)}")
