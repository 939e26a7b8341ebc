"""Things of a run on an MQTT broker, and what a smart home finds there."""

import asyncio
import contextlib
import json
from collections.abc import AsyncGenerator, Mapping
from time import time_ns
from typing import Any

from pointit.bridges.mqtt_things.mqtt_things import MqttThings
from pointit.cli.things.run_things import broker_of
from pointit.schemas import Environment, SelectionEvent
from pointit.schemas.environment import Thing, ThingMode
from pointit.schemas.topics import SELECTION_EVENTS
from tests.support.bench import Bench

TRIGGER = "device_automation "
Heard = list[tuple[str, bytes]]


def thing(name: str, mode: ThingMode = "button", label: str = "") -> Thing:
    return Thing(id=name, center_m=(1.0, 2.0, 1.0), size_m=(0.2, 0.2, 0.2), mode=mode, label=label)


def room(*things: Thing) -> Environment:
    return Environment(stamp_ns=1, name="shop", things=things)


ROOM = room(thing("screws", label="Screws, 4 mm"), thing("radio", "switch"), thing("seat", "claim"))


@contextlib.asynccontextmanager
async def published(port: int, bench: Bench, *, is_new_run: bool = True) -> AsyncGenerator[MqttThings]:
    broker = broker_of(f"127.0.0.1:{port}")
    watcher = MqttThings(broker, is_new_run=is_new_run)
    listening = watcher.attach(bench.bus, lambda _text, _user: None)
    try:
        yield watcher
    finally:
        for subscription in listening:
            subscription.close()
        ending = [task for task in asyncio.all_tasks() if task.get_name().endswith("by MQTT")]
        await asyncio.gather(*ending, return_exceptions=True)


def point(bench: Bench, name: str, event: str = "selected") -> None:
    event_fields = {
        "stamp_ns": time_ns(),
        "event": event,
        "object_id": name,
        "user": "anna",
        "confidence": 0.9,
        "carriers": ("mqtt",),
    }
    bench.put(SELECTION_EVENTS, SelectionEvent.model_validate(event_fields))


def found(heard: Heard) -> Mapping[str, Any]:
    """Return the announcements of entities that are in force, by their kind and the id of their thing."""
    announcements = announced(heard)
    return {name: entry for name, entry in announcements.items() if not name.startswith(TRIGGER)}


def announced(heard: Heard) -> Mapping[str, Any]:
    """Return the announcements of entities and triggers that are in force, by their kind and id."""
    last = {topic: payload for topic, payload in heard if topic.endswith("/config")}
    announcements: dict[str, Any] = {}
    for topic, payload in last.items():
        _, kind, _, name, *_ = topic.split("/")
        if payload:  # an empty one takes back what was announced
            announcements[f"{kind} {name}"] = json.loads(payload)
    return announcements


def told(heard: Heard, topic: str) -> list[Any]:
    payloads = [payload for heard_topic, payload in heard if heard_topic == topic]
    return [json.loads(payload) for payload in payloads]


def state_topic(bench: Bench) -> str:
    return f"pointit/{bench.bus.site}/things/radio"
