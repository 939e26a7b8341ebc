"""Lamps that were off and are lit while it is their turn, and that go off again. Pure but for its file.

The rules are those of `hover_feedback`: what a lamp was is stored on disk before it changes, so that it
returns also after a kill; and a lamp that somebody else sets meanwhile is left as it is. A lamp that was on
shows its turn by its brightness instead, as a hover. One that reports no state cannot be restored: it is lit
all the same, and is off afterwards.
"""

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from pointit.bridges.home_assistant.home_action import ServiceCall
from pointit.bridges.home_assistant.hover_feedback import UNKNOWN, context_of
from pointit.runtime.host.state_file import StateFile

OFF = "off"
ON = "on"
NO_STATE = "unknown"


class LitLight(BaseModel):
    """A lamp that was lit, by a call with a context; `was_seen` on since then.

    `was_unknown`: it had reported no state before.
    """

    context: str = UNKNOWN
    was_seen: bool = False
    was_unknown: bool = False


class LitLightsFile(BaseModel):
    """Lamps that are to go off again, by entity."""

    lights: dict[str, LitLight] = {}


class LitLights:
    """Calls that light lamps that are off, and that switch them off again."""

    def __init__(self, file: StateFile[LitLightsFile]) -> None:
        """Continue with the lamps in `file`. Raises ConfigError: it cannot be read."""
        self._file = file
        self._lights = (file.read() or LitLightsFile()).lights

    @property
    def entities(self) -> tuple[str, ...]:
        """Return the lamps that are to go off again."""
        return tuple(self._lights)

    def was_unknown(self, entity: str) -> bool:
        """Return True for a lamp that was lit and had reported no state before."""
        light = self._lights.get(entity)
        return light is not None and light.was_unknown

    def begin(
        self, entity: str, state: Mapping[str, Any], *, may_be_unknown: bool = False
    ) -> ServiceCall | None:
        """Return the call that lights a lamp, or None if it is not off, or is lit. Raises ConfigError.

        `may_be_unknown`: light also a lamp that reports no state.
        """
        if not entity.startswith("light.") or entity in self._lights:
            return None
        reported = state.get("state")
        is_unknown = may_be_unknown and reported == NO_STATE
        if reported != OFF and not is_unknown:
            return None
        self._store(entity, LitLight(was_unknown=is_unknown))
        return ServiceCall(entity, "light", "turn_on")

    def on_result(self, entity: str, context: str) -> None:
        """Note the context in which a lamp was lit."""
        light = self._lights.get(entity)
        if light is not None:
            self._store(entity, light.model_copy(update={"context": context}))

    def on_state(self, entity: str, state: Mapping[str, Any]) -> None:
        """Update from the state of a lamp. One that another user or automation has set is left to them."""
        light = self._lights.get(entity)
        if light is None:
            return

        # Off: another user has switched it, unless it has not followed yet
        if state.get("state") == OFF and light.was_seen:
            self._store(entity, None)
            return
        if state.get("state") != ON:
            return

        # On: by our call, or by another user to whom it belongs from now on
        context = context_of(state)
        has_caller = bool(context.get("user_id") or context.get("parent_id"))
        is_ours = context.get("id") == light.context or light.context == UNKNOWN
        if has_caller and not is_ours:
            self._store(entity, None)
        elif not light.was_seen:
            self._store(entity, light.model_copy(update={"was_seen": True}))

    def on_first_state(self, entity: str, state: Mapping[str, Any]) -> None:
        """Note the state of a lamp after a connection: one that is off needs nothing."""
        if entity in self._lights and state.get("state") == OFF:
            self._store(entity, None)

    def end(self, entity: str, state: Mapping[str, Any], *, is_late: bool = False) -> ServiceCall | None:
        """Return the call that switches a lamp off again, or None if it is off or unavailable now.

        `is_late`: a lamp that is still off since it was lit will not follow any more.
        """
        light = self._lights.get(entity)
        if light is None:
            return None
        if light.was_unknown and state.get("state") == NO_STATE:
            return self._end_unknown(entity, is_late=is_late)
        if state.get("state") not in (ON, OFF):
            return None
        if state.get("state") == OFF:
            if light.was_seen or is_late:
                self._store(entity, None)
            return None
        return ServiceCall(entity, "light", "turn_off")

    def on_ended(self, entity: str, state: Mapping[str, Any]) -> None:
        """Note that a lamp was told to go off. One that reports no state is left at that."""
        if self.was_unknown(entity) and state.get("state") == NO_STATE:
            self._store(entity, None)

    def _end_unknown(self, entity: str, *, is_late: bool) -> ServiceCall | None:
        if is_late:  # it was told, and that failed
            self._store(entity, None)
            return None
        return ServiceCall(entity, "light", "turn_off")

    def _store(self, entity: str, light: LitLight | None) -> None:
        lights = dict(self._lights)
        lights.pop(entity, None)
        if light is not None:
            lights[entity] = light
        if lights != self._lights:
            self._file.write(LitLightsFile(lights=lights))
            self._lights = lights
