"""Reasons of robots: which are new."""

from typing import Any

import pytest

from pointit.schemas import RobotState


def state(reason: str = "", **fields: Any) -> RobotState:
    usual: dict[str, Any] = {
        "stamp_ns": 1,
        "kind": "ground",
        "phase": "stopped",
        "position_m": (0.0, 0.0, 0.0),
        "yaw_rad": 0.0,
        "velocity_mps": (0.0, 0.0, 0.0),
        "radius_m": 0.3,
    }
    return RobotState(reason=reason, **(usual | fields))


@pytest.mark.parametrize(
    ("previous", "current", "is_new"),
    [
        (None, state("anna is 0.5 m away", reason_code="people"), True),
        (None, state(), False),
        (state(), state("anna is 0.5 m away", reason_code="people"), True),
        (
            state("anna is 0.5 m away", reason_code="people"),
            state("anna is 0.4 m away", reason_code="people"),
            False,
        ),
        (
            state("anna is 0.5 m away", reason_code="people"),
            state("rack is 0.4 m away", reason_code="fence"),
            True,
        ),
        (state("anna is 0.5 m away", reason_code="people"), state(), False),
        (state("without a code, as of another driver"), state("another one"), True),
        (state("without a code, as of another driver"), state("without a code, as of another driver"), False),
    ],
)
def test_reason_is_new_when_its_kind_differs(
    previous: RobotState | None, current: RobotState, *, is_new: bool
) -> None:
    assert current.has_new_reason(previous) is is_new
