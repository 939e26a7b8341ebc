"""Velocities of AGVs on their map: in any frame, not stated, or stated as 0 while they drive."""

import math
from collections.abc import Sequence

import pytest

from pointit.vda5050.agv_messages import AgvState, Visualization
from pointit.vda5050.map_velocity import MOVED_M, LastPose, MapVelocity, velocity_on_map


@pytest.mark.parametrize(
    ("velocity", "place", "age_s", "expected"),
    [
        ({"vx": 0.5, "vy": 0.0}, (0.0, 0.0), 0.1, (0.0, 0.5)),  # stands, and begins to drive forward
        ({"vx": 0.5, "vy": 0.0}, (0.0, -0.1), 0.1, (0.0, 0.5)),
        ({"vx": 0.0, "vy": 0.5}, (0.0, -0.1), 0.1, (0.0, 0.5)),  # in the frame of the map
        ({"vx": -0.5, "vy": 0.0}, (0.0, 0.1), 0.1, (0.0, -0.5)),  # backwards
        (None, (0.0, -0.1), 0.2, (0.0, 0.5)),
        (None, (0.0, -0.1), 0.001, (7.0, 7.0)),  # two messages at once
        (None, (0.0, 0.0), 0.2, (0.0, 0.0)),
    ],
)
def test_a_velocity_points_to_where_the_agv_has_gone_whatever_its_frame(
    velocity: dict[str, float] | None, place: tuple[float, float], age_s: float, expected: tuple[float, float]
) -> None:
    position = {"x": 0.0, "y": 0.0, "theta": math.pi / 2, "mapId": "hall"}
    message = Visualization.model_validate({"agvPosition": position, "velocity": velocity})
    assert velocity_on_map(message, LastPose(place, (7.0, 7.0), age_s)) == pytest.approx(expected)


def test_an_agv_seen_first_has_the_velocity_that_it_states() -> None:
    position = {"x": 0.0, "y": 0.0, "theta": 0.0, "mapId": "hall"}
    message = Visualization.model_validate({"agvPosition": position, "velocity": {"vx": 0.5}})
    assert velocity_on_map(message, None) == pytest.approx((0.5, 0.0))
    assert velocity_on_map(Visualization.model_validate({"agvPosition": position}), None) == (0.0, 0.0)


def velocities(speeds: Sequence[dict[str, float]], places: Sequence[float], period_s: float) -> list[float]:
    """Return the velocities along x of an AGV that states `speeds` at `places`."""
    motion, found = MapVelocity(), list[float]()
    last: LastPose | None = None
    for speed, x in zip(speeds, places, strict=True):
        position = {"x": x, "y": 0.0, "theta": 0.0, "positionInitialized": True}
        message = Visualization.model_validate({"agvPosition": position, "velocity": speed})
        found.append(motion.update(message, last)[0])
        last = LastPose((x, 0.0), (found[-1], 0.0), period_s)
    return found


ZERO = {"vx": 0.0, "vy": 0.0, "omega": 0.0}


@pytest.mark.parametrize("zero", [ZERO, {"vx": 0}, {"vx": 0.0, "omega": 0.3}])
@pytest.mark.parametrize("period_s", [0.1, 1.0])
def test_velocity_0_of_an_agv_that_drives_is_not_stated(zero: dict[str, float], period_s: float) -> None:
    found = velocities([zero] * 40, [0.5 * period_s * n for n in range(40)], period_s)
    assert found[10:] == pytest.approx([0.5] * 30)


def test_velocity_0_of_an_agv_that_has_stopped_is_stated() -> None:
    places = [0.5, 1.0, 1.5, 1.7] + [1.71, 1.69] * 20  # the position is not exact
    assert velocities([{"vx": 0.5}] * 3 + [ZERO] * 41, places, 1.0)[3:] == [0.0] * 41


def test_agv_that_states_a_velocity_again_is_believed_again() -> None:
    speeds = [ZERO] * 9 + [{"vx": 0.3}] + [ZERO] * 5
    places = [0.1 * n for n in range(9)] + [0.9] * 6
    found = velocities(speeds, places, 0.2)
    assert found[8] == pytest.approx(0.5)
    assert found[10:] == [0.0] * 5
    assert 0.0 < MOVED_M < 0.8


def test_state_without_a_position_has_no_velocity() -> None:
    message = AgvState.model_validate({"velocity": ZERO})
    assert MapVelocity().update(message, LastPose((0.0, 0.0), (0.4, 0.0), 1.0)) == (0.0, 0.0)
