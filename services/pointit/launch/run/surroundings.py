"""State of a site that a person joins: the running scenario, and a free place and colour."""

import asyncio
from collections.abc import Collection

from pointit.launch.plan.launches import CURSOR_COLORS
from pointit.launch.plan.scenario import scenario_names
from pointit.runtime.bus.contract import Bus
from pointit.schemas import Deployment, UserProfile
from pointit.schemas.base import Rgb
from pointit.schemas.topics import DEPLOYMENT, PROFILE

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


def free_place(colors: Collection[Rgb]) -> int:
    """Return the first place, from 1, whose cursor colour is unused, or the one after the last."""
    free = (place for place, color in enumerate(CURSOR_COLORS, 1) if color not in colors)
    return next(free, len(colors) + 1)
