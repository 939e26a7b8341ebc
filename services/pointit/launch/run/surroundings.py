"""State of a site that a person joins: the running scenario, and a free place and colour."""

import asyncio
from collections.abc import Collection

from pointit.launch.plan.launches import CURSOR_COLORS
from pointit.launch.plan.scenario import scenario_names
from pointit.runtime.bus.contract import Bus, list_present
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.instance_takeover import SILENT_S
from pointit.schemas import Deployment, UserProfile
from pointit.schemas.base import Rgb
from pointit.schemas.system import SHARDED, instance_of
from pointit.schemas.topics import DEPLOYMENT, PROFILE, SERVICE_ALIVE, SHARD_ALIVE

USUAL = "scenario_4"
"""Default scenario, also the source of a person's parameters if the site runs no shipped one."""

LISTEN_S = 0.3
"""Time to listen; retained state arrives at once."""

Found = tuple[str, int]
"""A scenario, and a place of it, from 1 on."""


async def surroundings(bus: Bus) -> Found:
    """Return the scenario of a joined site, and a free place."""
    running: dict[str, str] = {}
    colors: dict[str, Rgb] = {}

    def on_deployment(deployment: Deployment, name: str) -> None:
        running[name] = deployment.believed(name).scenario

    def on_profile(profile: UserProfile, user: str) -> None:
        colors[user] = profile.cursor_color

    listening = (bus.subscribe(DEPLOYMENT, on_deployment), bus.subscribe(PROFILE, on_profile))
    try:
        await asyncio.sleep(LISTEN_S)
    finally:
        for subscription in listening:
            subscription.close()
    shipped = sorted(set(running.values()) & set(scenario_names()))
    return (shipped[0] if len(shipped) == 1 else USUAL), free_place(colors.values())


async def check_names(bus: Bus, people: Collection[str]) -> None:
    """Check that no shard of others is called like one of `people`, who could take its place.

    It takes `LISTEN_S`, and `SILENT_S` more if one is: it may be dead, or about to serve such a person.

    Raises:
        ConfigError: If there is such a shard.
    """
    taken = {instance_of(service, person): person for service in sorted(SHARDED) for person in people}
    for wait_s in (LISTEN_S, SILENT_S):
        there, serving = await asyncio.gather(
            list_present(bus, SERVICE_ALIVE, wait_s), list_present(bus, SHARD_ALIVE, wait_s)
        )
        taken = {shard: person for shard, person in taken.items() if shard in there - serving}
        if not taken:
            return
    for shard, person in taken.items():
        raise ConfigError(
            f"{person}: {shard} on site {bus.site} is a shard that serves nobody of this name; choose another"
        )


def free_place(colors: Collection[Rgb]) -> int:
    """Return the first place, from 1, whose cursor colour is unused, or the one after the last."""
    free = (place for place, color in enumerate(CURSOR_COLORS, 1) if color not in colors)
    return next(free, len(colors) + 1)
