"""Topics and messages of things on an MQTT broker, with the discovery of Home Assistant. Pure.

https://www.home-assistant.io/integrations/mqtt, "MQTT discovery", "Event", "Switch" and "Device trigger".
"""

import json
import re
import zlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

from pointit.runtime.host.extras import pointit_version
from pointit.schemas import SelectedObject, SelectionEvent
from pointit.schemas.environment import Thing

SET = "/set"
"""End of the topic of a switch's commands, `ON` and `OFF`."""
EVENT = "/event"
"""End of the topic of a switch's events."""
NOT_OF_IDS = re.compile(r"[^A-Za-z0-9_-]")
EVENTS = {"selected": "pointed", "deselected": "released"}
"""Types of events of things by the event of the selection."""
PRESSED = "pointed button"
TRIGGERS = {"pointed": "pointed", "pressed": PRESSED, "released": "released"}
"""Payloads of the triggers of a device by type: pointed at, confirmed by a press, let go by its owner."""


@dataclass(frozen=True, kw_only=True)
class Publication:
    """A message to the broker."""

    topic: str
    payload: str
    retain: bool = False


@dataclass(frozen=True)
class Announcements:
    """Topics and messages of one site."""

    site: str
    prefix: str = "homeassistant"
    """First levels of the topics of the discovery."""

    @property
    def birth_topic(self) -> str:
        """Return the topic of Home Assistant's birth message, `online`."""
        return f"{self.prefix}/status"

    @property
    def status_topic(self) -> str:
        """Return the topic that is `online` while things are published."""
        return f"pointit/{_id_of(self.site)}/status"

    @property
    def found(self) -> str:
        """Return the topic filter of earlier announcements for this site."""
        return f"{self.prefix}/+/{self._node}/+/config"

    @property
    def all_states(self) -> str:
        """Return the filter of states of switches."""
        return f"pointit/{_id_of(self.site)}/things/+"

    @property
    def commands(self) -> str:
        """Return the filter of commands to switches."""
        return self.all_states + SET

    def command(self, things: Sequence[Thing], topic: str, payload: object) -> tuple[str, bool] | None:
        """Return a switch among `things` and the state that a message commands, or None if it does not."""
        if not isinstance(payload, bytes) or payload not in (b"ON", b"OFF"):
            return None
        for thing in things:
            command_topic = self._topic(thing.id) + SET
            if thing.mode == "switch" and command_topic == topic:
                return (thing.id, payload == b"ON")
        return None

    @property
    def _node(self) -> str:
        return f"pointit_{_id_of(self.site)}"

    def discovery(self, thing: Thing) -> list[Publication]:
        """Return the announcements of a thing: a switch or events, and the triggers of its device."""
        topic = self._topic(thing.id)
        common: dict[str, Any] = {
            "device": {
                "identifiers": [self._node],
                "name": f"PointIt {self.site}",
                "manufacturer": "PointIt",
            },
            "origin": {"name": "PointIt", "sw_version": pointit_version()},
        }

        # The thing itself
        config: dict[str, Any] = {
            "name": thing.label or thing.id,
            "unique_id": f"{self._node}_{_id_of(thing.id)}",
            "state_topic": topic,
            **common,
        }
        if thing.mode == "switch":
            config |= {
                "availability_topic": self.status_topic,
                "value_template": "{{ value_json.state }}",
                "json_attributes_topic": topic,
                "command_topic": topic + SET,
            }
        else:  # without availability: an event that is available again looks like one that happens
            config["event_types"] = list(EVENTS.values())
            if thing.mode == "button":
                config["event_types"] = ["pointed"]
        configs = {self._config_topic(thing): config}

        # Triggers of automations; only a claim has an owner who can let go
        for kind, payload in TRIGGERS.items():
            if kind == "released" and thing.mode != "claim":
                continue
            template = "{{ value_json.event_type }}"
            if payload == PRESSED:
                template = "{{ value_json.event_type }} {{ value_json.cause }}"
            configs[self._trigger_topic(thing, kind)] = {
                "automation_type": "trigger",
                "type": kind,
                "subtype": thing.id,  # labels may change, and need not differ
                "topic": self._event_topic(thing),
                "value_template": template,
                "payload": payload,
                **common,
            }

        publications: list[Publication] = []
        for config_topic, fields in configs.items():
            publications.append(Publication(topic=config_topic, payload=json.dumps(fields), retain=True))
        return publications

    def outdated(self, topics: Sequence[str], things: Sequence[Thing]) -> list[Publication]:
        """Return empty messages for those of `topics` that are of none of `things`."""
        known = {self.status_topic}
        for thing in things:
            for publication in self.discovery(thing):
                known.add(publication.topic)
            if thing.mode == "switch":
                known.add(self._topic(thing.id))
        outdated = [topic for topic in topics if topic not in known]
        return [Publication(topic=topic, payload="", retain=True) for topic in outdated]

    def switched_on(self, things: Sequence[Thing], retained: Mapping[str, object]) -> set[str]:
        """Return the switches among `things` that are on in the broker's retained payloads, by topic."""
        switched_on: set[str] = set()
        for thing in things:
            payload = retained.get(self._topic(thing.id))
            if thing.mode == "switch" and _was_on(payload):
                switched_on.add(thing.id)
        return switched_on

    def states(
        self, things: Sequence[Thing], selected: Sequence[SelectedObject], without: Collection[str]
    ) -> list[Publication]:
        """Return the states of all switches but `without`; `selected`: all objects that are selected."""
        selected_by_id = {selected_object.id: selected_object for selected_object in selected}
        publications: list[Publication] = []
        for thing in things:
            if thing.mode != "switch" or thing.id in without:
                continue
            topic = self._topic(thing.id)
            payload = json.dumps(_state(selected_by_id.get(thing.id)))
            publications.append(Publication(topic=topic, payload=payload, retain=True))
        return publications

    def event(self, thing: Thing, event: SelectionEvent) -> Publication | None:
        """Return the message of an event, or None if it is the end of a button or not by pointing."""
        event_type = EVENTS.get(event.event)
        if event_type is None:
            return None
        if thing.mode == "button" and not event.is_on:
            return None
        payload = {
            "event_type": event_type,
            "user": event.user,
            "confidence": event.confidence,
            "cause": event.cause,
        }
        if thing.mode == "switch":
            if event.cause not in ("dwell", "button"):
                return None
            payload["event_type"] = "pointed"
            payload["state"] = "ON" if event.is_on else "OFF"
        return Publication(topic=self._event_topic(thing), payload=json.dumps(payload))

    def _topic(self, thing_id: str) -> str:
        return f"pointit/{_id_of(self.site)}/things/{_id_of(thing_id)}"

    def _event_topic(self, thing: Thing) -> str:
        """Return the topic of events, which none retains: the state of a switch is retained."""
        topic = self._topic(thing.id)
        return topic + EVENT if thing.mode == "switch" else topic

    def _trigger_topic(self, thing: Thing, kind: str) -> str:
        name = _id_of(thing.id)
        return f"{self.prefix}/device_automation/{self._node}/{name}_{kind}/config"

    def _config_topic(self, thing: Thing) -> str:
        kind = "switch" if thing.mode == "switch" else "event"
        name = _id_of(thing.id)
        return f"{self.prefix}/{kind}/{self._node}/{name}/config"


def _state(selected: SelectedObject | None) -> dict[str, Any]:
    if selected is None:
        return {"state": "OFF", "user": "", "confidence": None}
    return {"state": "ON", "user": selected.user, "confidence": selected.confidence}


def _was_on(payload: object) -> bool:
    """Return True if a message is the state of a switch that is on, as `_state` makes it."""
    if not isinstance(payload, bytes):
        return False
    try:
        state = json.loads(payload)
    except (ValueError, RecursionError):
        return False
    if not isinstance(state, dict):
        return False
    return cast("dict[str, Any]", state).get("state") == "ON"


def _id_of(name: str) -> str:
    """Return `name` as a part of topics and ids, different for each name."""
    clean = NOT_OF_IDS.sub("_", name)
    if clean == name:
        return clean
    checksum = zlib.crc32(name.encode())
    return f"{clean}_{checksum:08x}"
