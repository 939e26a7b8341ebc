"""Settings that a person who joins takes from the site: running scenario, free place and colour."""

from collections.abc import Sequence

from pointit.cli.common.site_link import join_site
from pointit.launch.run.surroundings import USUAL, Found, surroundings
from pointit.runtime.errors import ConnectError
from pointit.runtime.service.shutdown import run_until_shutdown


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
