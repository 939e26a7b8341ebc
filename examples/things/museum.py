"""A museum: what people point at speaks, one exhibit at a time, and not twice within a minute."""

import asyncio

import pointit

TEXTS = {
    "amphora": "It held oil from Attica.",
    "coin": "It paid a legionary for a day.",
    "statue": "She lost her spear in a storm.",
}


async def guide(site: pointit.Site) -> None:
    """Tell of each exhibit that somebody points at."""
    told_ns: dict[str, int] = {}
    async for event in site.pointed(*TEXTS):
        since_told_ns = event.stamp_ns - told_ns.get(event.thing, 0)
        if since_told_ns > 60e9:
            told_ns[event.thing] = event.stamp_ns
            print(f"{event.user}: {TEXTS[event.thing]}")  # or a loudspeaker's program


async def main() -> None:
    """Join the site on this machine: `pointit run examples/things/museum.yaml`."""
    async with pointit.connect() as site:
        await guide(site)


if __name__ == "__main__":
    asyncio.run(main())
