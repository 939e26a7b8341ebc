"""What who joins a site takes over from it: the scenario that runs there, a place and colour still free."""

import asyncio
from collections.abc import Collection, Sequence
from typing import cast

from pointit.access.rights import ALL, Role, rights_of
from pointit.cli.launches import CURSOR_COLORS
from pointit.cli.link import joined
from pointit.cli.scenario import scenario_names
from pointit.runtime.bus import Bus
from pointit.runtime.ending import run_async
from pointit.runtime.errors import ConfigError, ConnectError
from pointit.runtime.link_options import given_credentials
from pointit.schemas import Deployment, UserProfile
from pointit.schemas.base import Rgb
from pointit.schemas.topics import DEPLOYMENT, PROFILE, USER_ALIVE

USUAL = "scenario_4"
"""What is run where none is named, and whose parameters a person has where no shipped one runs."""
LISTEN_S = 0.3
"""So long is listened; what is there is told at once."""

Found = tuple[str, int]
"""A scenario, and a place of it, from 1 on."""


def check_person(name: str) -> None:
    """Refuse to be the person `name` by credentials of which the router would refuse everything.

    Raises:
        ConfigError: the running command's credentials are somebody else's.
    """
    credentials = given_credentials()
    if credentials is None:
        return
    link = credentials.link
    if {ALL, USER_ALIVE.at(name)}.isdisjoint(rights_of(cast("Role", link.role), link.name).announces):
        raise ConfigError(
            f"--credentials {credentials.folder}: these are of {link.name} (role {link.role}), who may not "
            f"take part as {name}; use those of {name}, made with `pointit site user add {name}`"
        )


def look_round(site: str, connect: Sequence[str]) -> Found | None:
    """Return which scenario runs on a site and which place is free; none when interrupted.

    Where nobody answers it is the usual scenario's first place: who runs it may come later.
    """
    found: list[Found] = []

    async def look() -> int:
        try:
            async with joined(site, connect) as bus:
                found.append(await surroundings(bus))
        except ConnectError:
            found.append((USUAL, 1))
        return 0

    run_async(look())
    return found[0] if found else None


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
