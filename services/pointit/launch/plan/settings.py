"""Parameters of services from files, variables and `--set`, in ascending precedence."""

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from pointit.runtime.config.config import Layers, environment_prefix
from pointit.runtime.config.nearest_name import nearest
from pointit.runtime.config.plugins import PluginConfig
from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch
from pointit.schemas.system import instance_of, split_instance
from pointit.services import registry


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Parameters of services from the command line."""

    files: Sequence[Path] = ()
    """YAML files that map services to parameters."""
    settings: Sequence[str] = ()
    """`service.parameter=value`."""


def layers_of(instance: str, below: Mapping[str, Mapping[str, Any]], chosen: Settings) -> Layers:
    """Return the parameters of a service: `below`, by source, then files, variables and `--set`.

    One of several services on a site, such as `robot.quad`, gets the parameters of `robot`, too, and its own
    last.

    Raises:
        ConfigError: a file or setting is wrong.
    """
    name = split_instance(instance)[0]
    names = dict.fromkeys((name, instance))
    layers = Layers(registry.process(name).config().REPLACED)
    for source, values in below.items():
        layers.add(values, f"{source}, {instance}")
    for path in chosen.files:
        for each in names:
            layers.add(_section(path, each), f"{path}, {each}")
    layers.add_environment(os.environ, environment_prefix(name))
    for each in names:
        for setting in chosen.settings:
            target, path_in, text = _split(setting)
            if target == each:
                layers.add_text(path_in, text, f"--set {setting}")
    return layers


def check_settings(running: Collection[Launch], chosen: Settings, *others: str) -> None:
    """Check that every `--set` affects a service in `running`, or in `others` that are started.

    Raises:
        ConfigError: If one is for a service that is not started.
    """
    services = {*(launch.service.NAME for launch in running), *others}
    named = {launch.instance for launch in running if launch.name}
    for setting in chosen.settings:
        target, _, _ = _split(setting)
        if target not in services | named:
            there = services if target in registry.names() else named or services
            raise ConfigError(
                f"--set {setting!r}: {target} is not among what this starts: {', '.join(sorted(there))}"
            )


def service_of(setting: str) -> str:
    """Return the service named in a `--set`.

    Raises:
        ConfigError: If it is malformed, or there is no such service.
    """
    return split_instance(_split(setting)[0])[0]


def _section(path: Path, name: str) -> Mapping[str, Any]:
    sections = registry.sections_by_service(read_yaml(path), str(path))
    for section in sections:
        _check_service(section, str(path))
    value = sections.get(name, {})
    if not isinstance(value, dict):
        raise ConfigError(f"{path}: {name}: a mapping of parameters was expected, got {value!r}")
    return cast("dict[str, Any]", value)


def _split(setting: str) -> tuple[str, list[str], str]:
    """Return the service, or one of several such as `robot.quad`; the path of its parameter; the value."""
    target, separator, text = setting.partition("=")
    path = target.split(".")
    if not separator or len(path) < 2:
        raise ConfigError(f"--set {setting!r}: write service.parameter=value, such as pui.map=conveyor")
    path[0] = registry.with_service_name(path[0])
    _check_service(path[0], f"--set {setting!r}")
    if len(path) > 2 and registry.process(path[0]).several and not _is_parameter(path[0], path[1]):
        return instance_of(path[0], path[1]), path[2:], text
    return path[0], path[1:], text


def _is_parameter(service: str, name: str) -> bool:
    config = registry.process(service).config()
    return name in config.model_fields or (
        issubclass(config, PluginConfig) and name in config.plugins().names
    )


def _check_service(instance: str, source: str) -> None:
    name, which = split_instance(instance)
    known = registry.names()
    if name not in known:
        raise ConfigError(f"{source}: {name!r} is no service; {nearest(name, known)}")
    if which and not registry.process(name).several:
        raise ConfigError(f"{source}: {instance!r}: a site has one {name}; leave out {which!r}")
