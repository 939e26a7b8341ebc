"""What runs on a site that a person joins: the scenario, and which place and colour are free."""

import asyncio
from collections.abc import Collection

from pointit.launch.plan.launches import CURSOR_COLORS
from pointit.launch.plan.scenario import scenario_names
from pointit.runtime.bus.contract import Bus
from pointit.schemas import Deployment, UserProfile
from pointit.schemas.base import Rgb
from pointit.schemas.topics import DEPLOYMENT, PROFILE

USUAL = "scenario_4"
"""What is run where none is named, and whose parameters a person has where no shipped one runs."""

LISTEN_S = 0.3
"""So long is listened; what is there is told at once."""

Found = tuple[str, int]
"""A scenario, and a place of it, from 1 on."""


async def surroundings(bus: Bus) -> Found:
    """Return which scenario runs on a site that was joined, and which place is free."""
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
    """Return the first place, from 1 on, whose cursor's colour nobody has yet; else one after all."""
    free = (place for place, color in enumerate(CURSOR_COLORS, 1) if color not in colors)
    return next(free, len(colors) + 1)
