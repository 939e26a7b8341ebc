"""Lamps that were off and are lit while it is their turn, and that go off again. Pure but for its file.

The rules are those of `hover_feedback`: what a lamp was is stored on disk before it changes, so that it
returns also after a kill; and a lamp that somebody else sets meanwhile is left as it is. A lamp that was on
shows its turn by its brightness instead, as a hover.
"""

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from pointit.bridges.home_assistant.home_action import ServiceCall
from pointit.bridges.home_assistant.hover_feedback import UNKNOWN, context_of
from pointit.runtime.host.state_file import StateFile

OFF = "off"
ON = "on"


class LitLight(BaseModel):
    """A lamp that was lit, by a call with a context; `was_seen` on since then."""

    context: str = UNKNOWN
    was_seen: bool = False


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

    def begin(self, entity: str, state: Mapping[str, Any]) -> ServiceCall | None:
        """Return the call that lights a lamp, or None if it is not off, or is lit. Raises ConfigError."""
        if not entity.startswith("light.") or entity in self._lights:
            return None
        if state.get("state") != OFF:
            return None
        self._store(entity, LitLight())
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
        if light is None or state.get("state") not in (ON, OFF):
            return None
        if state.get("state") == OFF:
            if light.was_seen or is_late:
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
