"""`pointit evaluate robots`: what people read, what programs read, what is refused."""

import json
from pathlib import Path

import pytest

from pointit.runtime.errors import ConfigError
from pointit_lab.cli.robots import robots
from pointit_lab.evaluation.robots import choice
from tests.lab.evaluation.test_robot_evaluation import write
from tests.support.invoked import printed


def invoke(*arguments: str) -> tuple[str, str]:
    return printed(robots, *arguments, "--people", "1", "--jobs", "1", env={"COLUMNS": "160"})


@pytest.fixture(autouse=True)
def no_recordings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("POINTIT_DATA", raising=False)


def test_flights_stand_beside_those_of_recorded_people(tmp_path: Path) -> None:
    (tmp_path / "hri_landing").mkdir()
    write(tmp_path / "hri_landing", {}, {"move": 1, "mode": "joystick"})
    out, _ = invoke("--bench", "landing", "--data", str(tmp_path))
    lines = [line.split() for line in out.splitlines()]
    assert ["exact", "pose", "simulated", "1", "0"] in [line[:5] for line in lines]
    assert ["recorded", "people,", "joystick", "1", "0"] in [line[:5] for line in lines]
    assert "identification" not in out


def test_rates_of_identification_for_programs() -> None:
    out, err = invoke("--bench", "identification", "--json", "-")
    found = json.loads(out)
    assert found["flights"] == []
    assert {rate["set"] for rate in found["identification"]} == {"simulated"}
    assert "no people of motion_relloc and proximity_waypoints to compare with: give --data DIR" in err


def test_localization_by_following_a_figure_stands_beside_other_ways() -> None:
    out, _ = invoke("--bench", "following")
    assert "5 s, quadrotor" in out
    assert {"figure", "circle", "line"} <= set(out.split())


def test_a_folder_without_recordings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--data"):
        invoke("--bench", "landing", "--data", str(tmp_path / "none"))


def test_reliability_of_the_choice_of_a_robot_by_arrangement_and_of_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(choice, "LAYOUTS", (("lone", 1), ("row", 2)))
    out, _ = invoke("--bench", "choice")
    starts = [line.split()[:1] for line in out.splitlines()]
    assert [start for start in starts if start in (["lone"], ["2"], ["all"])] == [["lone"], ["2"], ["all"]]
