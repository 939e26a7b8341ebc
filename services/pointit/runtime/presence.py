"""Who is there: asked once, where nobody needs to watch."""

import asyncio

from pointit.runtime.bus import Bus
from pointit.schemas.topics import Presence


async def present(bus: Bus, presence: Presence, wait_s: float) -> set[str]:
    """Return the names that are present now, as far as they are known after `wait_s` (ms on one machine).

    Whoever is about to announce a name asks first, and refuses one that is in use.
    """
    names: set[str] = set()

    def tell(name: str, is_present: bool) -> None:  # noqa: FBT001 - the handler's own signature
        (names.add if is_present else names.discard)(name)

    watching = bus.watch(presence, tell)
    try:
        await asyncio.sleep(wait_s)
    finally:
        watching.close()
    return names
