"""Actions on entities of Home Assistant, and the hover of lamps."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.home_assistant.entity_commands import DimmedLights, HoverFeedback
from pointit.bridges.home_assistant.home_action import HomeAction
from pointit.maps.file import parse_map_file
from pointit.maps.model import things_of
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import StateFile

LAMP = "light.desk"


def feedback(folder: Path) -> HoverFeedback:
    return HoverFeedback(StateFile[DimmedLights].at(folder / "lights.json", DimmedLights))


def lamp(brightness: int | None, **attributes: Any) -> dict[str, Any]:
    state = "off" if brightness is None else "on"
    return {"entity_id": LAMP, "state": state, "attributes": {"brightness": brightness, **attributes}}


def shown(call: Any) -> Any:
    return call and (call.domain, call.service, call.data["brightness"])


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
        ("input_button.bell", False, "input_button.press"),
    ],
)
def test_entity_is_switched_by_the_action_of_its_domain(
    entity: str, *, on: bool | None, service: str
) -> None:
    call = HomeAction.parse(entity).call(on=on)
    assert (call.entity, f"{call.domain}.{call.service}", call.data) == (entity, service, {})


def test_stated_action_has_its_data_and_is_ended_by_switching_off() -> None:
    action = HomeAction.parse(
        '{"entity": "light.desk", "action": "light.turn_on", "data": {"brightness_pct": 40}}'
    )
    on, off = action.call(on=True), action.call(on=False)
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


@given(st.integers(1, 255))
def test_hovered_lamp_changes_by_a_fifth_and_returns_exactly(
    tmp_path_factory: pytest.TempPathFactory, brightness: int
) -> None:
    folder = tmp_path_factory.mktemp("state")
    call = feedback(folder).begin(LAMP, lamp(brightness))
    assert call is not None
    during = call.data["brightness"]
    assert 1 <= during <= 255
    assert during != brightness
    assert abs(during - brightness) == pytest.approx(0.2 * brightness, abs=1)
    again = feedback(folder)  # after kill -9
    assert again.entities == (LAMP,)
    assert shown(again.end(LAMP, lamp(during))) == ("light", "turn_on", brightness)
    assert again.end(LAMP, lamp(brightness), is_sent=True) is None
    again.forget(LAMP)
    assert feedback(folder).entities == ()


def test_brightness_is_stored_before_the_lamp_changes_and_not_replaced_by_that_of_the_hover(
    tmp_path: Path,
) -> None:
    assert shown(feedback(tmp_path).begin(LAMP, lamp(100))) == ("light", "turn_on", 120)
    again = feedback(tmp_path)
    assert shown(again.begin(LAMP, lamp(100))) == ("light", "turn_on", 120), "killed before it was sent"
    assert again.begin(LAMP, lamp(118)) is None, "it shows it, rounded to percent"
    assert shown(again.end(LAMP, lamp(118))) == ("light", "turn_on", 100)


def test_lamp_that_somebody_else_has_set_meanwhile_is_left_alone(tmp_path: Path) -> None:
    own = feedback(tmp_path)
    own.begin(LAMP, lamp(100))
    assert own.end(LAMP, lamp(30)) is None
    assert own.entities == ()


@pytest.mark.parametrize(("brightness", "again"), [(100, False), (104, False), (112, False), (118, True)])
def test_lamp_that_got_its_brightness_back_is_restored_again_only_if_it_still_shows_the_hover(
    brightness: int, tmp_path: Path, *, again: bool
) -> None:
    own = feedback(tmp_path)
    own.begin(LAMP, lamp(100))
    assert shown(own.end(LAMP, lamp(brightness), is_sent=True)) == (
        ("light", "turn_on", 100) if again else None
    )
    assert own.entities == ((LAMP,) if again else ()), "others may have set it within the time"


def test_lamp_that_was_switched_off_meanwhile_is_restored_when_it_is_on_again(tmp_path: Path) -> None:
    own = feedback(tmp_path)
    own.begin(LAMP, lamp(100))
    assert own.end(LAMP, lamp(None)) is None
    assert own.end(LAMP, {}) is None, "unavailable"
    assert shown(own.end(LAMP, lamp(120))) == ("light", "turn_on", 100)


@pytest.mark.parametrize(
    "state",
    [
        lamp(None),
        {},
        {"entity_id": LAMP, "state": "on", "attributes": {}},
        {"entity_id": LAMP, "state": "unavailable", "attributes": {"restored": True}},
        lamp(100, entity_id=["light.a", "light.b"]),
        lamp(100, effect="colorloop"),
    ],
    ids=["off", "absent", "without brightness", "unavailable", "group", "effect"],
)
def test_lamp_that_could_not_return_exactly_shows_no_hover(tmp_path: Path, state: dict[str, Any]) -> None:
    assert feedback(tmp_path).begin(LAMP, state) is None
    assert feedback(tmp_path).entities == ()


def test_file_that_is_damaged_is_named(tmp_path: Path) -> None:
    (tmp_path / "lights.json").write_text("{")
    with pytest.raises(ConfigError, match=r"lights\.json: cannot be used; move it away"):
        feedback(tmp_path)


def things(text: str) -> dict[str, Any]:
    return {each.id: each for each in things_of(parse_map_file(f"things: {text}".encode(), Path("m.yaml")))}


def test_thing_of_an_entity_needs_no_position_and_is_a_switch_if_the_entity_is_on_or_off() -> None:
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
def test_home_assistant_of_a_thing_that_is_no_entity_is_an_error(value: str) -> None:
    with pytest.raises(
        ConfigError, match=r"home_assistant: write an entity of Home Assistant, such as light"
    ):
        things(f"{{a: {{home_assistant: {value}}}}}")
