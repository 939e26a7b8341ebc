"""Typed values of the fields of a request."""

import io

import pytest
from rich.console import Console

from pointit.cli.common.output import print_table
from pointit.cli.inspect.call import build, requests
from pointit.schemas import SetFeeding, SetPose, SetSpeed
from pointit.schemas.topics import SET_FEEDING, SET_POSE, SET_SPEED


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


@pytest.mark.parametrize(("typed", "feeding"), [("false", False), ("off", False), ("on", True)])
def test_a_switch_is_typed_as_people_say_it(typed: str, *, feeding: bool) -> None:
    assert build(SET_FEEDING, [f"feeding={typed}"]) == SetFeeding(feeding=feeding)


def test_no_key_or_field_is_broken_at_eighty_columns() -> None:
    text = io.StringIO()
    print_table(Console(file=text, width=80), requests())
    lines = text.getvalue().splitlines()
    for row in requests().rows:
        assert any(f" {row['key']} " in line and f" {row['field']}" in line for line in lines), row
