"""Machines of a load test and the tree of their routers; pure."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Machine:
    """A machine: a host of people, a router above them, or both."""

    name: str
    """`host 1`, or `above 1` for a router without people."""
    has_router: bool
    has_people: bool
    uplink: int
    """Index of the machine whose router it joins. That of the root is its own, 0."""


def tree(hosts: int, routers: int, fan: int) -> list[Machine]:
    """Return the machines, root first.

    Every router but the root joins another one, at most `fan` the same. People are at the last routers. With
    more routers than hosts, the others are above them, as those of a building and a campus. With fewer, hosts
    share routers.
    """
    above = max(0, routers - hosts)
    machines: list[Machine] = []
    for index in range(routers):
        has_people = index >= above
        name = f"above {index + 1}"
        if has_people:
            name = f"host {index - above + 1}"
        uplink = max(0, index - 1) // fan
        machines.append(Machine(name=name, has_router=True, has_people=has_people, uplink=uplink))

    # Hosts without a router of their own are spread over the routers in turn.
    for index in range(routers, hosts):
        name = f"host {index + 1}"
        uplink = index % routers
        machines.append(Machine(name=name, has_router=False, has_people=True, uplink=uplink))
    return machines


def router_of(machines: Sequence[Machine], index: int) -> int:
    """Return the index of the machine with the router that processes of a machine join."""
    machine = machines[index]
    return index if machine.has_router else machine.uplink


def spread(names: Sequence[str], machines: Sequence[Machine]) -> dict[int, list[str]]:
    """Return the people of each host, by the machine's index: evenly, in turn."""
    hosts = [index for index, machine in enumerate(machines) if machine.has_people]
    people: dict[int, list[str]] = {}
    for turn, index in enumerate(hosts):
        own_names = names[turn :: len(hosts)]
        people[index] = list(own_names)
    return people
