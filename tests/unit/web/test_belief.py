"""What is taken to be true: no more than there is room for, whoever makes up names."""

import pytest

from pointit.bridges.web import belief as module
from pointit.bridges.web.belief import Belief
from pointit.bridges.web.hub import Hub
from pointit.schemas import UserPose
from pointit.schemas.topics import POSE


def test_of_names_without_end_nothing_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "Hub", lambda: Hub(most_keys=10))
    belief = Belief("web", 0.0, 0.0)
    taken = [
        belief.take(
            POSE, f"user{n}", UserPose(stamp_ns=n, yaw_rad=0.0, position_m=(0.0, 0.0, 0.0)), n, n / 1e9
        )
        for n in range(100)
    ]
    assert taken == [True] * 10 + [False] * 90
    assert len(belief.last_minute.recording("lab", 10**12).entries) == 10
