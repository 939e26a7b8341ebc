"""Entities of Home Assistant: their states, and the actions that switch them. Pure."""

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, Self

SWITCH_ACTIONS: Mapping[str, tuple[str, str]] = {
    "cover": ("open_cover", "close_cover"),
    "lock": ("unlock", "lock"),
    "valve": ("open_valve", "close_valve"),
    "vacuum": ("start", "return_to_base"),
}
"""Actions that switch on and off, of domains that have no `turn_on` and `turn_off`."""
SLOW_DOMAINS = frozenset(("cover", "lock", "vacuum", "valve"))
"""Domains of entities that take up to a minute to follow."""
RUN_ACTIONS: Mapping[str, str] = {
    "automation": "trigger",
    "button": "press",
    "input_button": "press",
    "scene": "turn_on",
    "script": "turn_on",
}
"""Actions of domains that are run, and have no state of their own that is on or off."""
OFF_STATES = frozenset(("off", "closed", "closing", "standby", "locked", "locking", "docked", "returning"))
UNAVAILABLE = "unavailable"
NO_STATES = frozenset((UNAVAILABLE, "unknown"))


@dataclass(frozen=True)
class ServiceCall:
    """An action of Home Assistant on one entity."""

    entity: str
    domain: str
    service: str
    data: Mapping[str, Any] = field(default_factory=dict[str, Any])


@dataclass(frozen=True)
class HomeAction:
    """Entity of a thing, and the action that pointing at it runs, or `""` if it is switched."""

    entity: str
    action: str = ""
    data: Mapping[str, Any] = field(default_factory=dict[str, Any])

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the action in `Thing.home_assistant`: an entity, or JSON with the fields of this class."""
        if text.startswith("{"):
            return cls(**json.loads(text))
        return cls(text)

    @property
    def domain(self) -> str:
        """Return the kind of the entity: `light`."""
        return self.entity.partition(".")[0]

    def is_of(self, actions: Collection[str]) -> bool:
        """Return True if the action is of the entity's domain, a scene or script, or one of `actions`."""
        domain, _, _ = self.action.partition(".")
        return domain in (self.domain, "scene", "script") or self.action in actions

    def call(self, *, on: bool | None) -> ServiceCall:
        """Return the call that switches the entity. `on`: None if its state is not known, or it has none."""
        if self.action and on is not False:
            domain, _, service = self.action.partition(".")
            return ServiceCall(self.entity, domain, service, self.data)
        if self.domain in RUN_ACTIONS:
            return ServiceCall(self.entity, self.domain, RUN_ACTIONS[self.domain])
        turn_on, turn_off = SWITCH_ACTIONS.get(self.domain, ("turn_on", "turn_off"))
        domain = "homeassistant" if self.domain == "group" else self.domain
        if on is None:
            return ServiceCall(self.entity, domain, "toggle")
        return ServiceCall(self.entity, domain, turn_on if on else turn_off)

    def is_on(self, state: str | None) -> bool | None:
        """Return True if an entity with this state is on, None if that is unknown or it has no such state."""
        if state is None or state in NO_STATES:
            return None
        if self.domain in RUN_ACTIONS:
            return None
        return state not in OFF_STATES
