"""Settings that a person who joins takes from the site: running scenario, free place and colour."""

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
    """Check that the credentials are for the person `name`, or the router would reject everything.

    Raises:
        ConfigError: If the running command's credentials are another's.
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
    """Return the scenario on a site and a free place, or None if interrupted.

    Without a reply it is the default scenario's first place: its run may start later.
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
