"""State of the site, bounded even against invented names."""

import pytest

from pointit.bridges.web.model import site_model as module
from pointit.bridges.web.model.site_model import SiteModel
from pointit.bridges.web.pages.latest_values import LatestValueCache
from pointit.bridges.web.playback.recent import Recent
from pointit.schemas import Environment, Lamp, LampColor, UserPose
from pointit.schemas.topics import LAMP_COLOR, MAP, POSE


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
