"""Checks before a run starts that its map has what the services need."""

from collections.abc import Sequence

import numpy as np

from pointit.maps.environment import environment
from pointit.maps.file import map_path, read_map_file
from pointit.maps.lanes import broken_references
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch
from pointit.schemas import Environment
from pointit.services.pui.config import PuiConfig


def check_map_fits(launches: Sequence[Launch]) -> None:
    """Check that the map of `launches` has the belts, strips and lamps that they need.

    Without a pui, or if its map names missing belts, there is nothing to check: pui reports that itself.

    Raises:
        ConfigError: If it lacks some; names the map, what it has and the option to set.
    """
    configs = [launch.config for launch in launches]
    maps = (config.map_to_read for config in configs if isinstance(config, PuiConfig))
    room = next((_room(name) for name in maps if name), None)
    if room is None:
        return
    for launch in launches:
        try:
            launch.service.validate_map(launch.config, room)
        except ConfigError as error:
            raise ConfigError(f"{launch.instance}: {error}") from error


def _room(name_or_path: str) -> Environment | None:
    """Return the map without the points of its clouds, which are slow to read and not needed here."""
    try:
        with map_path(name_or_path) as path:
            file = read_map_file(path)
    except ConfigError as error:
        raise ConfigError(f"pui: {error}") from error
    if any(broken_references(file)):
        return None
    clouds = {name: np.zeros((1, 3)) for name in file.clouds}
    return environment(file, clouds, name=path.stem, stamp_ns=0)
