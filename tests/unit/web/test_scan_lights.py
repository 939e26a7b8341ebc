"""Strips and lamps that blink for a scan."""

import asyncio

from pointit.bridges.web.scan.session import ScanLights
from pointit.runtime.errors import RefusedError
from pointit.schemas import Done, LitPixels, SetLamp, ShowPixels
from pointit.schemas.base import Rgb
from pointit.schemas.topics import SET_LAMP, SHOW_PIXELS
from tests.support.bench import memory_bench

RED: Rgb = (255, 0, 0)


async def test_lamps_show_their_colour_first_and_are_given_back() -> None:
    async with memory_bench() as bench:
        pixels: list[ShowPixels] = []
        lamps: list[tuple[str, Rgb | None]] = []
        lights = ScanLights(bench.bus)
        lights.set_lamps(["door", "state"])

        async def show(query: ShowPixels, _name: str) -> Done:
            pixels.append(query)
            return Done()

        async def set_lamp(query: SetLamp, name: str) -> Done:
            if name == "state":
                raise RefusedError("it shows the state of the site")
            lamps.append((name, query.color))
            return Done()

        bench.bus.serve(SHOW_PIXELS, show)
        bench.bus.serve(SET_LAMP, set_lamp)
        lit = [LitPixels(id=name, pixels=(0,), color=RED) for name in ("shelf", "door")]
        showing = asyncio.create_task(lights.show(lit, 6.0))
        await asyncio.sleep(0.5)
        assert [each.id for each in pixels[0].lit] == ["shelf"]
        assert lamps == [("door", RED)]
        assert not showing.done(), "the LED driver has not shown it yet"
        lights.hear("door", RED)
        await showing
        await lights.show(lit, 6.0)
        assert lamps == [("door", RED)], "it shows it already"
        await asyncio.sleep(6.5)
        assert lamps[1:] == [("door", None)]

        await lights.show(lit, 6.0)
        await lights.show((), 0.0)
        assert lamps[2:] == [("door", RED), ("door", None)]
