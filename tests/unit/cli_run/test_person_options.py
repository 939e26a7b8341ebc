"""Command-line options for people reach profile, localizer and simulation alike."""

from typing import Any

import click
import pytest
from click.testing import CliRunner

from pointit.cli.run.run_options import PERSON_OPTIONS, pose
from pointit.launch.plan.launches import Choices, user_launches
from pointit.launch.plan.scenario import Pose, read_scenario
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch


def person(choices: Choices, index: int = 0, scenario: str = "scenario_2") -> dict[str, dict[str, Any]]:
    """Return one person's parameters by service."""
    launches: list[Launch] = user_launches(read_scenario(scenario), choices, f"user{index + 1}", index)
    return {launch.service.NAME: launch.config.model_dump() for launch in launches}


def test_a_pose_is_read_in_metres_and_degrees() -> None:
    assert pose("2,0.5") == Pose(x_m=2.0, y_m=0.5)
    assert pose("-1.5, 3e0,-90") == Pose(x_m=-1.5, y_m=3.0, yaw_deg=-90.0)


@pytest.mark.parametrize("text", ["", "1", "1,2,3,4", "a,b", "nan,0", "inf,1", "1000001,0", "0,0,361", "1;2"])
def test_another_pose_is_refused_with_an_example_or_the_range(text: str) -> None:
    with pytest.raises(click.BadParameter, match=r"such as 2\.0,0\.5,20|are metres to 1,000,000"):
        pose(text)


def test_options_as_typed() -> None:
    got: dict[str, Any] = {}

    def keep(**options: Any) -> None:
        got.update(options)

    command: Any = keep
    for option in PERSON_OPTIONS:
        command = option(command)
    arguments = ["--targets", "3", "--pose", "-1,2", "--pose", "3,4,5", "--hand", "left", "--stature", "1.6"]
    result = CliRunner().invoke(click.command()(command), arguments)
    assert result.exit_code == 0, result.output
    assert got == {
        "targets": 3,
        "poses": (Pose(x_m=-1.0, y_m=2.0), Pose(x_m=3.0, y_m=4.0, yaw_deg=5.0)),
        "hand": "left",
        "stature_m": 1.6,
    }


def test_people_stand_where_they_are_told_in_turn_and_the_rest_where_the_scenario_says() -> None:
    choices = Choices(poses=(Pose(x_m=1.0, y_m=-2.0, yaw_deg=30.0), Pose(x_m=0.5, y_m=0.0)))
    for index, (place, yaw_deg) in enumerate([((1.0, -2.0, 0.0), 30.0), ((0.5, 0.0, 0.0), 0.0)]):
        services = person(choices, index)
        for name in ("localizer", "user-sim"):
            assert services[name]["position_m"] == place
            assert services[name]["yaw_deg"] == yaw_deg
        assert services["localizer"]["method"] == "fixed"
    third = read_scenario("scenario_2").places[2]
    assert person(choices, 2)["localizer"]["position_m"] == third.position_m
    one = Choices(imu=("simulated",), poses=(Pose(x_m=7.0, y_m=8.0),)).of_one(2)
    assert person(one, 2)["localizer"]["position_m"] == (7.0, 8.0, 0.0)
    assert person(one, 2)["imu-bridge"]["source"] == "simulated"
    assert Choices().of_one(2) == Choices()


def test_a_real_wrist_stands_there_too() -> None:
    services = person(Choices(imu=("serial:/dev/x",), poses=(Pose(x_m=1.0, y_m=2.0, yaw_deg=9.0),)))
    assert services["localizer"]["position_m"] == (1.0, 2.0, 0.0)
    assert "user-sim" not in services


def test_who_is_localized_is_simulated_there_and_nobody_is_told() -> None:
    choices = Choices(localize=True, poses=(Pose(x_m=1.0, y_m=2.0),))
    services = person(choices)
    assert services["user-sim"]["position_m"] == (1.0, 2.0, 0.0)
    assert services["user-sim"]["yaw_deg"] is None
    assert services["localizer"]["position_m"] != (1.0, 2.0, 0.0)
    given = Choices(localize=True, poses=(Pose(x_m=1.0, y_m=2.0, yaw_deg=40.0),))
    assert person(given)["user-sim"]["yaw_deg"] == 40.0
    with pytest.raises(ConfigError, match=r"--pose 1,2: --localize finds the pose"):
        person(Choices(localize=True, imu=("serial:/dev/x",), poses=(Pose(x_m=1.0, y_m=2.0),)))


def test_targets_go_to_the_localizer() -> None:
    assert person(Choices(localize=True, targets=3))["localizer"]["targets"] == 3
    usual = person(Choices(localize=True))["localizer"]["enough"]
    assert person(Choices(localize=True, targets=3))["localizer"]["enough"] == usual  # it counts for itself
    by_hand = Choices(
        localize=True, targets=3, settings=("localizer.targets=2", "localizer.enough.yaw_deg=9")
    )
    assert person(by_hand)["localizer"]["targets"] == 2
    assert person(by_hand)["localizer"]["enough"]["yaw_deg"] == 9.0
    with pytest.raises(ConfigError, match=r"--targets 3: add --localize"):
        person(Choices(targets=3))


def test_the_default_person_stays_and_the_localized_one_is_as_people_are() -> None:
    plain, localized = person(Choices())["user-sim"], person(Choices(localize=True))["user-sim"]
    assert plain["wristband"]["yaw_rate_bias_sd_degps"] == 0.05
    assert plain["anchor_when_off_deg"] == 0.0
    assert localized["wristband"]["yaw_rate_bias_sd_degps"] == 0.25
    assert localized["anchor_when_off_deg"] == 10.0
    assert localized["aim"] == plain["aim"]


def test_hand_and_stature_are_the_profiles_and_the_bodys() -> None:
    services = person(Choices(hand="left", stature_m=1.6))
    profile, body = services["supervisor"]["profile"], services["user-sim"]["body"]
    assert profile["hand"] == body["hand"] == "left"
    assert profile["stature_m"] == 1.6
    assert body["footprint_to_neck_m"] == pytest.approx(1.43 * 1.6 / 1.835, abs=1e-3)
    assert body["shoulder_to_wrist_m"] == pytest.approx(0.55 * 1.6 / 1.835, abs=1e-3)


def test_set_wins_over_every_option() -> None:
    settings = (
        "user-sim.yaw_deg=5",
        "user-sim.body.hand=right",
        "user-sim.wristband.yaw_drift_degpmin=15",
        "user-sim.aim.elevation_bias_deg=10",
        "localizer.method=fixed",
        "localizer.position_m=[9, 9, 0]",
    )
    services = person(Choices(localize=True, hand="left", settings=settings))
    assert services["user-sim"]["yaw_deg"] == 5.0
    assert services["user-sim"]["body"]["hand"] == "right"
    assert services["supervisor"]["profile"]["hand"] == "left"
    assert services["user-sim"]["wristband"]["yaw_drift_degpmin"] == 15.0
    assert services["user-sim"]["wristband"]["yaw_rate_bias_sd_degps"] == 0.25
    assert services["user-sim"]["aim"]["elevation_bias_deg"] == 10.0
    assert services["localizer"]["method"] == "fixed"
    assert services["localizer"]["position_m"] == (9.0, 9.0, 0.0)


def test_pose_may_lie_as_far_as_a_map_may() -> None:
    assert pose("450000,-5000.5") == Pose(x_m=450_000.0, y_m=-5000.5)
