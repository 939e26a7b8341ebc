"""Hover by brightness: lamps that are on change by a fifth, and return to what they were.

The brightness before is stored on disk before the lamp is changed, and erased when the lamp has it again. So
it returns also after the process or Home Assistant was killed.
"""

from collections.abc import Mapping
from typing import Any, cast

from pydantic import BaseModel

from pointit.bridges.home_assistant.home_action import ServiceCall
from pointit.runtime.host.state_file import StateFile

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
