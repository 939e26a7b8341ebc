"""Hover by brightness: lamps that are on change by a fifth, and return to what they were.

What a lamp reports is its answer to the hover, or the act of somebody else. The context of a report does not
tell them apart alone: for 5 s after a call Home Assistant gives the call's context also to a hand at the
wall, and a lamp that is polled answers with a new one. Thus:

- A lamp that still has the brightness before says nothing yet.
- The first report after the call is its answer, however rounded, unless the call of a user or of an
  automation caused it. Without a context of ours it must be within half a level of ten.
- Later reports of ours are equal to it, or come nearer to what was commanded (a lamp that fades).
- All else is the act of somebody else: the lamp is left as it is.
- What somebody else has set becomes the brightness before after `STANDING_S`, which is longer than a hover
  lasts. So no other site's hover does.

The brightness before is stored on disk before the lamp is changed, and erased when the lamp has it again. So
it returns also after the process or Home Assistant was killed.
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any, cast

from pydantic import BaseModel

from pointit.bridges.home_assistant.home_action import ServiceCall
from pointit.runtime.host.state_file import StateFile

MAX_BRIGHTNESS = 255
CHANGE = 0.2
MAX_ROUNDING = 13
"""Half a level of a dimmer with ten levels, in brightness."""
MAX_HOVER_S = 15.0
"""Time after which a lamp shows a hover no more, s."""
STANDING_S = 20.0
"""Time since others have set a lamp after which it shows a hover, s."""
RESTORE_TIMEOUT_S = 3.0
"""Time for the state of a lamp to show the brightness that it was given, s. Else it is given again."""
MAX_CONTEXTS = 4
MAX_EARLY_REPORTS = 16
UNKNOWN = ""
"""Context of a call whose result has not come."""


class DimmedLight(BaseModel):
    """Brightness of a lamp before the hover, and during it, 1 to 255."""

    before: int
    during: int
    shown: int | None = None
    """Brightness that the lamp reports for `during`, or None if it has not reported any."""
    contexts: tuple[str, ...] = ()
    """Contexts of the newest calls of the hover, `UNKNOWN` of one whose result has not come."""

    def is_answer(self, state: Mapping[str, Any], *, is_restored: bool) -> bool:
        """Return True if the lamp reports `state` by calls of the hover alone, or has not changed yet."""
        brightness = brightness_of(state)
        if brightness is None or brightness in (self.before, self.shown):
            return True
        context = context_of(state)
        is_ours = context.get("id") in self.contexts

        # First report: any of ours, or one near the command that no other call has caused
        if self.shown is None:
            if is_ours:
                return True
            if abs(brightness - self.during) > MAX_ROUNDING:
                return False
            has_caller = bool(context.get("user_id") or context.get("parent_id"))
            return not has_caller or UNKNOWN in self.contexts

        # Later reports: of ours, while the lamp fades to the hover or back
        if not is_ours:
            return False
        if is_restored and abs(brightness - self.before) < abs(self.shown - self.before):
            return True
        return self.is_nearer(brightness)

    def is_nearer(self, brightness: int) -> bool:
        """Return True if a brightness is nearer to that of the hover than what the lamp reported before."""
        if self.shown is None:
            return True
        return abs(brightness - self.during) < abs(self.shown - self.during)

    def shows_hover(self, brightness: int) -> bool:
        """Return True if a lamp with this brightness is not restored yet."""
        if self.shown is not None:
            return brightness == self.shown
        return abs(brightness - self.during) <= min(MAX_ROUNDING, abs(brightness - self.before))


class DimmedLights(BaseModel):
    """Lamps that a hover has changed, by entity."""

    lights: dict[str, DimmedLight] = {}


class HoverFeedback:
    """Calls that change the brightness of hovered lamps, and that restore it."""

    def __init__(self, file: StateFile[DimmedLights], now_s: Callable[[], float]) -> None:
        """Continue with the lamps in `file`. Raises ConfigError: it cannot be read."""
        self._file = file
        self._now_s = now_s
        self._lights = (file.read() or DimmedLights()).lights
        self._begin_s: dict[str, float] = {}
        """Time of the call that showed the hover, of lamps that show it."""
        self._restored_s: dict[str, float] = {}
        """Time of the call that restored a lamp, until its state shows that."""
        self._others_s: dict[str, float] = {}
        """Time of the last change of a lamp by others."""
        self._early_reports: dict[str, deque[Mapping[str, Any]]] = {}
        """Reports during a call: Home Assistant tells the context with the result, after them."""

    @property
    def entities(self) -> tuple[str, ...]:
        """Return the lamps that are not restored yet."""
        return tuple(self._lights)

    def reset(self) -> None:
        """Forget all but the file: the connection has ended."""
        self._begin_s.clear()
        self._restored_s.clear()
        self._others_s.clear()
        self._early_reports.clear()

    def is_over(self, entity: str) -> bool:
        """Return True if a lamp has shown the hover for the maximum time."""
        return self._now_s() - self._begin_s.get(entity, math.inf) >= MAX_HOVER_S

    def begin(self, entity: str, state: Mapping[str, Any]) -> ServiceCall | None:
        """Return the call that shows the hover on a lamp, or None if it cannot show it or shows it already.

        Raises:
            ConfigError: If the brightness cannot be stored.
        """
        before = brightness_of(state)
        if before is None or entity in self._begin_s:
            return None
        if not entity.startswith("light.") or _has_more_than_brightness(state):
            return None
        set_by_others_s = self._others_s.get(entity, -math.inf)
        if self._now_s() - set_by_others_s < STANDING_S:
            return None

        light = self._lights.get(entity)
        if light is None:
            light = DimmedLight(before=before, during=_hover_brightness(before))
        contexts = (*light.contexts, UNKNOWN)[-MAX_CONTEXTS:]
        self._store(entity, light.model_copy(update={"contexts": contexts}))
        self._restored_s.pop(entity, None)
        self._begin_s[entity] = self._now_s()
        self._early_reports[entity] = deque(maxlen=MAX_EARLY_REPORTS)
        return _set_brightness(entity, light.during)

    def end(
        self, entity: str, state: Mapping[str, Any], *, timeout_s: float = RESTORE_TIMEOUT_S
    ) -> ServiceCall | None:
        """Return the call that restores a lamp, or None if it needs none, or is off or unavailable now.

        What is stored is erased `timeout_s` after that call: many lamps answer before they report, first the
        brightness of the hover. Another hover meanwhile would take that for the brightness of before.

        Raises:
            ConfigError: If the file cannot be written.
        """
        light = self._lights.get(entity)
        brightness = brightness_of(state)
        self._begin_s.pop(entity, None)
        restored_s = self._restored_s.get(entity)
        if restored_s is not None and self._now_s() - restored_s < timeout_s:
            return None
        if light is None or brightness is None:
            self._restored_s.pop(entity, None)
            return None
        if restored_s is not None and not light.shows_hover(brightness):
            self._store(entity, None)
            return None
        self._early_reports.setdefault(entity, deque(maxlen=MAX_EARLY_REPORTS))
        return _set_brightness(entity, light.before)

    def on_result(self, call: ServiceCall, context: str) -> None:
        """Note that a call was carried out in `context`, or `UNKNOWN`. Raises ConfigError as `begin`."""
        light = self._lights.get(call.entity)
        reports = self._early_reports.pop(call.entity, ())
        if light is None:
            return
        is_restored = call.data["brightness"] == light.before
        if is_restored:
            self._restored_s[call.entity] = self._now_s()
        if context != UNKNOWN:
            contexts = (*light.contexts, context)
            if not is_restored:  # the result is that of the call whose context was unknown
                contexts = tuple(known for known in contexts if known != UNKNOWN)
            contexts = contexts[-MAX_CONTEXTS:]
            light = light.model_copy(update={"contexts": contexts})
        self._process_reports(call.entity, light, reports)

    def on_state(self, entity: str, before: Mapping[str, Any], state: Mapping[str, Any]) -> None:
        """Note a change of the state of a lamp. Raises ConfigError as `begin`."""
        light = self._lights.get(entity)
        early_reports = self._early_reports.get(entity)
        if early_reports is not None:
            early_reports.append(state)
        elif light is not None:
            self._process_reports(entity, light, (state,))
        elif entity.startswith("light.") and brightness_of(before) != brightness_of(state):
            self._others_s[entity] = self._now_s()

    def on_first_state(self, entity: str, state: Mapping[str, Any]) -> None:
        """Note the state of a lamp after a connection: what a call has set may be another site's hover."""
        has_caller = bool(context_of(state).get("user_id"))
        before = {} if has_caller else state
        self.on_state(entity, before, state)

    def _process_reports(self, entity: str, light: DimmedLight, reports: Iterable[Mapping[str, Any]]) -> None:
        """Store what a hovered lamp reports, or forget the lamp if others have set it."""
        for state in reports:
            if not light.is_answer(state, is_restored=entity in self._restored_s):
                self._others_s[entity] = self._now_s()
                self._begin_s.pop(entity, None)
                self._restored_s.pop(entity, None)
                self._store(entity, None)
                return
            brightness = brightness_of(state)
            if brightness is None or brightness == light.before:
                continue
            if light.is_nearer(brightness):
                light = light.model_copy(update={"shown": brightness})
        self._store(entity, light)

    def _store(self, entity: str, light: DimmedLight | None) -> None:
        """Store what is known of a lamp. None: it has its brightness again."""
        lights = dict(self._lights)
        lights.pop(entity, None)
        if light is not None:
            lights[entity] = light
        if lights != self._lights:
            self._file.write(DimmedLights(lights=lights))
            self._lights = lights


def _attributes(state: Mapping[str, Any]) -> Mapping[str, Any]:
    return cast("Mapping[str, Any]", state.get("attributes") or {})


def context_of(state: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the context of a state: `id`, `user_id`, `parent_id`."""
    context = state.get("context")
    return cast("Mapping[str, Any]", context) if isinstance(context, dict) else {}


def brightness_of(state: Mapping[str, Any]) -> int | None:
    """Return the brightness of a lamp that is on, 1 to 255, or None."""
    brightness = _attributes(state).get("brightness")
    if state.get("state") != "on" or type(brightness) is not int:
        return None
    return brightness if 1 <= brightness <= MAX_BRIGHTNESS else None


def _has_more_than_brightness(state: Mapping[str, Any]) -> bool:
    """Return True for groups, whose lamps may differ, and for effects, which a brightness may end."""
    attributes = _attributes(state)
    if "entity_id" in attributes:
        return True
    for name, value in attributes.items():
        if "group" in name and value:
            return True
    effect = attributes.get("effect") or "none"
    return str(effect).lower() not in ("none", "off", "solid")


def _hover_brightness(before: int) -> int:
    """Return the brightness of the hover: brighter, or darker where the lamp cannot be brighter."""
    brighter = max(round(before * (1 + CHANGE)), before + 1)
    if brighter <= MAX_BRIGHTNESS:
        return brighter
    return max(round(before * (1 - CHANGE)), 1)


def _set_brightness(entity: str, brightness: int) -> ServiceCall:
    return ServiceCall(entity, "light", "turn_on", {"brightness": brightness})
