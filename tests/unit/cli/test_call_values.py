"""What people type as the value of a request's field."""

import pytest

from pointit.cli.call import build
from pointit.schemas import SetPose, SetSpeed
from pointit.schemas.topics import SET_POSE, SET_SPEED


@pytest.mark.parametrize(
    "typed", ["part_e,part_f", "[part_e, part_f]", "part_e, part_f", "['part_e', part_f]"]
)
def test_a_list_needs_no_brackets(typed: str) -> None:
    query = build(SET_SPEED, ["speed_mps=0.2", f"belts={typed}"])
    assert query == SetSpeed(speed_mps=0.2, belts=("part_e", "part_f"))


def test_one_name_is_a_list_of_one() -> None:
    assert build(SET_SPEED, ["speed_mps=1", "belts=part_e"]) == SetSpeed(speed_mps=1.0, belts=("part_e",))


def test_numbers_too() -> None:
    assert build(SET_POSE, ["position_m=1,2,0"]) == SetPose(position_m=(1.0, 2.0, 0.0))
