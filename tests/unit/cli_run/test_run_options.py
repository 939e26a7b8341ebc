"""Options of `run` and `person add`, and what they start."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click
import pytest
from click.testing import CliRunner

from pointit.cli.common.panels import PanelCommand
from pointit.cli.run import run as run_command
from pointit.cli.run import run_options
from pointit.cli.run.run_options import choices_of, pose, shared_options
from pointit.launch.plan.launches import Choices, robot_of, user_launches
from pointit.launch.plan.plan import FloorPose, Plan, read_scenario
from pointit.launch.plan.scenario_catalog import scenario_launches
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch
from pointit.schemas import Health
from pointit.schemas.problems import Problem

SCENARIO = """
about: robots
places: [{position_m: [3.0, 0.4, 0.0], yaw_deg: 20.0}]
site:
  pui: {map: lab}
  robot.quad: {kind: quadrotor}
  robot.rover: {}
user: {pointing: {}, localizer: {}, supervisor: {}, user-sim: {}}
"""


@click.command(cls=PanelCommand, panels={})
@click.argument("scenario", default="usual")
@shared_options
def command(scenario: str, **options: object) -> Choices:
    choices = choices_of(options)
    click.echo(f"{scenario} {choices.localize} {choices.robot}")
    return choices


@pytest.mark.parametrize(
    ("arguments", "meaning"),
    [
        ([], "usual False None"),
        (["--localize"], "usual True None"),
        (["mine.yaml", "--localize"], "mine.yaml True None"),
        (["--localize", "--seed", "3"], "usual True None"),
        (["--localize", "lamps", "mine.yaml"], "mine.yaml True None"),
        (["--localize", "robot"], "usual True "),
        (["--localize=robot:rover", "mine.yaml"], "mine.yaml True rover"),
        (["mine.yaml", "--localize", "robot:rover"], "mine.yaml True rover"),
        (["--", "--localize"], "--localize False None"),
    ],
)
def test_the_value_may_be_left_out(arguments: list[str], meaning: str) -> None:
    result = CliRunner().invoke(command, arguments)
    assert result.output.splitlines()[-1] == meaning, result.output


NO_WAY = "'stars' is no way to localize; write lamps, robot or robot:NAME"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ("--localize=stars", NO_WAY),
        ("mine.yaml --localize stars", NO_WAY),
        ("--localize mine.yaml", "'mine.yaml' is no way to localize; write lamps"),
        ("mine.yaml --localize lamps stars", "unexpected extra argument (stars)"),
    ],
)
def test_another_value_is_refused(arguments: str, sentence: str) -> None:
    result = CliRunner().invoke(command, arguments)
    assert result.exit_code == 2
    assert sentence in result.output


@pytest.fixture
def scenario(tmp_path: Path) -> str:
    path = tmp_path / "robots.yaml"
    path.write_text(SCENARIO, encoding="utf-8")
    return str(path)


def test_localized_person_follows_the_robot_near_their_place(scenario: str) -> None:
    for value, robot in (("robot", "quad"), ("robot:rover", "rover")):
        choices = Choices(localize=True, robot=robot_of(value))
        planned = scenario_launches(read_scenario(scenario), choices, 1)
        configs = {launch.instance: launch.config.model_dump() for launch in planned}
        localizer = configs["localizer.user1"]
        assert (localizer["method"], localizer["robot_id"]) == ("moving_target", robot)
        assert localizer["window_s"] == 10.0
        assert configs["supervisor.user1"]["localization_method"] == "moving_target"
        assert configs[f"robot.{robot}"]["figure"]["people_m"] == ((3.0, 0.4, 0.0),)
        assert configs["user-sim.user1"]["yaw_deg"] is None


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        (Choices(localize=True, robot="arm"), "--localize robot:arm: .* no such robot; it has quad, rover"),
        (Choices(localize=True, robot="", targets=3), "--targets 3: --localize robot has no lamps"),
    ],
)
def test_contradictory_options_are_rejected(scenario: str, choices: Choices, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        scenario_launches(read_scenario(scenario), choices, 1)
    with pytest.raises(ConfigError, match=r"--localize robot: .* has no robot"):
        scenario_launches(read_scenario("scenario_1"), Choices(localize=True, robot=""), 1)


def person(choices: Choices, index: int = 0, scenario: str = "scenario_2") -> dict[str, dict[str, Any]]:
    """Return one person's parameters by service."""
    launches: list[Launch] = user_launches(read_scenario(scenario), choices, f"user{index + 1}", index)
    return {launch.service.NAME: launch.config.model_dump() for launch in launches}


def test_a_pose_is_read_in_metres_and_degrees() -> None:
    assert pose("2,0.5") == FloorPose(x_m=2.0, y_m=0.5)
    assert pose("-1.5, 3e0,-90") == FloorPose(x_m=-1.5, y_m=3.0, yaw_deg=-90.0)
    assert pose("450000,-5000.5") == FloorPose(x_m=450_000.0, y_m=-5000.5)  # as far as in a map


@pytest.mark.parametrize("text", ["", "1", "1,2,3,4", "a,b", "nan,0", "inf,1", "1000001,0", "0,0,361", "1;2"])
def test_another_pose_is_refused_with_an_example_or_the_range(text: str) -> None:
    with pytest.raises(click.BadParameter, match=r"such as 2\.0,0\.5,20|are metres to 1,000,000"):
        pose(text)


def test_options_as_typed() -> None:
    arguments = "--targets 3 --pose -1,2 --pose 3,4,5 --hand left --stature 1.6"
    typed: Choices = CliRunner().invoke(command, arguments, standalone_mode=False).return_value
    assert (typed.targets, typed.hand, typed.stature_m) == (3, "left", 1.6)
    assert typed.poses == (FloorPose(x_m=-1.0, y_m=2.0), FloorPose(x_m=3.0, y_m=4.0, yaw_deg=5.0))


def test_people_without_a_pose_stand_at_places_of_the_scenario() -> None:
    choices = Choices(poses=(FloorPose(x_m=1.0, y_m=-2.0, yaw_deg=30.0), FloorPose(x_m=0.5, y_m=0.0)))
    for index, (place, yaw_deg) in enumerate([((1.0, -2.0, 0.0), 30.0), ((0.5, 0.0, 0.0), 0.0)]):
        services = person(choices, index)
        for name in ("localizer", "user-sim"):
            assert (services[name]["position_m"], services[name]["yaw_deg"]) == (place, yaw_deg)
        assert services["localizer"]["method"] == "fixed"
    assert person(choices, 2)["localizer"] == person(Choices(), 2)["localizer"]
    one = Choices(imu=("simulated",), poses=(FloorPose(x_m=7.0, y_m=8.0),)).of_one(2)
    assert person(one, 2)["localizer"]["position_m"] == (7.0, 8.0, 0.0)
    assert person(one, 2)["imu-bridge"]["source"] == "simulated"
    assert Choices().of_one(2) == Choices()


def test_simulated_pose_of_a_localized_person_is_kept_from_services() -> None:
    choices = Choices(localize=True, poses=(FloorPose(x_m=1.0, y_m=2.0),))
    services = person(choices)
    assert services["user-sim"]["position_m"] == (1.0, 2.0, 0.0)
    assert services["user-sim"]["yaw_deg"] is None
    assert services["localizer"]["method"] == "static_targets"
    assert services["localizer"]["position_m"] != (1.0, 2.0, 0.0)
    assert services["supervisor"]["localize"] is True
    given = Choices(localize=True, poses=(FloorPose(x_m=1.0, y_m=2.0, yaw_deg=40.0),))
    assert person(given)["user-sim"]["yaw_deg"] == 40.0
    with pytest.raises(ConfigError, match=r"--pose 1,2: --localize finds the pose"):
        person(Choices(localize=True, imu=("serial:/dev/x",), poses=(FloorPose(x_m=1.0, y_m=2.0),)))


def test_targets_go_to_the_localizer() -> None:
    assert person(Choices(localize=True, targets=3))["localizer"]["targets"] == 3
    usual = person(Choices(localize=True))["localizer"]["enough"]
    assert person(Choices(localize=True, targets=3))["localizer"]["enough"] == usual  # it counts for itself
    typed = Choices(localize=True, targets=3, settings=("localizer.targets=2", "localizer.enough.yaw_deg=9"))
    assert person(typed)["localizer"]["targets"] == 2
    assert person(typed)["localizer"]["enough"]["yaw_deg"] == 9.0
    with pytest.raises(ConfigError, match=r"--targets 3: add --localize"):
        person(Choices(targets=3))


def test_localized_simulated_person_drifts_and_corrects_unlike_the_default() -> None:
    plain = person(Choices())["user-sim"]
    localized = person(Choices(localize=True))["user-sim"]
    assert (plain["wristband"]["yaw_rate_bias_sd_degps"], plain["anchor_when_off_deg"]) == (0.05, 0.0)
    assert localized["wristband"]["yaw_rate_bias_sd_degps"] == 0.25
    assert (localized["anchor_when_off_deg"], localized["aim"]) == (10.0, plain["aim"])


def test_hand_and_stature_are_the_profiles_and_the_bodys() -> None:
    services = person(Choices(hand="left", stature_m=1.6))
    profile = services["supervisor"]["profile"]
    body = services["user-sim"]["body"]
    assert profile["hand"] == body["hand"] == "left"
    assert profile["stature_m"] == 1.6
    assert body["footprint_to_neck_m"] == pytest.approx(1.43 * 1.6 / 1.835, abs=1e-3)
    assert body["shoulder_to_wrist_m"] == pytest.approx(0.55 * 1.6 / 1.835, abs=1e-3)


def test_set_wins_over_every_option() -> None:
    settings = (
        *("user-sim.yaw_deg=5", "user-sim.body.hand=right", "user-sim.wristband.yaw_drift_degpmin=15"),
        *("localizer.method=fixed", "localizer.position_m=[9, 9, 0]"),
    )
    services = person(Choices(localize=True, hand="left", settings=settings))
    simulated = services["user-sim"]
    localizer = services["localizer"]
    assert (simulated["yaw_deg"], simulated["body"]["hand"]) == (5.0, "right")
    assert services["supervisor"]["profile"]["hand"] == "left"
    assert simulated["wristband"]["yaw_drift_degpmin"] == 15.0
    assert simulated["wristband"]["yaw_rate_bias_sd_degps"] == 0.25
    assert (localizer["method"], localizer["position_m"]) == ("fixed", (9.0, 9.0, 0.0))


SECURED = SimpleNamespace(link=SimpleNamespace(endpoints=("tls/hall:7450",)))


@pytest.mark.parametrize(
    ("credentials", "arguments", "connect"),
    [
        (None, [], ()),
        (None, ["--connect", "tcp/hall:7450"], ("tcp/hall:7450",)),
        (SECURED, [], ("tls/hall:7450",)),
    ],
)
def test_address_of_a_run_is_reported_if_it_listens(
    credentials: object,
    arguments: list[str],
    connect: tuple[str, ...],
    plans: list[Plan],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for module in (run_command, run_options):
        monkeypatch.setattr(module, "given_credentials", lambda: credentials)
    result = CliRunner().invoke(run_command.run, ["--ros2", "--no-web", *arguments])
    assert result.exception is None, result.output
    assert plans[0].link.connect == connect
    assert plans[0].link.listen == (() if connect else (run_options.BESIDE_ROS,))
    assert any(f"--connect {run_options.BESIDE_ROS}" in note for note in plans[0].notes) == (not connect)


@pytest.mark.parametrize(("arguments", "count"), [(["--users", "0"], 1), (["--site-only"], 1), ([], 0)])
def test_run_without_people_says_how_to_add_one(arguments: list[str], count: int, plans: list[Plan]) -> None:
    result = CliRunner().invoke(run_command.run, ["--no-web", *arguments])
    assert result.exception is None, result.output
    assert sum("pointit person add" in note for note in plans[0].notes) == count


def test_without_a_view_each_warning_is_told_once_in_full() -> None:
    rejected = Problem(code="connection", sentence="Home Assistant rejects the token: make another")
    note = Problem(code="nobody", sentence="nobody moves the arm", severity="note")
    problems = (rejected, note)
    health = Health(stamp_ns=0, service="home-assistant", instance="home-assistant", pid=1, problems=problems)
    shown = set[tuple[str, ...]]()
    sentence = "home-assistant: Home Assistant rejects the token: make another"
    assert run_command.new_warnings({"home-assistant": health}, shown) == [sentence]
    assert run_command.new_warnings({"home-assistant": health}, shown) == []
