"""Calls to entities of one connection: the newest of each at a limited rate, and hover by brightness.

The brightness before is stored on disk before the lamp is changed, and erased when the lamp has it again. So
it returns also after the process or Home Assistant was killed.
"""

import asyncio
import contextlib
import logging
import math
from collections import Counter
from collections.abc import Callable, Collection, Generator, Mapping
from typing import Any, cast

from pydantic import BaseModel

from pointit.bridges.home_assistant.config import HomeAssistantConfig
from pointit.bridges.home_assistant.connection import HomeAssistantConnection, NoHomeAssistantError
from pointit.bridges.home_assistant.home_action import ServiceCall
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.errors import ConfigError, PointItError, RefusedError
from pointit.runtime.host.state_file import StateFile, site_folder

MAX_BRIGHTNESS = 255
CHANGE = 0.2
TOLERANCE = 4
"""Rounding of a lamp's brightness, which is often set in percent."""


class DimmedLight(BaseModel):
    """Brightness of a lamp before the hover, and during it, 1 to 255."""

    before: int
    during: int

    def is_own(self, brightness: int) -> bool:
        """Return True if a lamp with this brightness has been changed by the hover only, or not yet."""
        low, high = sorted((self.before, self.during))
        return low - TOLERANCE <= brightness <= high + TOLERANCE


class DimmedLights(BaseModel):
    """Lamps that a hover has changed, by entity."""

    lights: dict[str, DimmedLight] = {}


class HoverFeedback:
    """Calls that change the brightness of hovered lamps, and that restore it."""

    def __init__(self, file: StateFile[DimmedLights]) -> None:
        """Continue with the lamps in `file`. Raises ConfigError: it cannot be read."""
        self._file = file
        self._lights = (file.read() or DimmedLights()).lights

    @property
    def entities(self) -> tuple[str, ...]:
        """Return the lamps that are not restored yet."""
        return tuple(self._lights)

    def begin(self, entity: str, state: Mapping[str, Any]) -> ServiceCall | None:
        """Return the call that shows the hover on a lamp, or None if it cannot show it or shows it already.

        Raises:
            ConfigError: If the brightness cannot be stored.
        """
        brightness = _brightness(state)
        if brightness is None or not entity.startswith("light.") or _has_more_than_brightness(state):
            return None
        light = self._lights.get(entity)
        if light is not None and not light.is_own(brightness):  # somebody else has set it meanwhile
            light = None
        if light is None:
            brighter = max(round(brightness * (1 + CHANGE)), brightness + 1)
            during = brighter if brighter <= MAX_BRIGHTNESS else round(brightness * (1 - CHANGE))
            light = DimmedLight(before=brightness, during=max(during, 1))
            self._store({**self._lights, entity: light})
        elif abs(brightness - light.during) <= TOLERANCE:
            return None
        return _set_brightness(entity, light.during)

    def end(self, entity: str, state: Mapping[str, Any], *, is_sent: bool = False) -> ServiceCall | None:
        """Return the call that restores a lamp, or None if it needs none, or is off or unavailable now.

        Args:
            entity: the lamp.
            state: its state in Home Assistant.
            is_sent: that call was sent already. Then only a lamp that still shows the hover needs it again.

        Raises:
            ConfigError: If the file cannot be written.
        """
        light, brightness = self._lights.get(entity), _brightness(state)
        if light is None or brightness is None:
            return None
        shows_hover = abs(brightness - light.during) <= min(TOLERANCE, abs(brightness - light.before))
        if (is_sent and not shows_hover) or not light.is_own(brightness):
            self.forget(entity)
            return None
        return _set_brightness(entity, light.before)

    def forget(self, entity: str) -> None:
        """Erase what is stored of a lamp: it has its brightness again. Raises ConfigError as `begin`."""
        if entity in self._lights:
            self._store({name: light for name, light in self._lights.items() if name != entity})

    def _store(self, lights: dict[str, DimmedLight]) -> None:
        self._file.write(DimmedLights(lights=lights))
        self._lights = lights


def _attributes(state: Mapping[str, Any]) -> Mapping[str, Any]:
    return cast("Mapping[str, Any]", state.get("attributes") or {})


def _brightness(state: Mapping[str, Any]) -> int | None:
    """Return the brightness of a lamp that is on, or None."""
    brightness = _attributes(state).get("brightness")
    return brightness if state.get("state") == "on" and isinstance(brightness, int) and brightness else None


def _has_more_than_brightness(state: Mapping[str, Any]) -> bool:
    """Return True for groups, whose lamps may differ, and for effects, which a brightness may end."""
    attributes = _attributes(state)
    is_group = "entity_id" in attributes or attributes.get("is_hue_group") is True
    return is_group or str(attributes.get("effect") or "none").lower() not in ("none", "off")


def _set_brightness(entity: str, brightness: int) -> ServiceCall:
    return ServiceCall(entity, "light", "turn_on", {"brightness": brightness})


log = logging.getLogger(__name__)

END_TIMEOUT_S = 1.0
"""Maximum time to restore lamps at the end, s."""
RESTORE_TIMEOUT_S = 3.0
"""Time for the state of a lamp to show the brightness that it was given, s. Else it is given again."""
MAX_COMMAND_DELAY_S = 1.0
"""Time beyond the maximum latency for which a hover may delay the commands to its lamp, s."""
MAX_SLOW_CALLS = 2
"""Number of slow calls in a row after which a lamp shows no hover."""


class EntityCommands:
    """Sends calls to entities while a connection is open."""

    def __init__(
        self,
        config: HomeAssistantConfig,
        bus: ServiceBus,
        states: Callable[[str], Mapping[str, Any]],
        hovered: Callable[[], Collection[str]],
    ) -> None:
        """Continue with the lamps that an earlier process has not restored.

        Args:
            config: parameters of the service.
            bus: gets warnings.
            states: returns the state of an entity in Home Assistant, empty if it is not there.
            hovered: returns the entities that somebody hovers.
        """
        self._config = config
        self._bus = bus
        self._state_of = states
        self._hovered = hovered
        self._connection: HomeAssistantConnection | None = None
        self._pending: dict[str, tuple[str, ServiceCall]] = {}
        """Newest call of each entity that is not sent yet, with the parameter to correct if it fails."""
        self._acted: set[str] = set()
        """Entities that were switched during this hover, which show it no more."""
        self._slow_calls: Counter[str] = Counter()
        """Number of slow calls in a row by lamp."""
        self._restored_s: dict[str, float] = {}
        """Time at which a lamp was given its brightness of before the hover, until its state shows it."""
        self._workers: dict[str, asyncio.Task[None]] = {}
        self._feedback: HoverFeedback | None = None
        with self._reported():
            file = site_folder(bus.site, "home-assistant") / "dimmed_lights.json"
            self._feedback = HoverFeedback(StateFile[DimmedLights].at(file, DimmedLights))

    @property
    def is_connected(self) -> bool:
        """Return True if calls can be sent."""
        return self._connection is not None

    def open(self, connection: HomeAssistantConnection) -> None:
        """Send by `connection` from now on."""
        self._connection = connection

    async def close(self, connection: HomeAssistantConnection, *, is_lost: bool) -> None:
        """Stop, and restore all lamps unless the connection is lost."""
        self._connection = None
        workers = list(self._workers.values())
        for worker in workers:
            worker.cancel()
        await asyncio.gather(*workers, return_exceptions=True)
        self._workers.clear()  # one that was cancelled before its first step is still there
        self._pending.clear()
        if not is_lost:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(END_TIMEOUT_S):
                    await asyncio.gather(*(self._restore_at_end(connection, each) for each in self._dimmed()))
        self._restored_s.clear()

    def send(self, call: ServiceCall, parameter: str) -> None:
        """Send `call`, instead of one of the same entity that waits. `parameter`: its origin, for errors."""
        self._pending[call.entity] = (parameter, call)
        self._acted.add(call.entity)
        self.wake(call.entity)

    def drop(self, entity: str) -> None:
        """Do not send the call to an entity that waits."""
        self._pending.pop(entity, None)

    def check(self) -> None:
        """Look at all lamps that show a hover or shall show it. Called periodically."""
        hovered = set(self._hovered())
        self._acted &= hovered
        for entity in {*self._dimmed(), *hovered}:
            self.wake(entity)

    def wake(self, entity: str) -> None:
        """Send what there is to send to an entity, unless that is being done."""
        if self._connection is None or entity in self._workers:
            return
        work = self._work(self._connection, entity)
        self._workers[entity] = asyncio.create_task(work, name=f"calls to {entity}")

    def _dimmed(self) -> tuple[str, ...]:
        return self._feedback.entities if self._feedback is not None else ()

    async def _work(self, connection: HomeAssistantConnection, entity: str) -> None:
        """Send calls to an entity, at a limited rate, until it is as it shall be."""
        try:
            while await self._send_next(connection, entity):  # noqa: ASYNC110 - no wait, a rate
                await asyncio.sleep(1.0 / self._config.rate_hz)
        except NoHomeAssistantError:  # the connection is opened again
            return
        finally:  # at once: what is woken now needs another task
            self._workers.pop(entity, None)

    async def _send_next(self, connection: HomeAssistantConnection, entity: str) -> bool:
        """Send the next call to an entity. Return False if there is none."""
        if entity in self._pending:
            await self._restore(connection, entity)  # first: the lamp has its brightness when it is on
            parameter, call = self._pending.pop(entity)
            try:
                await connection.call(call)
            except (RefusedError, TimeoutError) as error:
                self._bus.warn(
                    "actions",
                    f"Home Assistant did not run {call.domain}.{call.service} on {entity} "
                    f"({str(error) or 'no answer'}): correct {parameter}",
                    entity,
                )
            else:
                self._bus.clear("actions", entity)
            return True
        is_slow = self._slow_calls[entity] >= MAX_SLOW_CALLS
        if entity in self._hovered() and entity not in self._acted and not is_slow:
            return await self._show_hover(connection, entity)
        return await self._restore(connection, entity)

    async def _show_hover(self, connection: HomeAssistantConnection, entity: str) -> bool:
        """Show the hover on a lamp. Return False if it shows it already, or cannot."""
        self._restored_s.pop(entity, None)
        call = None
        if self._feedback is not None:
            with self._reported():
                call = self._feedback.begin(entity, self._state_of(entity))
        if call is None:
            return False
        loop = asyncio.get_running_loop()
        begin_s = loop.time()
        limit_s = self._config.max_hover_latency_s
        with contextlib.suppress(RefusedError, TimeoutError):
            async with asyncio.timeout(limit_s + MAX_COMMAND_DELAY_S):
                await connection.call(call)
        latency_s = loop.time() - begin_s
        self._slow_calls[entity] = self._slow_calls[entity] + 1 if latency_s > limit_s else 0
        if self._slow_calls[entity] == MAX_SLOW_CALLS:
            log.warning(
                "%s takes %.1f s, limit %g s: it shows no hover; raise `max_hover_latency_s` to use it",
                *(entity, latency_s, limit_s),
            )
        return True

    async def _restore_at_end(self, connection: HomeAssistantConnection, entity: str) -> None:
        """Restore a lamp, and erase what is stored once its state shows that."""
        while await self._restore(connection, entity, timeout_s=0.0):  # noqa: ASYNC110 - a rate, no wait
            await asyncio.sleep(1.0 / self._config.rate_hz)

    async def _restore(
        self, connection: HomeAssistantConnection, entity: str, *, timeout_s: float = RESTORE_TIMEOUT_S
    ) -> bool:
        """Give a lamp its brightness of before the hover. Return False if it has it, or is off now.

        What is stored is erased `timeout_s` later: many lamps answer before they report, first the
        brightness of the hover. Another hover meanwhile would take that for the brightness of before.
        """
        now_s = asyncio.get_running_loop().time()
        sent_s = self._restored_s.get(entity, -math.inf)
        if self._feedback is None or now_s - sent_s < timeout_s:
            return False
        call = None
        with self._reported():
            call = self._feedback.end(entity, self._state_of(entity), is_sent=entity in self._restored_s)
        if call is None:
            self._restored_s.pop(entity, None)
            return False
        try:
            await connection.call(call)
        except (PointItError, TimeoutError):  # tried again by the next check
            return False
        self._restored_s[entity] = now_s
        return True

    @contextlib.contextmanager
    def _reported(self) -> Generator[None]:
        """Report a file that cannot be read or written."""
        try:
            yield
            self._bus.clear("hover")
        except ConfigError as error:
            self._bus.warn("hover", f"lamps show no hover: {error}")
