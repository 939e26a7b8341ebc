"""Hover of lamps by brightness: what a lamp reports, and who has caused it."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.home_assistant.home_action import ServiceCall
from pointit.bridges.home_assistant.hover_feedback import (
    MAX_HOVER_S,
    RESTORE_TIMEOUT_S,
    STANDING_S,
    DimmedLights,
    HoverFeedback,
)
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import StateFile

LAMP = "light.desk"
OURS = {"id": "ours", "parent_id": None, "user_id": "pointit"}
APP = {"id": "app", "parent_id": None, "user_id": "anna"}
AUTOMATION = {"id": "automation", "parent_id": "door", "user_id": None}
DEVICE = {"id": "device", "parent_id": None, "user_id": None}
"""Context of a hand at the wall, and of a lamp that is polled."""


def lamp(brightness: object, context: object = None, **attributes: Any) -> dict[str, Any]:
    state = "off" if brightness is None else "on"
    attributes |= {"brightness": brightness}
    return {"entity_id": LAMP, "state": state, "attributes": attributes, "context": context}


class LampSite:
    """Hover of one site on a lamp, whose clock the test moves."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.now_s = 100.0
        self.state = lamp(100)
        self.start()

    def start(self) -> None:
        """Start the process, also after it was killed."""
        file = StateFile[DimmedLights].at(self.folder / "lights.json", DimmedLights)
        self.feedback = HoverFeedback(file, lambda: self.now_s)
        self.feedback.on_first_state(LAMP, self.state)

    def report(self, brightness: object, context: object = None) -> None:
        before = self.state
        self.state = lamp(brightness, context)
        self.feedback.on_state(LAMP, before, self.state)

    def hover(self) -> ServiceCall:
        """Call the lamp; its result has not come."""
        call = self.feedback.begin(LAMP, self.state)
        assert call is not None
        return call

    def show(self, brightness: int, context: object = OURS) -> None:
        """Hover the lamp, which reports a brightness."""
        call = self.hover()
        self.report(brightness, context)
        self.feedback.on_result(call, "ours")

    def end(self) -> Any:
        """Return the brightness that is commanded at the end of the hover, or None."""
        call = self.feedback.end(LAMP, self.state)
        return call and call.data["brightness"]

    @property
    def is_forgotten(self) -> bool:
        return self.feedback.entities == ()


@pytest.fixture
def site(tmp_path: Path) -> LampSite:
    return LampSite(tmp_path)


@given(st.integers(1, 255))
def test_hovered_lamp_changes_by_a_fifth_and_returns_exactly(
    tmp_path_factory: pytest.TempPathFactory, brightness: int
) -> None:
    site = LampSite(tmp_path_factory.mktemp("state"))
    site.state = lamp(brightness)
    during = site.hover().data["brightness"]
    assert 1 <= during <= 255
    assert during != brightness
    assert abs(during - brightness) == pytest.approx(0.2 * brightness, abs=1)
    site.report(during, OURS)
    site.start()  # after kill -9, before the result has told the context
    assert site.end() == brightness
    site.feedback.on_result(ServiceCall(LAMP, "light", "turn_on", {"brightness": brightness}), "restored")
    site.report(brightness, OURS)
    site.now_s += RESTORE_TIMEOUT_S
    assert site.end() is None
    assert site.is_forgotten


def test_brightness_is_stored_before_a_hovers_single_call(site: LampSite) -> None:
    site.hover()
    site.start()
    assert site.feedback.entities == (LAMP,), "killed before the call"
    assert site.hover().data["brightness"] == 120
    assert site.feedback.begin(LAMP, site.state) is None, "also if the lamp reports nothing"
    assert site.end() == 100


@pytest.mark.parametrize(
    ("brightness", "context"),
    [
        pytest.param(120, OURS, id="exact"),
        pytest.param(180, OURS, id="three levels"),
        pytest.param(127, DEVICE, id="ten levels, polled"),
        pytest.param(100, OURS, id="no level between"),
    ],
)
def test_first_report_after_a_call_answers_it_with_any_rounding(
    site: LampSite, brightness: int, context: object
) -> None:
    site.show(brightness, context)
    assert site.end() == 100


def test_answer_that_comes_long_after_the_result_counts_too(site: LampSite) -> None:
    site.feedback.on_result(site.hover(), "ours")
    site.report(127, OURS)
    assert site.end() == 100


def test_fading_lamp_reports_levels_nearer_to_the_command(site: LampSite) -> None:
    site.show(104)
    for brightness in (110, 118, 120):
        site.report(brightness, OURS)
    assert site.end() == 100
    site.feedback.on_result(ServiceCall(LAMP, "light", "turn_on", {"brightness": 100}), "ours too")
    for brightness in (115, 108, 100):
        site.report(brightness, OURS)
        assert not site.is_forgotten
    site.now_s += RESTORE_TIMEOUT_S
    assert site.end() is None
    site.hover()


@pytest.mark.parametrize(
    ("brightness", "context"),
    [
        pytest.param(110, APP, id="somebody in the app"),
        pytest.param(119, AUTOMATION, id="automation"),
        pytest.param(55, OURS, id="hand at the wall within 5 s, in our context"),
        pytest.param(121, DEVICE, id="hand at the wall later"),
    ],
)
def test_lamp_set_by_somebody_during_a_hover_is_left_alone(
    site: LampSite, brightness: int, context: object
) -> None:
    site.show(120)
    site.report(brightness, context)
    assert site.is_forgotten
    assert site.end() is None


@pytest.mark.parametrize(("brightness", "context"), [(110, APP), (119, AUTOMATION), (55, DEVICE)])
def test_first_report_caused_by_somebody_else_is_no_answer(
    site: LampSite, brightness: int, context: object
) -> None:
    site.show(brightness, context)
    assert site.is_forgotten


def test_act_of_others_during_a_call_differs_by_context(
    site: LampSite,
) -> None:
    call = site.hover()
    site.report(120, OURS)
    site.report(110, APP)
    assert not site.is_forgotten, "the result tells our context"
    site.feedback.on_result(call, "ours")
    assert site.is_forgotten


@pytest.mark.parametrize(("brightness", "end"), [(120, 100), (200, None)])
def test_lamp_is_restored_after_a_kill_unless_others_set_it(
    site: LampSite, brightness: int, end: int | None
) -> None:
    site.show(120)
    if brightness != 120:
        site.state = lamp(brightness, APP)
    site.start()
    assert site.end() == end


def test_lamp_switched_on_again_at_the_hovers_brightness_is_restored(site: LampSite) -> None:
    site.show(120)
    site.report(None, APP)
    assert site.end() is None
    assert not site.is_forgotten
    site.report(120, APP)
    assert site.end() == 100


@pytest.mark.parametrize(("brightness", "again"), [(100, None), (104, None), (118, 100)])
def test_restored_lamp_is_called_again_only_while_showing_the_hover(
    site: LampSite, brightness: int, again: int | None
) -> None:
    site.show(118)
    assert site.end() == 100
    site.feedback.on_result(ServiceCall(LAMP, "light", "turn_on", {"brightness": 100}), "restored")
    assert site.end() is None, "it takes time to report"
    site.report(brightness, DEVICE)
    site.now_s += RESTORE_TIMEOUT_S
    assert site.end() == again
    assert site.is_forgotten is (again is None)


def test_lamp_shows_no_hover_until_a_foreign_brightness_has_stood(site: LampSite) -> None:
    site.report(60, APP)
    site.now_s += STANDING_S - 1
    assert site.feedback.begin(LAMP, site.state) is None
    site.now_s += 1
    assert site.hover().data["brightness"] == 72


def test_state_set_by_a_call_must_settle_after_a_connection(
    site: LampSite,
) -> None:
    site.state = lamp(120, APP)
    site.start()
    assert site.feedback.begin(LAMP, site.state) is None
    site.state = lamp(100, DEVICE)
    site.start()
    site.hover()


def test_hover_ends_before_another_site_stores_its_brightness(site: LampSite) -> None:
    site.show(120)
    site.now_s += MAX_HOVER_S - 1
    assert not site.feedback.is_over(LAMP)
    site.now_s += 1
    assert site.feedback.is_over(LAMP)
    assert MAX_HOVER_S + RESTORE_TIMEOUT_S < STANDING_S


class SharedLamp:
    """A lamp of two sites: both hear of a call before the caller has its result."""

    def __init__(self, folder: Path) -> None:
        self.sites = [LampSite(folder / name) for name in ("a", "b")]
        self.seen: list[object] = []

    def carry_out(self, calls: list[ServiceCall | None]) -> None:
        """Carry out a call of each site."""
        for site, call in zip(self.sites, calls, strict=True):
            if call is None:
                continue
            brightness = call.data["brightness"]
            context = f"call {len(self.seen)}"
            if brightness != site.state["attributes"]["brightness"]:
                self.seen.append(brightness)
                for each in self.sites:
                    each.report(brightness, {**OURS, "id": context})
            site.feedback.on_result(call, context)

    def hover(self) -> None:
        self.carry_out([each.feedback.begin(LAMP, each.state) for each in self.sites])

    def end(self) -> None:
        self.carry_out([each.feedback.end(LAMP, each.state) for each in self.sites])

    def wait(self, duration_s: float) -> None:
        for each in self.sites:
            each.now_s += duration_s


def test_lamp_of_two_sites_returns_to_its_brightness(tmp_path: Path) -> None:
    home = SharedLamp(tmp_path)
    for _ in range(3):
        home.hover()  # at the same instant
        home.wait(2.0)
        home.hover()
        home.end()
        home.wait(RESTORE_TIMEOUT_S)
        home.end()
        home.wait(STANDING_S)
    assert home.seen == [120, 100] * 3
    assert all(each.is_forgotten for each in home.sites)


@pytest.mark.parametrize(
    "state",
    [
        lamp(None),
        {},
        {"entity_id": LAMP, "state": "on", "attributes": {}},
        {"entity_id": LAMP, "state": "unavailable", "attributes": {"restored": True}},
        lamp(100, entity_id=["light.a", "light.b"]),
        lamp(100, is_deconz_group=True),
        lamp(100, is_hue_group=True),
        lamp(100, zigbee_group="0x0005"),
        lamp(100, effect="colorloop"),
        *(lamp(each) for each in (0, -5, 256, 10**400, True, "100", 99.5)),
    ],
)
def test_lamp_that_could_not_return_exactly_shows_no_hover(site: LampSite, state: dict[str, Any]) -> None:
    assert site.feedback.begin(LAMP, state) is None
    assert site.is_forgotten


@pytest.mark.parametrize(
    "attributes", [{"is_deconz_group": False}, {"effect": "Solid"}, {"effect": "none"}, {"effect": None}]
)
def test_single_lamp_without_an_effect_shows_the_hover(site: LampSite, attributes: dict[str, Any]) -> None:
    assert site.feedback.begin(LAMP, lamp(100, **attributes)) is not None


def test_damaged_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "lights.json").write_text("{")
    with pytest.raises(ConfigError, match=r"lights\.json: cannot be used; move it away"):
        LampSite(tmp_path)
