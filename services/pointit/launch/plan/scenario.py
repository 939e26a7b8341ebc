"""Scenarios: which services run, how they are configured, where people stand and how tall they are."""

from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Self

from pydantic import Field, PrivateAttr

from pointit.maps.file import read_map_file
from pointit.maps.model import MapFile
from pointit.runtime.config.config import Config, Layers
from pointit.runtime.config.nearest_name import did_you_mean
from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import ConfigError
from pointit.schemas import KeyNameError
from pointit.schemas.topics import check_name
from pointit.services import registry
from pointit.services.supervisor.config import measures

SHIPPED = resources.files("pointit.launch") / "scenarios"
LONGEST_NAME = 60
"""Characters of a scenario's name: 64 fit into the key of its run, with `schemas.system.RUN` before it."""
THINGS = "shelf"
"""Scenario of a map with things that is run itself."""
USUAL = "scenario_4"
"""Default scenario, also the source of a person's parameters if the site runs no shipped one."""

REALISTIC: dict[str, Any] = {
    "wristband": {"yaw_rate_bias_sd_degps": 0.25, "dropout_share": 0.01},
    "anchor_when_off_deg": 10.0,
}
"""Simulated person who is localized by pointing: a band with realistic drift (pointing.md §7), and they point
at a lamp again when the cursor has drifted away."""


class ScenarioPlace(Config):
    """Position of a person in {W}, and the azimuth of their IMU's yaw 0."""

    position_m: tuple[float, float, float]
    yaw_deg: float = 0.0


class Scenario(Config):
    """Contents of a scenario file."""

    about: str = Field(description="one sentence")
    explained: str = Field(
        default="", description="description of the events and of what to watch, some sentences"
    )
    duration_s: float | None = Field(default=60.0, gt=0, description="default duration, s; null: no end")
    target_kinds: tuple[str, ...] = Field(default=(), description="kinds of objects to select")
    places: tuple[ScenarioPlace, ...] = Field(min_length=1, description="positions of the people, in turn")
    site: dict[str, dict[str, Any]] = Field(default={}, description="services for all, by name")
    user: dict[str, dict[str, Any]] = Field(default={}, description="services per person, by name")
    _source: str = PrivateAttr(default="scenario")

    @property
    def source(self) -> str:
        """Return the name of its file, for error messages."""
        return self._source

    def place_of(self, index: int) -> ScenarioPlace:
        """Return the place of the person `index`, counted from 0. Places repeat if there are more people."""
        return self.places[index % len(self.places)]

    @classmethod
    def read(cls, path: Path, source: str) -> Self:
        """Return the scenario in the file at `path`, called `source` in errors."""
        layers, content = Layers(), read_yaml(path)
        if content.keys() & MapFile.model_fields.keys() and not content.keys() & cls.model_fields.keys():
            if content.get("things"):
                return cls._of_things(path, source)
            raise ConfigError(
                f"{source}: is a map, not a scenario; run a scenario in it: `pointit run scenario_2 --set "
                f"pui.map={source}`"
            )
        for scope in content.keys() & {"site", "user"}:
            if isinstance(content[scope], dict):
                content[scope] = registry.sections_by_service(content[scope], f"{source}: {scope}")
        layers.add(content, source)
        scenario = layers.build(cls)
        scenario._source = source  # noqa: SLF001 - its own
        room = scenario.site.get("pui", {}).get("map")
        if isinstance(room, str) and Path(room).suffix:  # a file, relative to the scenario's
            scenario.site["pui"]["map"] = str(path.parent / room)
        return scenario

    @classmethod
    def _of_things(cls, path: Path, source: str) -> Self:
        """Return the scenario `THINGS` in the room of the map at `path`, until Ctrl-C."""
        with resources.as_file(SHIPPED / f"{THINGS}.yaml") as shipped:
            scenario = cls.read(shipped, source)
        things = read_map_file(path).things
        scenario.site["pui"]["map"] = str(path)
        scenario.user["user-sim"]["target_kinds"] = [each.label or name for name, each in things.items()]
        return scenario.model_copy(update={"duration_s": None})


def scenario_names() -> list[str]:
    """Return the names of the shipped scenarios."""
    names = (entry.name for entry in SHIPPED.iterdir())
    return sorted(name.removesuffix(".yaml") for name in names if name.endswith(".yaml"))


def read_scenario(name: str) -> Scenario:
    """Return the shipped scenario `name`, or the one in the file of that path.

    Raises:
        ConfigError: If there is none, a field is wrong, or the file's name is not valid in a key.
    """
    if name.endswith((".yaml", ".yml")):
        scenario = Scenario.read(Path(name), name)
        if len(Path(name).stem) > LONGEST_NAME:
            raise ConfigError(
                f"{name}: rename the file: a scenario's name has at most {LONGEST_NAME} characters"
            )
        try:
            check_name(Path(name).stem, "scenario")
        except KeyNameError as error:
            raise ConfigError(f"{name}: rename the file: {error}") from error
        return scenario
    if name not in scenario_names():
        known = scenario_names()
        all_names = f"there are {', '.join(known)}; or give a .yaml file"
        raise ConfigError(f"no scenario {name!r}; {did_you_mean(name, known) or all_names}")
    with resources.as_file(SHIPPED / f"{name}.yaml") as path:
        return Scenario.read(path, path.name)


@dataclass(frozen=True, kw_only=True)
class FloorPose:
    """A place on the floor of {W}, and the azimuth there of the IMU's yaw 0."""

    x_m: float
    y_m: float
    yaw_deg: float | None = None
    """None if not given."""


def body_of(stature_m: float) -> dict[str, float]:
    """Return the body measures, as parameters, of a person `stature_m` tall."""
    return {name: round(value, 4) for name, value in measures(stature_m, {}).model_dump().items()}
