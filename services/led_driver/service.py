"""Subscribes to the map, cursors, objects and their states; publishes and outputs every strip's pixels.

It is the only writer of lamps, and decides which person may localize by which of them.
"""

import asyncio
import functools
from collections import Counter
from operator import attrgetter
from typing import ClassVar

from pointit.geometry.colormap import UnknownColormapError
from pointit.runtime.clock import Timer
from pointit.runtime.errors import RefusedError
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import (
    NS_PER_S,
    Cursor,
    Done,
    Environment,
    Hover,
    LampColor,
    LampLeases,
    Localization,
    Selection,
    SetBrightness,
    SetLamp,
    ShowPixels,
    TrackedObjects,
    UserProfile,
    topics,
)
from pointit.schemas.base import Rgb
from pointit.schemas.pointing import LINES
from pointit.services.led_driver.config import LedDriverConfig
from pointit.services.led_driver.lamps import DARK, LampService
from pointit.services.led_driver.light_state import FrameLimiter, LightState
from pointit.services.led_driver.outputs import GuardedOutput, make_outputs

LAMP_PERIOD_S = 1 / 20
"""Minimum time between changes of a lamp's appearance, s. The lamp that a person is to point at, and that of
a thing at which they begin to point, is lit at once."""
LOCALIZER = "localizer."
"""First part of the instance of a person's localizer, before the user."""


class LedDriver(Service[LedDriverConfig]):
    """Draws cursors, objects and their state on the LED strips whenever something changes."""

    NAME: ClassVar[str] = "led-driver"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = LedDriverConfig

    def __init__(self, config: LedDriverConfig, context: Context) -> None:
        """Create without opening a port.

        Raises:
            ConfigError: If an output lacks its port, or two share one.
        """
        super().__init__(config, context)
        # State of the lights, and what draws it when it changes or expires
        self._lights = LightState(config)
        self._frame_limiter = FrameLimiter(config.max_rate_hz, config.patience_s)
        self._frame_timer = Timer(self.bus.call_later, self._draw)
        self._expiry_timer = Timer(self.bus.call_later, self._expire)
        self._lamp_timer = Timer(self.bus.call_later, self._publish_lamps)
        self._shown_timer = Timer(self.bus.call_later, self._schedule_frame)

        # Lamps and the leases of their users, as last published
        self._lamps_s = -LAMP_PERIOD_S
        lamp_publisher = functools.partial(self.bus.publisher, topics.LAMP_COLOR)
        self._lamp = functools.cache(lamp_publisher)
        self._lit: dict[str, Rgb] = {}
        """Last published colours of the lamps."""
        self._lamp_seqs = Counter[str]()
        self._lamp_service = LampService()
        """Leases and targets as last published."""
        self._lease_seq = 0

        # Outputs, and the publishers of what they show
        self._ended = False
        self._outputs = make_outputs(config.outputs, self.surroundings, self.bus)
        self._changed: list[GuardedOutput] = []
        """Outputs to which the last frame was sent that changed any."""
        self._beams = [output for output in self._outputs if output.follows_cursors]
        self._beamed = set[str]()
        """People whose cursors are on beams."""
        self._frames = self.bus.publisher(topics.STRIPS_FRAME, timed=not self._outputs)
        self._leases = self.bus.publisher(topics.LAMP_LEASES)
        for name in ("brightness", "default brightness"):
            self.bus.set_metric(name, config.brightness)
        self._leases.put(LampLeases(stamp_ns=self.clock.now_ns()))  # replaces a crashed instance's

        # Requests and messages: from here on the methods below may be called
        self.bus.serve(topics.SET_BRIGHTNESS, self._set_brightness)
        self.bus.serve(topics.SET_LAMP, self._set_lamp)
        self.bus.serve(topics.SHOW_PIXELS, self._show_pixels)
        self.bus.watch(topics.USER_ALIVE, self._on_person)
        self.bus.watch(topics.SERVICE_ALIVE, self._on_service)
        self.bus.subscribe(topics.MAP, self._on_map)
        self.bus.subscribe(topics.PROFILE, self._on_profile)
        self.bus.subscribe(topics.SELECTION, self._on_selection)
        self.bus.subscribe(topics.LOCALIZATION, self._on_localization)
        self.bus.subscribe(topics.OBJECTS, self._on_objects)
        self.bus.subscribe(topics.HOVER, self._on_hover)
        # a cursor without a point removes what was shown, which is never too late
        self.bus.subscribe(topics.CURSOR, self._on_cursor, drops_late=attrgetter("point_m"))

    async def run(self) -> None:
        """Run the outputs. Drawing is triggered by messages. Switches the lamps off at the end."""
        try:
            async with asyncio.TaskGroup() as group:
                for output in self._outputs:
                    group.create_task(output.run(), name="led-driver output")
                await asyncio.Event().wait()
        finally:
            self._ended = True
            for timer in (self._frame_timer, self._expiry_timer, self._lamp_timer, self._shown_timer):
                timer.cancel()
            self._publish_colors(dict.fromkeys(self._lit, DARK))

    def _on_map(self, environment: Environment, _name: str) -> None:
        try:
            self._lights.on_map(environment)
        except ValueError as error:
            self.bus.warn(
                "map", f"map {environment.name}: a strip or belt cannot be drawn ({error}); correct the map"
            )
            return
        self.bus.clear("map")
        for output in self._outputs:
            output.set_map(environment)
        self._schedule_frame()
        self._publish_lamps()

    def _on_profile(self, profile: UserProfile, user: str) -> None:
        try:
            self._lights.content.set_profile(user, profile)
        except UnknownColormapError as error:
            self.bus.warn("profile", f"profile of {user}: {error}; the cursor's colour is shown", user)
        else:
            self.bus.clear("profile", user)
        self._schedule_frame()
        if self._lights.things.lamps:
            self._schedule_lamps_in(0.0)

    def _on_selection(self, selection: Selection, _name: str) -> None:
        self._lights.content.set_selection(selection)
        self._schedule_frame()
        if self._lights.things.set_selection(selection):
            self._publish_lamps()

    def _on_objects(self, objects: TrackedObjects, tracker: str) -> None:
        self._lights.content.set_objects(tracker, objects, self.clock.now_ns())
        self._schedule_frame()

    def _on_hover(self, hover: Hover, user: str) -> None:
        now_ns = self.clock.now_ns()
        if self._lights.content.set_hover(user, hover, now_ns):
            self._schedule_frame()
        if self._lights.things.lamps:
            change = self._lights.things.on_hover(user, hover, now_ns)
            if change == "lamps":
                self._publish_lamps()
            elif change == "level":
                self._schedule_lamps_in(0.0)

    def _on_cursor(self, cursor: Cursor, user: str) -> None:
        # only a cursor on a line is drawn at once, so that no other delays it
        if self._lights.on_cursor(user, cursor, self.clock.now_ns()):
            self._schedule_frame(fresh=cursor.surface in LINES)
        self._schedule_lamps()
        if self._beams and not self._ended:
            self._beamed.add(user)
            self._show_on_beams(user, cursor)
            self._watch_expiry(self.clock.now_ns())

    def _show_on_beams(self, user: str, cursor: Cursor | None) -> None:
        color = self._lights.content.cursor_color(user)
        for output in self._beams:
            output.show_cursor(user, cursor, color)

    def _on_localization(self, localization: Localization, user: str) -> None:
        self._lights.lamps.queue.on_localization(user, localization, self.clock.now_ns())
        self._share_lamps()

    def _on_person(self, user: str, *, present: bool) -> None:
        if not present:
            self._lights.lamps.queue.leave(user)
            self._share_lamps()

    def _on_service(self, instance: str, *, present: bool) -> None:
        if instance.startswith(LOCALIZER):
            self._on_person(instance.removeprefix(LOCALIZER), present=present)

    async def _set_brightness(self, query: SetBrightness, _name: str) -> Done:
        try:
            self._lights.set_brightness(query.brightness, query.strips)
        except ValueError as error:
            raise RefusedError(str(error)) from error
        self.bus.set_metric("brightness", self._lights.brightness)
        self._schedule_frame()
        quantity = "strips' brightness"
        if query.strips:
            quantity = f"brightness of {', '.join(query.strips)}"
        return Done(message=f"the {quantity} is {query.brightness:.0%} now")

    async def _set_lamp(self, query: SetLamp, lamp_id: str) -> Done:
        try:
            self._lights.lamps.set_color(lamp_id, query.color)
        except ValueError as error:
            raise RefusedError(str(error)) from error
        self._schedule_lamps_in(0.0)
        if query.color is None:
            return Done(message=f"lamp {lamp_id} is given back")

        # A localization and the state of the lamp's thing have precedence over the colour
        color = f"#{bytes(query.color).hex()}"
        leases = self._lights.lamps.queue.service().leases
        people = [lease.user for lease in leases if not lease.ahead]
        things = self._lights.things
        colors_of_things = things.colors(self.clock.now_ns())
        shown = colors_of_things.get(lamp_id, query.color)
        if people:
            users = ", ".join(people)
            return Done(message=f"lamp {lamp_id} shows {color} once {users} need no lamps any more")
        if shown == query.color:
            return Done(message=f"lamp {lamp_id} shows {color}")
        shown_color = f"#{bytes(shown).hex()}"
        reason = things.reason(lamp_id)
        return Done(message=f"lamp {lamp_id} shows {shown_color}, as {reason}; {color} when that ends")

    async def _show_pixels(self, query: ShowPixels, _name: str) -> Done:
        duration_ns = int(query.for_s * self.clock.speed * NS_PER_S)
        until_ns = self.clock.now_ns() + duration_ns
        try:
            self._lights.show(query.lit, until_ns)
        except ValueError as error:
            raise RefusedError(str(error)) from error
        self._shown_timer.cancel()
        self._shown_timer.start(query.for_s)
        self._draw()  # at once: the caller waits for the light
        return Done(message=f"shown for {query.for_s:g} s")

    def _schedule_frame(self, *, fresh: bool = False) -> None:
        """Schedule a frame, at once if a `fresh` cursor came and the rate allows."""
        if self._ended:  # messages that arrive during shutdown
            return
        wait_s = self._frame_limiter.request_frame(asyncio.get_running_loop().time(), fresh=fresh)
        if wait_s == 0.0:
            self._draw()
        elif wait_s is not None:
            self._frame_timer.start(wait_s)

    def _draw(self) -> None:
        self._frame_timer.cancel()
        self._frame_limiter.drawn(asyncio.get_running_loop().time())
        now_ns = self.clock.now_ns()
        light_s = max((output.light_s for output in self._changed), default=0.0)
        frame = self._lights.frame(now_ns, light_s)
        if frame is None:
            return
        self._frames.put(frame)

        # Every output gets the frame. Only those that it has changed count for the latency of the next: that
        # of the others is of a frame long ago
        age_s = (now_ns - frame.stamp_ns) / NS_PER_S / self.clock.speed
        changed = [output for output in self._outputs if output.show(frame, age_s)]
        if changed:
            self._changed = changed

        # Beams of people whose cursor has expired with this frame go dark
        for user in self._beamed - self._lights.content.people_with_cursors:
            self._beamed.remove(user)
            self._show_on_beams(user, None)
        self._watch_expiry(now_ns)

    def _share_lamps(self) -> None:
        """Publish the lamps if leases or targets have changed. Otherwise their colours may change, later."""
        if self._lights.lamps.queue.service() != self._lamp_service:
            self._publish_lamps()
        else:
            self._schedule_lamps()

    def _schedule_lamps(self) -> None:
        if self._lights.lamps.follow_people:
            self._schedule_lamps_in(0.0)

    def _schedule_lamps_in(self, wait_s: float) -> None:
        if not self._ended:
            now_s = asyncio.get_running_loop().time()
            rest_of_period_s = self._lamps_s + LAMP_PERIOD_S - now_s
            self._lamp_timer.start(max(wait_s, rest_of_period_s, 0.0))

    def _publish_lamps(self) -> None:
        self._lamp_timer.cancel()
        if self._ended:
            return
        self._lamps_s = asyncio.get_running_loop().time()
        now_ns = self.clock.now_ns()

        # Colours first: they drop localizations that have expired, which the leases then lack
        self._publish_colors(self._lights.lamps.colors(now_ns))
        previous = self._lamp_service
        self._lamp_service = self._lights.lamps.queue.service()
        leases = self._lamp_service.leases
        if leases != previous.leases:
            self._lease_seq += 1
            self._leases.put(LampLeases(stamp_ns=now_ns, seq=self._lease_seq, leases=leases))

        # Again when a colour changes without a message
        change_ns = self._lights.lamps.next_change_ns()
        if change_ns is not None:
            wait_s = (change_ns - now_ns) / NS_PER_S / self.clock.speed
            self._schedule_lamps_in(wait_s)

    def _publish_colors(self, colors: dict[str, Rgb]) -> None:
        """Publish the colours that changed. Lamps that go off come first, so that a target is lit alone."""
        for lamp_id, color in sorted(colors.items(), key=lambda lamp: lamp[1] != DARK):
            if self._lit.get(lamp_id) == color:
                continue
            self._lamp_seqs[lamp_id] += 1
            seq = self._lamp_seqs[lamp_id]
            lamp_color = LampColor(stamp_ns=self.clock.now_ns(), seq=seq, color=color)
            self._lamp(lamp_id).put(lamp_color)
            for output in self._outputs:
                output.show_lamp(lamp_id, color)
        self._lit = colors

    def _watch_expiry(self, now_ns: int) -> None:
        """Schedule a frame for the next expiry or blink. There is one timer, which checks again."""
        end_ns = self._lights.content.next_change_ns()
        if end_ns is None:
            return
        wait_s = (end_ns - now_ns) / NS_PER_S / self.clock.speed
        self._expiry_timer.start(wait_s)

    def _expire(self) -> None:
        now_ns = self.clock.now_ns()
        end_ns = self._lights.content.next_change_ns()
        if end_ns is not None and end_ns <= now_ns:
            self._schedule_frame()
        else:
            self._watch_expiry(now_ns)


SERVICE = LedDriver
