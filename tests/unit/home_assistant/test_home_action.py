"""Actions on entities of Home Assistant, and things that have them."""

from pathlib import Path
from typing import Any

import pytest

from pointit.bridges.home_assistant.home_action import HomeAction
from pointit.maps.file import parse_map_file
from pointit.maps.things import things_of
from pointit.runtime.errors import ConfigError

LAMP = "light.desk"


@pytest.mark.parametrize(
    ("entity", "on", "service"),
    [
        (LAMP, True, "light.turn_on"),
        (LAMP, False, "light.turn_off"),
        (LAMP, None, "light.toggle"),
        ("cover.blind", True, "cover.open_cover"),
        ("lock.door", False, "lock.lock"),
        ("scene.movie", True, "scene.turn_on"),
        ("script.night", None, "script.turn_on"),
        ("group.upstairs", True, "homeassistant.turn_on"),
        ("input_button.bell", False, "input_button.press"),
    ],
)
def test_entity_is_switched_by_the_action_of_its_domain(
    entity: str, *, on: bool | None, service: str
) -> None:
    call = HomeAction.parse(entity).call(on=on)
    assert (call.entity, f"{call.domain}.{call.service}", call.data) == (entity, service, {})


def test_stated_action_gets_its_data_and_ends_by_switching_off() -> None:
    action = HomeAction.parse(
        '{"entity": "light.desk", "action": "light.turn_on", "data": {"brightness_pct": 40}}'
    )
    on = action.call(on=True)
    off = action.call(on=False)
    assert (on.entity, on.service, on.data) == (LAMP, "turn_on", {"brightness_pct": 40})
    assert (off.service, off.data) == ("turn_off", {})


@pytest.mark.parametrize(
    ("entity", "state", "is_on"),
    [
        (LAMP, "on", True),
        (LAMP, "off", False),
        (LAMP, "unavailable", None),
        (LAMP, "unknown", None),
        (LAMP, None, None),
        ("cover.blind", "opening", True),
        ("cover.blind", "closed", False),
        ("media_player.radio", "playing", True),
        ("media_player.radio", "standby", False),
        ("scene.movie", "2026-11-27T08:28:36+00:00", None),
    ],
)
def test_state_is_on_off_or_unknown(entity: str, state: str | None, *, is_on: bool | None) -> None:
    assert HomeAction(entity).is_on(state) is is_on


def things(text: str) -> dict[str, Any]:
    return {each.id: each for each in things_of(parse_map_file(f"things: {text}".encode(), Path("m.yaml")))}


def test_thing_of_an_entity_needs_no_position_and_may_switch() -> None:
    found = things(
        "{a: {home_assistant: light.a}, b: {home_assistant: scene.b}, "
        "c: {home_assistant: {entity: light.c, action: light.turn_on, data: {flash: short}}}, "
        "d: {home_assistant: light.d, mode: button, center: [0, 1, 1], size: [1, 1, 1]}}"
    )
    assert {name: each.mode for name, each in found.items()} == {
        "a": "switch",
        "b": "button",
        "c": "button",
        "d": "button",
    }
    assert {name: each.is_tracked for name, each in found.items()} == {
        "a": True,
        "b": True,
        "c": True,
        "d": False,
    }
    assert HomeAction.parse(found["a"].home_assistant).entity == "light.a"
    assert HomeAction.parse(found["c"].home_assistant).data == {"flash": "short"}


@pytest.mark.parametrize(
    "value",
    [
        "floor lamp",
        "light",
        "Light.Floor",
        "3",
        "[light.a]",
        "{entity: light.a}",
        "{action: light.turn_on}",
        "{entity: light.a, action: light.turn_on, data: 3}",
        "{entity: light.a, action: toggle}",
        "{entity: light.a, action: light.turn_on, dat: {}}",
    ],
)
def test_home_assistant_value_that_is_no_entity_is_an_error(value: str) -> None:
    with pytest.raises(
        ConfigError, match=r"home_assistant: write an entity of Home Assistant, such as light"
    ):
        things(f"{{a: {{home_assistant: {value}}}}}")


@pytest.mark.parametrize("entity", ["sensor.temperature", "person.anna", "lihgt.desk"])
def test_entity_that_is_neither_switched_nor_run_needs_an_action(entity: str) -> None:
    with pytest.raises(ConfigError, match=rf"{entity} is neither switched nor run; write {{entity: "):
        things(f"{{a: {{home_assistant: {entity}}}}}")
    things(f"{{a: {{home_assistant: {{entity: {entity}, action: notify.anna}}}}}}")


@pytest.mark.parametrize(
    ("action", "is_allowed"),
    [("light.turn_on", True), ("scene.apply", True), ("script.night", True), ("shell_command.run", False)],
)
def test_action_of_another_domain_is_allowed_only_when_listed(action: str, *, is_allowed: bool) -> None:
    home_action = HomeAction(LAMP, action)
    assert home_action.is_of(()) is is_allowed
    assert home_action.is_of((action,))
