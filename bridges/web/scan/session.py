"""One scan of the room: the lights that blink, the views so far, and what the solver makes of them.

No core: it waits for pictures and lights.
"""

import asyncio
import logging
import math
import re
from collections import Counter
from collections.abc import Awaitable, Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

from pointit.bridges.web.model.site_model import shown_path, with_shown_path
from pointit.bridges.web.scan.wire import (
    MAX_LIGHTS,
    ScanBegin,
    ScanLight,
    ScanLook,
    ScanSave,
    ScanState,
    ScanStrip,
    ScanThing,
    ScanUndo,
    ScanView,
)
from pointit.geometry.vector import Vec3
from pointit.maps.edit import write_new
from pointit.runtime.bus.contract import Bus
from pointit.runtime.errors import ConfigError, PointItError, RefusedError
from pointit.scan.views import (
    CameraView,
    KnownLength,
    LampSpec,
    Mark,
    StripSighting,
    StripSpec,
    Survey,
    check_survey,
)
from pointit.schemas import LitPixels, SetLamp, ShowPixels, Strip
from pointit.schemas.base import Rgb
from pointit.schemas.topics import SET_LAMP, SHOW_PIXELS, check_name

log = logging.getLogger(__name__)

Show = Callable[[Sequence[LitPixels], float], Awaitable[None]]
"""Shows pixels of strips, and no others, for a time, s. Raises RefusedError."""

DARK: Rgb = (0, 0, 0)
LIGHTS_TIMEOUT_S = 1.0
"""Limit of the time until a lamp shows what it was set to, s: the LED driver limits its flashes."""

COLORS: tuple[Rgb, ...] = ((255, 0, 0), (0, 255, 0), (0, 0, 255))
MARKS = 10
"""Marked pixels of a strip, its ends included. Three determine a line, the others find wrong numbers."""

SHOWN_S = 6.0
"""Time after which the strips are given back if the page asks for nothing more, s."""
MAX_VIEWS = 40
ADVICE = (
    "Stand where the camera sees most of the strips, and take the first view.",
    "Step a metre to the side, keep the strips in the picture, and take the second view.",
)
"""Advice before the first and second view. Then the solver has one."""
CHANGED = "the strips have changed meanwhile: load the page again"
FILE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,58}\.ya?ml")


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
        strips = tuple(light for light in lit if light.id not in self._names)
        await self._bus.call(SHOW_PIXELS, ShowPixels(lit=strips, for_s=for_s))
        self.close()
        if for_s == 0.0:
            await self._give_back(0.0)
            return
        if not self._names:
            return

        # Lamps have no time of their own: a task gives them back, even if the page asks for nothing more
        self._back = asyncio.create_task(self._give_back(for_s), name="lamps of a scan")
        colors = dict.fromkeys(self._names, DARK)
        for light in lit:
            if light not in strips:
                colors[light.id] = light.color
        for name, color in colors.items():
            if self._set.get(name) == color:
                continue
            try:
                await self._bus.call(SET_LAMP, SetLamp(color=color), name)
                self._set[name] = color
            except RefusedError as error:  # it shows the state of the site
                log.warning("the camera cannot find lamp %s: %s", name, error)
                self._names -= {name}

        try:
            async with asyncio.timeout(LIGHTS_TIMEOUT_S):
                while not self._shows(colors):
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            pass  # a localization uses the lamp: the camera does not see it change

    def _shows(self, colors: Mapping[str, Rgb]) -> bool:
        """Return True if the lamps that blink show `colors`."""
        for name in self._names & colors.keys():
            if self._colors.get(name, DARK) != colors[name]:
                return False
        return True

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


def marked_pixels(count: int) -> tuple[int, ...]:
    """Return the numbers of marked pixels of a strip of `count` pixels, ends included, evenly spread."""
    marks = min(count, MARKS)
    intervals = max(1, marks - 1)
    return tuple(round(number * (count - 1) / intervals) for number in range(marks))


def picture(
    lights: Sequence[tuple[str, int]], colors: Sequence[int], brightness: float
) -> tuple[LitPixels, ...]:
    """Return the lit pixels of `lights` (strip and pixel), of which each has one of `COLORS`, dimmed."""
    pixels_by_color: dict[tuple[str, int], list[int]] = {}
    for (name, pixel), color in zip(lights, colors, strict=True):
        pixels_by_color.setdefault((name, color), []).append(pixel)
    lit: list[LitPixels] = []
    for (name, color), pixels in pixels_by_color.items():
        rgb = _dimmed(COLORS[color], brightness)
        lit.append(LitPixels(id=name, pixels=tuple(pixels), color=rgb))
    return tuple(lit)


def _dimmed(color: Rgb, brightness: float) -> Rgb:
    red, green, blue = (round(brightness * value) for value in color)
    return red, green, blue


@dataclass(frozen=True, kw_only=True)
class ScanSolution:
    """Result of the solver."""

    strips: tuple[ScanStrip, ...]
    cameras_m: tuple[Vec3, ...] = ()
    is_complete: bool = False
    advice: str = ""
    next_m: Vec3 | None = None
    """Place of the camera for the next view, if one is advised."""
    thing: Callable[[ScanThing], ScanStrip] | None = None
    """Returns a thing by its corners. Raises RefusedError."""
    map_text: Callable[[str, Sequence[ScanThing]], str] = field(default=lambda _origin, _things: "")
    """Returns the map with its origin at a strip, and with things, as YAML. Raises PointItError."""


Solve = Callable[[Survey], Awaitable[ScanSolution]]
"""Solves views. Raises PointItError if they determine nothing yet."""


class ScanSession:
    """The scan of one room. Not for several cameras at once: the last one that begins has it."""

    def __init__(self, *, show: Show, solve: Solve, file: Path) -> None:
        """Create without strips.

        Args:
            show: shows pixels on the strips.
            solve: solves views.
            file: suggested path of the map. One of another name is written to the same folder.
        """
        self._show = show
        self._solve = solve
        self._folder = file.absolute().parent
        self._file = file.name
        self._counts: dict[str, int] = {}
        self._leds_per_m: dict[str, float] = {}
        self._settings = ScanBegin()
        self._lights: tuple[tuple[str, int], ...] = ()
        self._views: list[CameraView] = []
        self._things: dict[str, ScanThing] = {}
        self._solution: ScanSolution | None = None
        self._solving: asyncio.Task[None] | None = None
        self._problem = ""
        self._saved = ""

    def set_strips(self, counts: Mapping[str, int], leds_per_m: Mapping[str, float] | None = None) -> None:
        """Set the strips of the site's map, their numbers of pixels, and pixels per metre if known.

        One with a single pixel is a point: a lamp. Other strips, or numbers, begin a new scan.
        """
        self._leds_per_m = dict(leds_per_m or {})
        if dict(counts) != self._counts:
            self._counts = dict(counts)
            self._restart(ScanBegin())

    def take(self, message: ScanBegin | ScanView | ScanUndo | ScanThing | ScanLook) -> None:
        """Begin, add a view or a thing, or forget the last view.

        Raises:
            PointItError: If the message is impossible, of other lights, or too much. One sentence.
            KeyNameError: If a thing's name is unusable.
        """
        match message:
            case ScanBegin():
                self._begin_scan(message)
            case ScanView():
                self._add_view(message)
            case ScanUndo():
                self._remove_last_view()
            case ScanThing():
                self._store_thing(message)
            case ScanLook():
                pass

    def _begin_scan(self, message: ScanBegin) -> None:
        if max(self._counts.values(), default=0) < 2:
            raise RefusedError(
                "the map of the site has no strips: add them with their numbers of pixels, anywhere in the "
                "room, or start `pointit map scan -o FILE --strip NAME=PIXELS`"
            )
        names = list(message.leds_per_m)
        if message.known_strip:
            names.append(message.known_strip)
        for name in names:
            if name not in self._counts:
                raise RefusedError(f"there is no strip {name!r}; there are {', '.join(self._counts)}")
        self._restart(message)

    async def light(self, message: ScanLight) -> None:
        """Show the lights, or give them back.

        Raises:
            RefusedError: If there are other lights than that, or they cannot show it.
        """
        if message.colors and len(message.colors) != len(self._lights):
            raise RefusedError(CHANGED)
        lights = self._lights if message.colors else ()
        lit = picture(lights, message.colors or (), message.brightness)
        await self._show(lit, 0.0 if message.colors is None else SHOWN_S)

    def _add_view(self, message: ScanView) -> None:
        if len(self._views) >= MAX_VIEWS:
            raise RefusedError(f"{MAX_VIEWS} views are enough: save the map, or begin again")
        if any(index >= len(self._lights) for index, _, _ in message.seen):
            raise RefusedError(CHANGED)
        sightings: list[StripSighting] = []
        for index, u, v in message.seen:
            name, pixel = self._lights[index]
            sightings.append(StripSighting(name, pixel, u, v))
        view = CameraView(message.width, message.height, tuple(sightings), message.gravity)
        survey = self._survey(())
        try:
            check_survey(survey.strips, survey.lamps, (view,))
        except ConfigError as error:
            raise RefusedError(str(error)) from error
        self._views.append(view)
        self._begin_to_solve()

    def _remove_last_view(self) -> None:
        """Remove the last view, and the things that were tapped in it."""
        if self._views:
            self._views.pop()
            for name, thing in list(self._things.items()):
                taps = chain.from_iterable(thing.corners)
                if any(view >= len(self._views) for view, _, _ in taps):
                    del self._things[name]
        self._begin_to_solve()

    def _store_thing(self, message: ScanThing) -> None:
        check_name(message.name)
        if not message.corners:
            self._things.pop(message.name, None)
            return
        if self._solution is None or self._solution.thing is None:
            raise RefusedError("nothing is known yet: take two views or more first")
        self._solution.thing(message)
        self._things[message.name] = message

    def map_text(self, origin: str) -> str:
        """Return the map of what is known, as YAML.

        Raises:
            RefusedError: If nothing is known yet.
        """
        if self._solution is None or not any(strip.line_m for strip in self._solution.strips):
            raise RefusedError("nothing is known yet: take two views or more first")
        try:
            return self._solution.map_text(origin, tuple(self._things.values()))
        except PointItError as error:
            raise RefusedError(str(error)) from error

    def save(self, message: ScanSave) -> None:
        """Write the map to a new file.

        Raises:
            PointItError: If its name is unusable, the file exists, or nothing is known yet.
        """
        name = message.name
        if not name.endswith((".yaml", ".yml")):
            name = f"{name}.yaml"
        if not FILE_NAME.fullmatch(name):
            raise RefusedError(f"{message.name!r} is no name for a map: use letters, digits, - and _")
        text = self.map_text(message.origin)
        path = self._folder / name
        try:
            write_new(path, text)
        except ConfigError as error:
            raise RefusedError(with_shown_path(str(error), path)) from error
        self._saved = shown_path(path)
        log.info("the scanned map is in %s: check it with `pointit map check %s`", path, path)

    def state(self, *, is_simulated: bool = False) -> ScanState:
        """Return the state for a page."""
        solution = self._solution or ScanSolution(strips=())

        # Lights, as far as the solver knows them, then things
        solved = {strip.name: strip for strip in solution.strips}
        views_by_light = Counter[str]()
        for view in self._views:
            views_by_light.update({sighting.name for sighting in view.sightings})
        strips: list[ScanStrip] = []
        for name, count in self._lights_of_scan(self._settings).items():
            strip = solved.get(name, ScanStrip(name=name, pixels=count))
            fields = {"seen": views_by_light[name], "leds_per_m": self._leds_per_m.get(name)}
            strips.append(strip.model_copy(update=fields))
        strips.extend(map(self._known_thing, self._things.values()))

        advice = solution.advice
        if len(self._views) < len(ADVICE):
            advice = ADVICE[len(self._views)]
        return ScanState(
            strips=tuple(strips),
            lights=self._lights,
            cameras_m=solution.cameras_m,
            views=len(self._views),
            is_solving=self._solving is not None,
            is_complete=solution.is_complete,
            advice=advice,
            next_m=solution.next_m,
            problem=self._problem,
            is_simulated=is_simulated,
            file=self._file,
            saved=self._saved,
        )

    async def close(self) -> None:
        """Stop solving."""
        if self._solving is not None:
            self._solving.cancel()
            await asyncio.gather(self._solving, return_exceptions=True)

    def _known_thing(self, thing: ScanThing) -> ScanStrip:
        try:
            if self._solution is not None and self._solution.thing is not None:
                return self._solution.thing(thing)
        except RefusedError as error:
            return ScanStrip(name=thing.name, pixels=0, reason=str(error))
        return ScanStrip(name=thing.name, pixels=0)

    def _restart(self, settings: ScanBegin) -> None:
        self._settings = settings
        self._views.clear()
        self._things.clear()
        self._solution = None
        self._problem = ""
        self._saved = ""
        lights: list[tuple[str, int]] = []
        for name, count in self._lights_of_scan(settings).items():
            for pixel in marked_pixels(count):
                lights.append((name, pixel))
        self._lights = tuple(lights[:MAX_LIGHTS])

    def _lights_of_scan(self, settings: ScanBegin) -> dict[str, int]:
        """Return the number of pixels of each strip, and of each lamp if lamps are scanned, too."""
        if settings.has_lamps:
            return self._counts
        return {name: count for name, count in self._counts.items() if count > 1}

    def _survey(self, views: tuple[CameraView, ...]) -> Survey:
        leds_per_m = self._settings.leds_per_m
        strips: list[StripSpec] = []
        for name, count in self._counts.items():
            if count > 1:
                pitch_m = 1.0 / leds_per_m[name] if name in leds_per_m else None
                strips.append(StripSpec(name, count, pitch_m))

        # The length that the person has measured is that between the ends of a strip
        known_length = None
        known_strip = self._settings.known_strip
        if known_strip and self._settings.known_m is not None:
            last = self._counts[known_strip] - 1
            known_length = KnownLength(Mark(known_strip, 0), Mark(known_strip, last), self._settings.known_m)
        lamps = tuple(LampSpec(name) for name, _ in self._lights if self._counts[name] == 1)
        return Survey(tuple(strips), lamps, views, known_length)

    def _begin_to_solve(self) -> None:
        if self._solving is None:
            self._solving = asyncio.create_task(self._solve_all(), name="scan")

    async def _solve_all(self) -> None:
        """Solve until no view has come meanwhile."""
        views: tuple[CameraView, ...] | None = None
        try:
            while views != tuple(self._views):
                views = tuple(self._views)
                self._problem = ""
                if len(views) < 2:
                    self._solution = None
                    continue
                # Until there is another one, the page shows the solution of fewer views
                try:
                    self._solution = await self._solve(self._survey(views))
                except PointItError as error:
                    self._problem = str(error)
        except Exception:  # a later view may be solved
            log.exception("the views could not be solved")
            self._problem = "the views could not be solved, a fault of PointIt itself, see its log"
        finally:
            self._solving = None


def leds_per_m(strips: Sequence[Strip]) -> dict[str, float]:
    """Return the pixels per metre of each of `strips` that has a length, to 0.1."""
    densities: dict[str, float] = {}
    for strip in strips:
        length_m = sum(map(math.dist, strip.line_m, strip.line_m[1:]))
        if 1.0 < strip.pixels / max(length_m, 1e-9) <= 1000.0:
            densities[strip.id] = round(strip.pixels / length_m, 1)
    return densities
