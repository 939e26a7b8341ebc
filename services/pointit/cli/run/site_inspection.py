"""What who joins a site takes over from it: the scenario that runs there, a place and colour still free."""

from collections.abc import Sequence
from typing import cast

from pointit.access.rights import ALL, Role, rights_of
from pointit.cli.common.site_link import join_site
from pointit.launch.run.surroundings import USUAL, Found, surroundings
from pointit.runtime.errors import ConfigError, ConnectError
from pointit.runtime.link.options import given_credentials
from pointit.runtime.service.shutdown import run_until_shutdown
from pointit.schemas.topics import USER_ALIVE


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


def inspect_site(site: str, connect: Sequence[str]) -> Found | None:
    """Return which scenario runs on a site and which place is free; none when interrupted.

    Where nobody answers it is the usual scenario's first place: who runs it may come later.
    """
    found: list[Found] = []

    async def look() -> int:
        try:
            async with join_site(site, connect) as bus:
                found.append(await surroundings(bus))
        except ConnectError:
            found.append((USUAL, 1))
        return 0

    run_until_shutdown(look())
    return found[0] if found else None
