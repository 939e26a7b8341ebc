"""State of the site, bounded even against invented names."""

import pytest

from pointit.bridges.web.model import site_model as module
from pointit.bridges.web.model.site_model import SiteModel
from pointit.bridges.web.pages.latest_values import LatestValueCache
from pointit.bridges.web.playback.recent import Recent
from pointit.schemas import (
    Deployment,
    Environment,
    ExpectedService,
    Lamp,
    LampColor,
    SelectionEvent,
    UserPose,
)
from pointit.schemas.system import RUN
from pointit.schemas.topics import DEPLOYMENT, LAMP_COLOR, MAP, POSE, SELECTION_EVENTS

PUI = ExpectedService(service="pui")


def test_of_names_without_end_nothing_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LatestValueCache", lambda: LatestValueCache(max_keys=10))
    recent = Recent("lab")
    belief = SiteModel("web", 0.0, recent)
    taken = [
        belief.take(
            POSE, f"user{n}", UserPose(stamp_ns=n, yaw_rad=0.0, position_m=(0.0, 0.0, 0.0)), n, n / 1e9
        )
        for n in range(100)
    ]
    assert taken == [True] * 10 + [False] * 90
    assert len(recent.past(100).states_at(100)) == 10


def test_lamps_that_are_not_in_the_map_take_no_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LatestValueCache", lambda: LatestValueCache(max_keys=3))
    belief = SiteModel("web", 0.0)
    room = Environment(stamp_ns=1, name="lab", lamps=(Lamp(id="real", position_m=(0.0, 0.0, 1.0)),))
    lamp = LampColor(stamp_ns=1, color=(1, 2, 3))
    assert belief.take(MAP, "", room, 1, 0.0)
    for number in range(10):
        assert belief.take(LAMP_COLOR, f"x{number}", lamp, 1, 0.0)
    assert belief.take(LAMP_COLOR, "real", lamp, 1, 0.0)
    assert belief.take(POSE, "anna", UserPose(stamp_ns=1, yaw_rad=0.0, position_m=(0.0, 0.0, 0.0)), 1, 0.0)
    assert belief.hub.names(LAMP_COLOR) == ["real"]


def test_the_events_of_a_run_begin_with_it() -> None:
    belief = SiteModel("web", 0.0)

    def happens(stamp_ns: int) -> None:
        event = SelectionEvent(stamp_ns=stamp_ns, event="selected", object_id="red-1")
        belief.take(SELECTION_EVENTS, "", event, stamp_ns, 0.0)

    def deployed(
        name: str, stamp_ns: int, now_ns: int, services: tuple[ExpectedService, ...] = (PUI,)
    ) -> None:
        message = Deployment(stamp_ns=stamp_ns, name=name, scenario=name, services=services)
        belief.take(DEPLOYMENT, f"{RUN}{name}", message, now_ns, 0.0)

    happens(10)
    assert len(belief.hub.history()) == 1
    deployed("one", 20, 20)
    happens(30)
    assert len(belief.hub.history()) == 1
    deployed("one", 40, 40, services=())
    deployed("two", 900, 50)  # a slow simulation: its time is behind the wall's
    assert len(belief.hub.history()) == 0
    happens(60)
    belief.take(DEPLOYMENT, "anna", Deployment(stamp_ns=70, name="anna", services=(PUI,)), 70, 0.0)
    assert len(belief.hub.history()) == 1
