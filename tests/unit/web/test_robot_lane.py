"""A robot's lane of the timeline: what it does, for whom, and why not."""

from typing import Any

from pointit.bridges.web.playback.lanes import Lanes
from pointit.runtime.virtual_time import START_NS
from pointit.schemas import NS_PER_S, RobotState
from pointit.schemas.topics import ROBOT_STATE, SERVICE_ALIVE


def at(seconds: float) -> int:
    return START_NS + round(seconds * NS_PER_S)


def test_a_robots_lane_tells_what_it_does_for_whom_and_why_not() -> None:
    lanes = Lanes()

    def tell(seconds: float, **fields: Any) -> None:
        zero = (0.0, 0.0, 0.0)
        known = {"position_m": zero, "velocity_mps": zero, "yaw_rad": 0.0, "radius_m": 0.2}
        state = RobotState.model_validate({"stamp_ns": at(seconds), "kind": "ground", **known, **fields})
        lanes.add(at(seconds), ROBOT_STATE, "cart", state)

    lanes.add(at(0.0), SERVICE_ALIVE, "robot.cart", body=True)
    tell(0.0, phase="idle")
    tell(1.0, phase="moving", user="anna")
    tell(2.0, phase="moving", user="anna")
    tell(3.0, phase="stopped", user="anna", reason="ben is 0.91 m away")
    tell(4.0, phase="stopped", user="anna", reason="ben is 0.87 m away")
    tell(5.0, phase="idle")
    tell(6.0, phase="taking_off")
    lanes.add(at(7.0), SERVICE_ALIVE, "robot.cart", body=False)
    (lane,) = lanes.lanes(at(0.0), at(7.0))
    assert (lane.kind, lane.user) == ("robot", "cart")
    assert lane.items == (
        (1.0, 3.0, "moving, steered by anna"),
        (3.0, 5.0, "stopped, steered by anna: ben is 0.91 m away"),
        (6.0, 7.0, "taking off"),
    )
