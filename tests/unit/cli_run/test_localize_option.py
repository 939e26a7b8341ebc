"""`--localize` with and without a value, and what it means for a run."""

from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from pointit.cli.common.panels import PanelCommand
from pointit.cli.run.run_options import OPTIONAL, choices_of, shared_options
from pointit.launch.plan.launches import Choices, robot_of
from pointit.launch.plan.scenario import read_scenario
from pointit.launch.plan.scenario_catalog import scenario_launches
from pointit.runtime.errors import ConfigError

SCENARIO = """
about: robots
places: [{position_m: [3.0, 0.4, 0.0], yaw_deg: 20.0}]
site:
  pui: {map: lab}
  robot.quad: {kind: quadrotor}
  robot.rover: {}
user: {pointing: {}, localizer: {}, supervisor: {}, user-sim: {}}
"""


@click.command(cls=PanelCommand, panels={}, optional=OPTIONAL)
@click.argument("scenario", default="usual")
@shared_options
def command(scenario: str, **options: object) -> None:
    """Print what the options mean."""
    choices = choices_of(options)
    click.echo(f"{scenario} {choices.localize} {choices.robot}")


@pytest.mark.parametrize(
    ("arguments", "meaning"),
    [
        ([], "usual False None"),
        (["--localize"], "usual True None"),
        (["--localize", "mine.yaml"], "mine.yaml True None"),
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


@pytest.mark.parametrize(
    "arguments",
    [["--localize=stars"], ["mine.yaml", "--localize", "stars"], ["--localize", "stars", "mine.yaml"]],
    ids=" ".join,
)
def test_another_value_is_refused(arguments: list[str]) -> None:
    result = CliRunner().invoke(command, arguments)
    assert result.exit_code == 2
    assert "'stars' is no way to localize; write lamps, robot or robot:NAME" in result.output


def test_an_argument_too_many_is_named_when_localize_has_its_value() -> None:
    result = CliRunner().invoke(command, ["mine.yaml", "--localize", "lamps", "stars"])
    assert result.exit_code == 2
    assert "unexpected extra argument (stars)" in result.output


@pytest.fixture
def scenario(tmp_path: Path) -> str:
    path = tmp_path / "robots.yaml"
    path.write_text(SCENARIO, encoding="utf-8")
    return str(path)


def test_the_person_follows_the_robot_and_the_robot_knows_about_where_they_stand(scenario: str) -> None:
    for value, robot in (("robot", "quad"), ("robot:rover", "rover")):
        choices = Choices(localize=True, robot=robot_of(value))
        planned = scenario_launches(read_scenario(scenario), choices, 1)
        configs = {launch.instance: launch.config.model_dump() for launch in planned}
        localizer = configs["localizer.user1"]
        assert (localizer["method"], localizer["robot_id"], localizer["window_s"]) == (
            "moving_target",
            robot,
            10.0,
        )
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
def test_what_cannot_be_is_refused(scenario: str, choices: Choices, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        scenario_launches(read_scenario(scenario), choices, 1)
    with pytest.raises(ConfigError, match=r"--localize robot: .* has no robot"):
        scenario_launches(read_scenario("scenario_1"), Choices(localize=True, robot=""), 1)
