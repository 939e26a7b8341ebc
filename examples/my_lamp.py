"""My lamp: it turns green when somebody selects something. Any other event gives it back to the site."""

import asyncio

import pointit


async def react(site: pointit.Site) -> None:
    """Set the lamp after every selection, for as long as the site is there."""
    lamp = site.lamp("led_2")
    async for event in site.selections():
        await lamp.set("#00c040" if event.event == "selected" else None)


async def main() -> None:
    """Join the site on this machine, such as that of `pointit run scenario_3`."""
    async with pointit.connect() as site:
        await react(site)


if __name__ == "__main__":
    asyncio.run(main())
