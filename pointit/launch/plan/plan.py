"""Everything a run needs to know, decided before it starts; and its scenario."""

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self, TypeAlias

from pydantic import Field, PrivateAttr

from pointit.maps.file import read_map_file
from pointit.maps.model import MapFile
from pointit.runtime.bus.contract import Bus, Closable
from pointit.runtime.config.config import Config, Layers
from pointit.runtime.config.nearest_name import did_you_mean
from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import OptionalPart
from pointit.runtime.link.link import Link
from pointit.runtime.service.service import Launch
from pointit.schemas import Environment, KeyNameError, RunScenario, ScenarioOffer
from pointit.schemas.system import MAX_ABOUT, MAX_TITLE
from pointit.schemas.text import one_line
from pointit.schemas.topics import check_name
from pointit.services import registry
from pointit.services.supervisor.config import measures

OnEvent: TypeAlias = Callable[[str, str], object]
"""Takes an event line and the person that it concerns, or `""`."""

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

    title: str = Field(
        default="",
        max_length=MAX_TITLE,
        description="title in menus, such as `Lamps: point at them`; by default the file's name",
    )
    about: str = Field(description="one sentence")
    explained: str = Field(
        default="", description="description of the events and of what to watch, some sentences"
    )
    goal: str = Field(
        default="", max_length=200, description="instruction to a newcomer who points there, in one sentence"
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

    def title_as(self, name: str) -> str:
        """Return its title in menus, or that of a file called `name` which gives none."""
        return self.title or name.replace("_", " ")[:MAX_TITLE]

    def offer(self, name: str, *, is_shipped: bool) -> ScenarioOffer:
        """Return the entry of a menu for this scenario, which runs request by `name`."""
        about = one_line(self.about, MAX_ABOUT)
        return ScenarioOffer(name=name, title=self.title_as(name), about=about, is_shipped=is_shipped)

    def place_of(self, index: int) -> ScenarioPlace:
        """Return the place of the person `index`, counted from 0. Places repeat if there are more people."""
        return self.places[index % len(self.places)]

    @classmethod
    def read(cls, path: Path, source: str) -> Self:
        """Return the scenario in the file at `path`, called `source` in errors."""
        layers = Layers()
        content = read_yaml(path)
        has_map_fields = content.keys() & MapFile.model_fields.keys()
        has_scenario_fields = content.keys() & cls.model_fields.keys()
        if has_map_fields and not has_scenario_fields:
            if content.get("things") or content.get("paced_from"):  # a home may have none yet
                return cls._of_things(path, source)
            raise ConfigError(
                f"{source}: is a map, not a scenario; run a scenario in it: `pointit run scenario_2 --set "
                f"pui.map={source}`"
            )
        for scope in content.keys() & {"site", "user"}:
            if isinstance(content[scope], dict):
                section_source = f"{source}: {scope}"
                content[scope] = registry.sections_by_service(content[scope], section_source)
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
        target_kinds = [thing.label or name for name, thing in things.items()]
        scenario.user["user-sim"]["target_kinds"] = target_kinds
        own = {"title": "", "about": "your own map of things: point at them", "goal": "", "duration_s": None}
        return scenario.model_copy(update=own)


def scenario_names() -> list[str]:
    """Return the names of the shipped scenarios."""
    files = [entry.name for entry in SHIPPED.iterdir()]
    return sorted(file.removesuffix(".yaml") for file in files if file.endswith(".yaml"))


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
        hint = did_you_mean(name, known) or all_names
        raise ConfigError(f"no scenario {name!r}; {hint}")
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
    values = measures(stature_m, {}).model_dump()
    return {name: round(value, 4) for name, value in values.items()}


class Watcher(Protocol):
    """Observes one scenario, from its start to its end."""

    def attach(self, bus: Bus, on_event: OnEvent) -> Sequence[Closable]:
        """Subscribe on `bus`, and call `on_event` with event lines. Return the subscriptions."""
        ...

    def on_map(self, environment: Environment) -> None:
        """Handle the map."""
        ...

    def on_service(self, instance: str, *, is_present: bool) -> None:
        """Handle a change of a service's presence."""
        ...

    def summary(self) -> Mapping[str, Any]:
        """Return its entries in the summary of the run, by names that no other watcher has."""
        ...


MakeWatcher: TypeAlias = Callable[[Sequence[Launch]], Watcher]
"""Returns the watcher of the scenario that runs these services."""


class Beside(ABC):
    """A service beside the scenario, which keeps running when that changes."""

    WHAT: ClassVar[str]
    """Common noun in messages, such as `page`."""
    WAIT_S: ClassVar[float] = 0.0
    """The scenario waits until it is present, at most for this time, and ends before it. 0: it is started in
    the background after the scenario."""
    ONE_IS_ENOUGH: ClassVar[bool] = False
    """It is not started on a site that has one."""

    @property
    @abstractmethod
    def instance(self) -> str:
        """Return its instance name."""

    @abstractmethod
    def launch(self) -> Launch:
        """Return its launch. May be slow: it imports the service."""

    def needs_own_process(self, link: Link) -> bool:
        """Return True if it is served by a supervised process of its own. `link`: that of the run."""
        del link
        return False

    def checked(self) -> Sequence[Launch]:
        """Return the launches to check before anything starts."""
        return [self.launch()]

    def joined(self, bus: Bus) -> AbstractContextManager[object]:
        """Return a context that is open while the run is on `bus`."""
        del bus
        return contextlib.nullcontext()

    def greeting(self, *, is_drawn: bool) -> Sequence[str]:
        """Return the sentences to print once it is present. `is_drawn`: the view shows its `address`."""
        del is_drawn
        return ()

    @property
    def address(self) -> str:
        """Return the URL that the view shows, or `""`."""
        return ""

    def closing_note(self) -> str:
        """Return the sentence to print after it has ended, or `""`."""
        return ""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Everything a run needs to know."""

    name: str
    launches: Sequence[Launch]
    """Services of the scenario or the person, without those beside it."""
    link: Link
    target_kinds: Sequence[str] = ()
    goal: str = ""
    """Instruction to a newcomer who points there, or `""`."""
    seed: int = 0
    duration_s: float | None = None
    is_limited: bool = False
    """The duration was requested: the run ends then, even with viewers."""
    speed: float = 1.0
    processes: bool = False
    may_move: bool = False
    """The listen address is only the default: use the next port if it is in use."""
    scored: bool = True
    """A whole scenario: print a summary at the end, and fail if there was no cursor."""
    view: bool = True
    person: str = ""
    """The only person whose activity is reported and drawn, or `""` for all."""
    notes: Sequence[str] = ()
    """Messages to print at the start."""
    closing_note: str = ""
    """Message to print below the summary."""
    summary: Path | None = None
    as_json: bool = False
    beside: Sequence[Beside] = ()
    """Services that stay when the scenario changes, such as a page and a recorder."""
    watchers: Sequence[MakeWatcher] = ()
    """Factories of further observers of each scenario, beside those of optional packages."""
    scenario: str = ""
    """Name of the running scenario, or `""` for one person's part."""
    title: str = ""
    """Title of the running scenario, or `""` for one person's part."""
    offers: Sequence[ScenarioOffer] = ()
    """Scenarios that can be requested instead."""
    localizes: bool = False
    """People are localized by pointing at lamps."""
    another: "Callable[[RunScenario, Plan], Plan] | None" = None
    """Makes the plan that replaces the running one on request; raises ConfigError. Thread-safe."""

    @property
    def users(self) -> list[str]:
        """Return the users whose services it starts, in order."""
        return list(dict.fromkeys(launch.user for launch in self.launches if launch.user))

    @property
    def instances(self) -> list[str]:
        """Return the instance names of all that it starts."""
        own = [launch.instance for launch in self.launches]
        return own + [beside.instance for beside in self.beside]


WATCHERS: tuple[OptionalPart[MakeWatcher], ...] = (
    OptionalPart("pointit.launch.robots:RobotWatcher.of", ("pointit.services.user_sim",)),
)
"""Factories of the observers and scores of a run."""
