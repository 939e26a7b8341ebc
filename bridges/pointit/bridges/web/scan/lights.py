"""Lights of the site that blink for a scan: pixels of strips, and single lamps."""

import asyncio
import logging
from collections.abc import Collection, Sequence

from pointit.runtime.bus.contract import Bus
from pointit.runtime.errors import RefusedError
from pointit.schemas import LitPixels, SetLamp, ShowPixels
from pointit.schemas.base import Rgb
from pointit.schemas.topics import SET_LAMP, SHOW_PIXELS

log = logging.getLogger(__name__)

DARK: Rgb = (0, 0, 0)
TIMEOUT_S = 1.0
"""Limit of the time until a lamp shows what it was set to, s: the LED driver limits its flashes."""


class ScanLights:
    """Shows pixels, and gives strips and lamps back after a while."""

    def __init__(self, bus: Bus) -> None:
        """Create without lamps."""
        self._bus = bus
        self._names: frozenset[str] = frozenset()
        self._set: dict[str, Rgb] = {}
        """Colours that lamps were set to."""
        self._colors: dict[str, Rgb] = {}
        """Colours that lamps show."""
        self._changed = asyncio.Event()
        self._back: asyncio.Task[None] | None = None

    def set_lamps(self, names: Collection[str]) -> None:
        """Set the names of the lamps that blink. In lit pixels, pixel 0 of such a name is the lamp."""
        self._names = frozenset(names)
        self._set.clear()

    def hear(self, name: str, color: Rgb) -> None:
        """Note that lamp `name` shows `color`."""
        self._colors[name] = color
        self._changed.set()

    async def show(self, lit: Sequence[LitPixels], for_s: float) -> None:
        """Show the pixels `lit` and no others for a time, and return when they are shown. 0 s gives all back.

        Raises:
            RefusedError: If there is no such light, or the LED driver does not answer.
        """
        strips = tuple(each for each in lit if each.id not in self._names)
        await self._bus.call(SHOW_PIXELS, ShowPixels(lit=strips, for_s=for_s))
        self.close()
        if for_s == 0.0:
            await self._give_back(0.0)
            return
        if not self._names:
            return
        self._back = asyncio.create_task(self._give_back(for_s), name="lamps of a scan")
        wanted = dict.fromkeys(self._names, DARK) | {
            each.id: each.color for each in lit if each not in strips
        }
        for name, color in wanted.items():
            if self._set.get(name) != color:
                try:
                    await self._bus.call(SET_LAMP, SetLamp(color=color), name)
                    self._set[name] = color
                except RefusedError as error:  # it shows the state of the site
                    log.warning("the camera cannot find lamp %s: %s", name, error)
                    self._names -= {name}
        try:
            async with asyncio.timeout(TIMEOUT_S):
                while any(
                    self._colors.get(name, DARK) != wanted[name] for name in self._names & wanted.keys()
                ):
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            pass  # somebody localizes by it: the camera does not see it change

    def close(self) -> None:
        """Give no lamps back later."""
        if self._back is not None:
            self._back.cancel()
            self._back = None

    async def _give_back(self, after_s: float) -> None:
        await asyncio.sleep(after_s)
        while self._set:
            name, _ = self._set.popitem()
            await self._bus.call(SET_LAMP, SetLamp(color=None), name)
