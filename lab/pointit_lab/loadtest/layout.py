"""Services of a load test and their processes: people, the services of each, those of the site."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Literal

from pointit.launch.plan.launches import Choices, site_launches, user_launches
from pointit.launch.plan.plan import read_scenario
from pointit.runtime.service.service import Launch
from pointit_lab.loadtest.network.routers import Program
from pointit_lab.loadtest.network.tree import Machine, spread
from pointit_lab.loadtest.workers import Group

Layout = Literal["one", "users", "services"]

SCENARIO = "scenario_3"
DEFAULTS = Choices()
WITHOUT = ("user-sim", "supervisor", "imu-bridge")
"""Services left out: the load test drives the wrists, and no button is needed."""

SHARDED = ("pui", "selector")
"""Shared services that may serve the people of a host beside them."""


@dataclass(frozen=True, kw_only=True)
class LoadParameters:
    """Parameters of a load test."""

    rate_hz: float
    duration_s: float
    layout: Layout
    shards: int
    router: Program | None
    """Router between the processes. None: there is none."""
    secured: bool
    """The router requires certificates, and encrypts."""
    site: str
    connect: tuple[str, ...]
    """Addresses of a running site. Empty: start a site of its own."""
    hosts: int = 0
    """Number of simulated hosts of people. 0: none is simulated."""
    routers: int = 0
    fan: int = 1
    """Maximum of routers that join the same one."""
    central: bool = False
    """One pui and one selector serve all hosts."""

    @property
    def name(self) -> str:
        """Return a description of the layout."""
        secured = "secured " if self.secured else ""
        program = " (zenohd)" if self.router == "zenohd" else ""
        if self.hosts:
            hosts = _counted(self.hosts, "host")
            routers = _counted(max(1, self.routers), f"{secured}router")
            central = ", all cursors from the first" if self.central else ""
            return f"{hosts}, {routers}{program}{central}"
        names = {
            "one": "one process",
            "users": f"users in {self.shards} processes",
            "services": "a process a service",
        }
        name = names[self.layout]
        if self.router:
            return f"{name} through a {secured}router{program}"
        return name


def _counted(count: int, noun: str) -> str:
    return f"1 {noun}" if count == 1 else f"{count} {noun}s"


def load_launches(
    count: int, scenario_name: str = SCENARIO, choices: Choices = DEFAULTS
) -> tuple[list[Launch], dict[str, list[Launch]]]:
    """Return the services of the site, and by name those of `count` people without wrists and buttons."""
    scenario = read_scenario(scenario_name)
    people: dict[str, list[Launch]] = {}
    for index in range(count):
        name = f"load{index}"
        launches = user_launches(scenario, choices, name, index)
        people[name] = [launch for launch in launches if launch.service.NAME not in WITHOUT]
    return site_launches(scenario, choices), people


def groups(load: LoadParameters, count: int) -> tuple[Group, list[Group]]:
    """Return the group of this process and those of others, for `count` people."""
    site, by_name = load_launches(count)
    site = [] if load.connect else site
    names = list(by_name)
    people = list(by_name.values())
    if load.layout == "one":
        launches = [*site, *chain.from_iterable(people)]
        return Group(name="all", launches=launches, wrists=names), []

    # People are dealt in turn, so that the shards differ by one person at most.
    if load.layout == "users":
        shards = min(load.shards, count)
        parts: list[Group] = []
        for part in range(shards):
            launches = list(chain.from_iterable(people[part::shards]))
            group = Group(name=f"users {part + 1}", launches=launches, wrists=names[part::shards])
            parts.append(group)
        return Group(name="site" if site else "onlooker", launches=site), parts

    by_service = defaultdict[str, list[Launch]](list)
    for launch in chain(site, chain.from_iterable(people)):
        by_service[launch.service.NAME].append(launch)
    services = [Group(name=name, launches=launches) for name, launches in by_service.items()]
    return Group(name="wrists", wrists=names), services


def host_groups(load: LoadParameters, count: int, machines: Sequence[Machine]) -> dict[int, list[Group]]:
    """Return the processes of each machine by its index: its people's, and at the first host the site's.

    Unless the load is `central`, cursors and hovers are computed by shards beside the people.
    """
    site, by_name = load_launches(count)
    sharded = [launch for launch in site if launch.service.NAME in SHARDED]
    everybody = list(by_name)
    groups: dict[int, list[Group]] = {}
    for number, (index, names) in enumerate(spread(everybody, machines).items(), 1):
        groups[index] = []

        # Cursors are observed where they are computed: no link carries more for the observer's sake.
        if number == 1:
            observed = everybody if load.central else []
            site_group = Group(name="site", launches=site, watched=observed, watches_light=True)
            groups[index].append(site_group)
        if names:
            own_launches = [by_name[name] for name in names]
            launches = list(chain.from_iterable(own_launches))
            watched: Sequence[str] = []
            if not load.central:
                launches += [_shard(launch, f"host{number}", names) for launch in sharded]
                watched = names
            group = Group(name=f"people {number}", launches=launches, wrists=names, watched=watched)
            groups[index].append(group)
    return groups


def _shard(launch: Launch, name: str, people: Sequence[str]) -> Launch:
    people_only = {"people": tuple(people)}
    config = launch.config.model_copy(update=people_only)
    return replace(launch, name=name, config=config)
