"""The light of the lamp whose turn it is, or of one that shows which one it is.

No core: it switches lamps, and waits for them.
"""

import asyncio
import contextlib
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from pointit.bridges.home_assistant.hover_feedback import UNKNOWN
from pointit.bridges.home_assistant.setup.lit_lights import NO_STATE, LitLights
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.errors import ConfigError, RefusedError

if TYPE_CHECKING:
    from pointit.bridges.home_assistant.home_connection import HomeConnection

BLINK_S = 1.0
"""Time for which a lamp that is on is brighter, and then is not, s."""
NO_REPORT_S = 4.0
"""Time at its turn after which a lamp that has reported no state is lit without, s."""
FOLLOW_S = 5.0
"""Time for a lamp to report that it is lit, s."""


class TurnLight:
    """Lights one lamp at a time, and restores it afterwards."""

    def __init__(
        self,
        lit: LitLights,
        bus: ServiceBus,
        *,
        state_of: Callable[[str], Mapping[str, Any]],
        wake: Callable[[str], None],
        wanted: Callable[[], tuple[str, bool]],
    ) -> None:
        """Create it.

        Args:
            lit: lamps that were off and are lit.
            bus: gets warnings.
            state_of: returns the state of an entity, empty if it is not known.
            wake: called with an entity whose hover may have changed.
            wanted: returns the entity that is to be lit, or `""`, and whether it is its turn.
        """
        self.lamp = ""
        """Entity of the lamp that is to be lit."""
        self._lit = lit
        self._bus = bus
        self._state_of = state_of
        self._wake = wake
        self._wanted = wanted
        self._loop = asyncio.get_running_loop()
        self._silent_s = -math.inf
        """Time since which it is to be lit on this connection, and has had no state."""
        self._ended_s: dict[str, float] = {}
        """Time at which the turn of a lit lamp was over."""

    def begin(self) -> None:
        """Begin with a new connection."""
        self.lamp = ""

    @property
    def hovered(self) -> set[str]:
        """Return the lamp that is brighter now because it is its turn."""
        lamp = self.lamp
        if not lamp or lamp in self._lit.entities:
            return set()
        is_brighter = int(self._loop.time() / BLINK_S) % 2 == 0
        return {lamp} if is_brighter else set()

    async def update(self, connection: "HomeConnection") -> None:
        """Light the lamp whose turn it is, and end the light of those whose turn is over."""
        now_s = self._loop.time()
        previous = self.lamp
        self.lamp, is_turn = self._wanted()
        state = self._state_of(self.lamp)
        if self.lamp != previous or state.get("state") != NO_STATE:
            self._silent_s = now_s

        # Without a state it cannot be restored: not for a look at the list, nor while it may still report
        may_be_unknown = is_turn and now_s - self._silent_s >= NO_REPORT_S
        for entity in {previous, self.lamp} - {""}:
            self._wake(entity)
        try:
            if self.lamp:
                call = self._lit.begin(self.lamp, state, may_be_unknown=may_be_unknown)
                if call is not None:
                    context = UNKNOWN
                    with contextlib.suppress(RefusedError, TimeoutError):
                        context = await connection.call(call)
                    self._lit.on_result(call.entity, context)
            for entity in self._lit.entities:
                await self._end_light(connection, entity)
        except ConfigError as error:
            self._bus.warn("setup", f"lamps are not lit: {error}")

    async def _end_light(self, connection: "HomeConnection", entity: str) -> None:
        """Switch a lamp off again whose turn is over."""
        if entity == self.lamp:
            self._ended_s.pop(entity, None)
            return
        now_s = self._loop.time()
        ended_s = self._ended_s.setdefault(entity, now_s)
        call = self._lit.end(entity, self._state_of(entity), is_late=now_s - ended_s > FOLLOW_S)
        if call is not None:
            with contextlib.suppress(RefusedError, TimeoutError):
                await connection.call(call)
                self._lit.on_ended(entity, self._state_of(entity))
        if entity not in self._lit.entities:
            self._ended_s.pop(entity, None)
