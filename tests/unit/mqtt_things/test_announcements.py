"""Triggers of Home Assistant's devices, by which automations begin when people point at things."""

import json
import re
from typing import Any

import pytest

from pointit.bridges.mqtt_things.announcements import Announcements
from pointit.schemas import SelectionEvent
from pointit.schemas.environment import Thing, ThingMode

SITE = Announcements("lab")


def thing(mode: ThingMode, name: str = "screws") -> Thing:
    return Thing(id=name, label="Screws, 4 mm", center_m=(0, 0, 1), size_m=(0.2, 0.2, 0.2), mode=mode)


def triggers(each: Thing) -> dict[str, dict[str, Any]]:
    """Return the configurations of triggers by their topic."""
    return {
        found.topic: json.loads(found.payload)
        for found in SITE.discovery(each)
        if "/device_automation/" in found.topic
    }


def fired(each: Thing, event: SelectionEvent) -> set[str]:
    """Return the types of the triggers that Home Assistant fires for an event."""
    message = SITE.event(each, event)
    if message is None:
        return set()
    assert not message.retain, "a restart would fire it again"
    values = json.loads(message.payload)
    return {
        config["type"]
        for config in triggers(each).values()
        if config["topic"] == message.topic
        and re.sub(r"{{ value_json\.(\w+) }}", lambda name: values[name[1]], config["value_template"])
        == config["payload"]
    }


def event(name: Any, cause: Any = "dwell") -> SelectionEvent:
    return SelectionEvent(stamp_ns=1, event=name, object_id="screws", user="anna", cause=cause)


@pytest.mark.parametrize(
    ("mode", "name", "cause", "types"),
    [
        ("button", "selected", "dwell", {"pointed"}),
        ("button", "selected", "button", {"pointed", "pressed"}),
        ("button", "deselected", "", set[str]()),
        ("claim", "selected", "dwell", {"pointed"}),
        ("claim", "deselected", "button", {"released"}),
        ("claim", "refused", "button", set[str]()),
        ("switch", "selected", "button", {"pointed", "pressed"}),
        ("switch", "deselected", "dwell", {"pointed"}),
        ("switch", "selected", "", set[str]()),
    ],
)
def test_triggers_fire_when_a_person_points_presses_or_lets_go(
    mode: ThingMode, name: str, cause: str, types: set[str]
) -> None:
    assert fired(thing(mode), event(name, cause)) == types


@pytest.mark.parametrize("mode", ["button", "switch", "claim"])
def test_triggers_of_the_site_device_differ_by_type_and_thing(mode: ThingMode) -> None:
    configs = triggers(thing(mode)) | triggers(thing(mode, "4.screws"))
    assert len({(each["type"], each["subtype"]) for each in configs.values()}) == len(configs)
    for topic, config in configs.items():
        assert re.fullmatch(r"homeassistant/device_automation/pointit_lab/[A-Za-z0-9_-]+/config", topic)
        assert config["automation_type"] == "trigger"
        assert config["device"]["identifiers"] == ["pointit_lab"]
    assert ("released" in {each["type"] for each in configs.values()}) == (mode == "claim")


def test_triggers_are_removed_when_things_go_or_change_mode() -> None:
    topics = [each.topic for each in SITE.discovery(thing("claim"))]
    assert {each.topic for each in SITE.outdated(topics, [])} == set(topics)
    taken_back = {each.topic: each.payload for each in SITE.outdated(topics, [thing("switch")])}
    assert taken_back == {
        "homeassistant/device_automation/pointit_lab/screws_released/config": "",
        "homeassistant/event/pointit_lab/screws/config": "",
    }


def test_switch_has_different_topics_for_state_and_events() -> None:
    message = SITE.event(thing("switch"), event("deselected"))
    assert message is not None
    assert message.topic == "pointit/lab/things/screws/event"
    assert json.loads(message.payload)["state"] == "OFF"
    assert SITE.command([thing("switch")], message.topic, "ON") is None
