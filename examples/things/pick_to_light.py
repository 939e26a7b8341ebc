"""Pick to light: a lamp shows the next box until somebody points at that box."""

import asyncio
from collections.abc import Sequence

import pointit


async def pick(site: pointit.Site, order: Sequence[str]) -> None:
    """Show one box of `order` after the other."""
    pointed = site.pointed()
    for box in order:
        await site.lamp(box).set("#00ff00")
        async for event in pointed:
            if event.thing == box:
                print(f"{event.user} takes {box}")
                break
            print(f"{event.user} takes {event.thing}, wanted is {box}")
        await site.lamp(box).set(None)


async def main() -> None:
    """Join the site on this machine: `pointit run examples/things/pick_to_light.yaml`."""
    async with pointit.connect() as site:
        await pick(site, ["nuts", "screws", "nuts", "bolts"])


if __name__ == "__main__":
    asyncio.run(main())
