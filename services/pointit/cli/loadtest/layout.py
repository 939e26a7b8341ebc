"""Services of a load test and their processes: people, the services of each, those of the site."""

from dataclasses import dataclass
from typing import Literal

from pointit.cli.loadtest.rig import Group
from pointit.launch.plan.launches import Choices, site_launches, user_launches
from pointit.launch.plan.scenario import read_scenario
from pointit.runtime.service.service import Launch

Layout = Literal["one", "users", "services"]

SCENARIO = "scenario_3"
DEFAULTS = Choices()
WITHOUT = ("user-sim", "supervisor", "imu-bridge")
"""Services left out: the load test drives the wrists, and no button is needed."""


@dataclass(frozen=True, kw_only=True)
class Load:
    """Parameters of a load test."""

    users: int
    rate_hz: float
    duration_s: float
    layout: Layout
    shards: int
    router: bool
    secured: bool
    """The router requires certificates, and encrypts."""
    site: str
    connect: tuple[str, ...]
    """Addresses of a running site. Empty: start a site of its own."""

    @property
    def name(self) -> str:
        """Return a description of the layout."""
        words = {
            "one": "one process",
            "users": f"users in {self.shards} processes",
            "services": "a process a service",
        }
        through = " through a secured router" if self.secured else " through a router" if self.router else ""
        return words[self.layout] + through


def load_launches(
    count: int, scenario_name: str = SCENARIO, choices: Choices = DEFAULTS
) -> tuple[list[Launch], dict[str, list[Launch]]]:
    """Return the services of the site, and by name those of `count` people without wrists and buttons."""
    scenario = read_scenario(scenario_name)
    people = {
        name: [
            launch
            for launch in user_launches(scenario, choices, name, index)
            if launch.service.NAME not in WITHOUT
        ]
        for index, name in enumerate(f"load{index}" for index in range(count))
    }
    return site_launches(scenario, choices), people


def groups(load: Load, count: int) -> tuple[Group, list[Group]]:
    """Return the group of this process and those of others, for `count` people."""
    site, by_name = load_launches(count)
    site = [] if load.connect else site
    names, people = list(by_name), list(by_name.values())
    if load.layout == "one":
        own = [launch for person in people for launch in person]
        return Group(name="all", launches=[*site, *own], wrists=names), []
    if load.layout == "users":
        shards = min(load.shards, count)
        parts = [
            Group(
                name=f"users {part + 1}",
                launches=[launch for person in people[part::shards] for launch in person],
                wrists=names[part::shards],
            )
            for part in range(shards)
        ]
        return Group(name="site" if site else "onlooker", launches=site), parts
    by_service: dict[str, list[Launch]] = {}
    for launch in (*site, *(launch for person in people for launch in person)):
        by_service.setdefault(launch.service.NAME, []).append(launch)
    each = [Group(name=name, launches=launches) for name, launches in by_service.items()]
    return Group(name="wrists", wrists=names), each
