"""Checks before a run starts that its map has what the services need."""

from collections.abc import Sequence

import numpy as np

from pointit.maps.environment import environment
from pointit.maps.file import map_path, read_map_file
from pointit.maps.lanes import broken_references
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch
from pointit.schemas import Environment
from pointit.services.conveyor_sim.config import ConveyorSimConfig
from pointit.services.conveyor_sim.from_map import UnusableMapError
from pointit.services.conveyor_sim.plant import Plant
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.pui.config import PuiConfig

MIN_LAMPS = 2
"""Lamps needed to localize by pointing."""


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
        config = launch.config
        if isinstance(config, ConveyorSimConfig):
            try:
                Plant(room, config, seed=0, start_ns=0)
            except UnusableMapError as error:
                raise ConfigError(f"{launch.instance}: {error}, or choose another map: pui.map") from error
            _check_bays(launch.instance, config, room)
        if (
            isinstance(config, LocalizerConfig)
            and config.method == "static_targets"
            and len(room.lamps) < MIN_LAMPS
        ):
            raise ConfigError(
                f"{launch.instance}: map {room.name!r} has {len(room.lamps) or 'no'} "
                f"lamp{'' if len(room.lamps) == 1 else 's'} and pointing at lamps needs {MIN_LAMPS}; "
                "leave --localize out, or add lamps to the map"
            )


def _check_bays(instance: str, config: ConveyorSimConfig, room: Environment) -> None:
    """Check that the configured bays exist. A map with fewer than two bays sorts nothing."""
    there = [bay.id for bay in room.bays]
    for name, bay in (("bay_selected", config.bay_selected), ("bay_rest", config.bay_rest)):
        if len(there) > 1 and bay not in there:
            raise ConfigError(
                f"{instance}: {name}: map {room.name!r} has no bay {bay!r}, there are {', '.join(there)}; "
                f"set conveyor-sim.{name}"
            )


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
