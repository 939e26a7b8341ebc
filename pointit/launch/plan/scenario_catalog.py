"""The scenarios that a run can switch to, each with the command line's choices, and checks of their maps."""

import contextlib
import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pointit.launch.plan.launches import (
    PAGE,
    Choices,
    assumed_places,
    place_of,
    robots_of,
    service_of,
    site_launches,
    user_launches,
)
from pointit.launch.plan.plan import Plan, Scenario, read_scenario, scenario_names
from pointit.maps.environment import broken_references, environment
from pointit.maps.file import map_path, read_map_file
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch, check_launches
from pointit.schemas import Environment, RunScenario, ScenarioOffer
from pointit.schemas.system import split_instance
from pointit.services.pui.config import PuiConfig

PLACES = 8
"""Number of people whose assumed places are given to a page, present or not."""


def name_of(index: int) -> str:
    """Return the name of the person `index`, counted from 0, of a scenario."""
    return f"user{index + 1}"


def scenario_launches(scenario: Scenario, choices: Choices, people: int | Sequence[str]) -> list[Launch]:
    """Return the services of a scenario with `people` people, or with those of these names.

    Raises:
        ConfigError: a service or parameter is wrong, or the map lacks what they need.
    """
    launches = site_launches(scenario, choices)
    if isinstance(people, int):
        names: Sequence[str] = [name_of(index) for index in range(people)]
    else:
        names = people
    for index, name in enumerate(names):
        launches += user_launches(scenario, choices, name, index)
    check_map_fits(launches)
    return launches


def places(scenario: Scenario, choices: Choices) -> dict[str, dict[str, Any]]:
    """Return the assumed places of people by user, for the page."""
    by_user: dict[str, dict[str, Any]] = {}
    for index in range(PLACES):
        by_user[name_of(index)] = place_of(scenario, choices, index).model_dump()
    return by_user


@dataclass(frozen=True, kw_only=True)
class ScenarioCatalog:
    """Scenarios that a run may change to, each with the choices of the command line that fit it."""

    sources: Mapping[str, str]
    """Argument of `read_scenario` by name."""
    choices: Choices
    room: str
    """Map of the scenario for which the choices were made."""

    @classmethod
    def beginning_with(
        cls, name: str, source: str, scenario: Scenario, choices: Choices
    ) -> "ScenarioCatalog":
        """Return the shipped scenarios, and the one that is run first, if it is a file."""
        shipped = {shipped: shipped for shipped in scenario_names()}
        return cls(sources=shipped | {name: source}, choices=choices, room=_room(scenario))

    @property
    def offered(self) -> tuple[ScenarioOffer, ...]:
        """Return the scenarios that can run with the choices, on the map they name."""
        must_fit = bool(self.choices.settings or self.choices.files)
        offers: list[ScenarioOffer] = []
        for name, source in self.sources.items():
            with contextlib.suppress(ConfigError):  # one that cannot run is not offered
                scenario = read_scenario(source)
                if must_fit:
                    self._check_runs(scenario)
                offers.append(scenario.offer(name, is_shipped=source == name))
        return tuple(offers)

    def plan(self, query: RunScenario, plan: Plan) -> Plan:
        """Return the plan of the requested scenario, which replaces `plan`, checked as at a start.

        Raises:
            ConfigError: If there is no such scenario, or it does not fit the choices.
        """
        source = self.sources.get(query.scenario)
        if source is None:
            names = ", ".join(offer.name for offer in self.offered)
            raise ConfigError(f"no scenario {query.scenario!r}; there are {names}")
        scenario = read_scenario(source)
        localizes = plan.localizes if query.localizes is None else query.localizes
        choices = self._fitting(scenario, localize=localizes)
        people = len(plan.users) if query.users is None else query.users
        launches = scenario_launches(scenario, choices, people)
        check_launches(launches, plan.link.addresses)

        # A duration from the command line is that of the whole run
        duration_s = plan.duration_s if plan.is_limited else scenario.duration_s
        name = Path(source).stem
        return dataclasses.replace(
            plan,
            name=name,
            scenario=name,
            launches=launches,
            target_kinds=scenario.target_kinds,
            goal=scenario.goal,
            title=scenario.title_as(query.scenario),
            duration_s=duration_s,
            localizes=localizes,
            notes=(*self._ignored(scenario), *assumed_places(launches, choices)),
        )

    def _check_runs(self, scenario: Scenario) -> None:
        """Check that it can run with the choices. Raises ConfigError."""
        choices = self._fitting(scenario, localize=self.choices.localize)
        check_launches(scenario_launches(scenario, choices, 1))

    def _fitting(self, scenario: Scenario, *, localize: bool) -> Choices:
        choices = self.choices
        poses = choices.poses if _room(scenario) == self.room else ()
        if localize:  # the poses of people with a device are found by pointing
            devices = [*choices.imu, *["sim"] * len(poses)]
            pairs = zip(poses, devices, strict=False)
            poses = [pose if device == "sim" else None for pose, device in pairs]

        # Choices for services that this scenario has not are left out, and reported by `_ignored`
        robot = choices.robot if robots_of(scenario) else None
        targets = choices.targets if localize else None
        method = choices.method if "selector" in scenario.site else ""
        output = choices.output if "led-driver" in scenario.site else ""
        services = {*_services(scenario), *choices.services}
        settings = [setting for setting in choices.settings if service_of(setting) in services]
        return dataclasses.replace(
            choices,
            localize=localize,
            robot=robot,
            targets=targets,
            poses=poses,
            method=method,
            output=output,
            settings=settings,
        )

    def _ignored(self, scenario: Scenario) -> Iterator[str]:
        choices = self.choices
        services = _services(scenario)
        setting_services = [(f"--set {setting}", service_of(setting)) for setting in choices.settings]
        if choices.method:
            setting_services.append((f"--method {choices.method}", "selector"))
        if choices.output:
            setting_services.append((f"--output {choices.output}", "led-driver"))
        for option, service in setting_services:
            if service not in services and service != PAGE:
                yield f"{option} is ignored: {scenario.source} has no {service}"
        if any(choices.poses) and _room(scenario) != self.room:
            yield f"--pose is ignored: it is for another map; people stand where {scenario.source} says"


def _services(scenario: Scenario) -> set[str]:
    """Return the services that may run in a scenario; every person may have an imu-bridge."""
    site_services = [split_instance(instance)[0] for instance in scenario.site]
    return {*site_services, *scenario.user, "imu-bridge"}


def _room(scenario: Scenario) -> str:
    return str(scenario.site.get("pui", {}).get("map", ""))


def check_map_fits(launches: Sequence[Launch]) -> None:
    """Check that the map of `launches` has the belts, strips and lamps that they need.

    Without a pui, or if its map names missing belts, there is nothing to check: pui reports that itself.

    Raises:
        ConfigError: If it lacks some; names the map, what it has and the option to set.
    """
    room = room_of(launches)
    if room is None:
        return
    for launch in launches:
        try:
            launch.service.validate_map(launch.config, room)
        except ConfigError as error:
            raise ConfigError(f"{launch.instance}: {error}") from error


def room_of(launches: Sequence[Launch]) -> Environment | None:
    """Return the map of `launches` without the points of its clouds, or None if they have none to check.

    Raises:
        ConfigError: If it cannot be read.
    """
    for launch in launches:
        if isinstance(launch.config, PuiConfig):
            name_or_path = launch.config.map_to_read
            if name_or_path:
                return _map_without_points(name_or_path)
    return None


def _map_without_points(name_or_path: str) -> Environment | None:
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
