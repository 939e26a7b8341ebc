"""Several of a service on one site, each under a name of its own."""

from pathlib import Path
from typing import Any

import pytest

from pointit.diagnosis.observation import start_command
from pointit.launch.plan.launches import Choices, check_settings, shard_launches, site_launches
from pointit.launch.plan.plan import Scenario
from pointit.launch.run.running_scenario import Processes
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch, check_launches
from pointit.schemas import KeyNameError
from pointit.services.pui.config import PuiConfig
from pointit.services.pui.service import Pui
from pointit.services.selector.config import SelectorConfig

PLACES = [{"position_m": [0.0, 0.0, 0.0]}]


def scenario(**site: dict[str, Any]) -> Scenario:
    named = {name.replace("_", ".", 1): parameters for name, parameters in site.items()}
    return Scenario.model_validate({"about": "a", "places": PLACES, "site": named}, strict=False)


def parameters(launches: list[Launch], name: str) -> list[Any]:
    return [launch.config.model_dump()[name] for launch in launches]


def test_each_has_its_name_and_parameters() -> None:
    launches = site_launches(scenario(robot_quad={"kind": "quadrotor"}, robot_cart={}), Choices())
    assert [launch.instance for launch in launches] == ["robot.quad", "robot.cart"]
    assert parameters(launches, "kind") == ["quadrotor", "ground"]
    assert all(launch.is_single for launch in launches)


def test_parameters_are_set_for_one_or_for_all(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text("robot.cart: {radius_m: 0.4}\nrobot: {radius_m: 0.3, hover_m: 0.5}\n", encoding="utf-8")
    choices = Choices(files=[file], settings=["robot.cart.max_speed_mps=0.3", "robot.keep_out_m=2"])
    launches = site_launches(scenario(robot_quad={}, robot_cart={}), choices)
    check_settings(launches, choices)
    assert parameters(launches, "radius_m") == [0.3, 0.4]
    assert parameters(launches, "hover_m") == [0.5, 0.5]
    assert parameters(launches, "max_speed_mps") == [1.0, 0.3]
    assert parameters(launches, "keep_out_m") == [2.0, 2.0]


def test_a_setting_of_a_driver_is_not_taken_for_one_of_a_robot() -> None:
    choices = Choices(settings=["robot.sim.seed=3"])
    (launch,) = site_launches(scenario(robot_quad={}), choices)
    check_settings([launch], choices)
    section: Any = launch.config
    assert section.section("sim").seed == 3


def test_a_setting_of_an_absent_one_is_refused() -> None:
    choices = Choices(settings=["robot.car.max_speed_mps=1"])
    launches = site_launches(scenario(robot_quad={}), choices)
    with pytest.raises(ConfigError, match=r"robot\.car is not among what this starts: robot\.quad"):
        check_settings(launches, choices)


@pytest.mark.parametrize(
    ("site", "sentence"),
    [
        ({"keeper_two": {}}, r"keeper\.two: a site has one keeper; leave out 'two'"),
        ({"robot_a b": {}}, r"name 'a b': use 1 to 64 letters"),
        ({"rowbot_a": {}}, "no service 'rowbot'"),
    ],
)
def test_a_name_that_cannot_be_is_refused(site: dict[str, dict[str, Any]], sentence: str) -> None:
    with pytest.raises((ConfigError, KeyNameError), match=sentence):
        site_launches(scenario(**site), Choices())


def shards(*sites: str, **choices: Any) -> list[Launch]:
    parameters: dict[str, dict[str, Any]] = {
        "pui": {"map": "arena", "surfaces": ["strip"]},
        "selector": {"method": "hold"},
        "led_driver": {},
    }
    chosen = {name.replace("_", "-"): parameters[name] for name in sites}
    made = Scenario.model_validate({"about": "a", "places": PLACES, "site": chosen}, strict=False)
    return shard_launches(made, Choices(**choices), "anna")


def test_a_persons_shards_have_the_parameters_of_the_scenario_and_the_map_of_the_site() -> None:
    pui, selector = shards("pui", "selector", "led_driver")
    assert (pui.instance, selector.instance) == ("pui.anna", "selector.anna")
    room, deciding = pui.config, selector.config
    assert isinstance(room, PuiConfig)
    assert isinstance(deciding, SelectorConfig)
    assert (room.map_to_read, room.surfaces, room.people) == ("", ("strip",), ("anna",))
    assert (deciding.method, deciding.people) == ("hold", ("anna",))
    assert [launch.user for launch in (pui, selector)] == ["", ""]
    check_launches([pui, selector])


def test_a_person_has_shards_of_what_the_scenario_has_and_the_map_that_is_set() -> None:
    (pui,) = shards("pui", settings=["pui.map=lab", "pui.anna.tolerance_deg=3"])
    room = pui.config
    assert isinstance(room, PuiConfig)
    assert (room.map_to_read, room.tolerance_deg) == ("lab", 3.0)


@pytest.mark.parametrize(
    ("name", "people", "sentence"),
    [("two", (), r"pui\.two: people: name whom pui\.two serves"), ("", ("anna",), r"start pui\.NAME")],
)
def test_a_shard_has_a_name_and_people(name: str, people: tuple[str, ...], sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        check_launches([Launch(service=Pui, config=PuiConfig(people=people), name=name)])


def test_of_what_serves_all_two_may_run_and_of_a_shard_one() -> None:
    assert not Launch(service=Pui, config=PuiConfig()).is_single
    assert Launch(service=Pui, config=PuiConfig(people=("anna",)), name="anna").is_single


def test_its_command_starts_that_one_again() -> None:
    assert start_command("robot", "quad") == "pointit service run robot --name quad"
    assert start_command("robot") == "pointit service run robot"
    (launch,) = site_launches(scenario(robot_quad={}), Choices())
    command = Processes([launch], site="lab", connect="tcp/a:1").command(launch)
    assert command[command.index("--name") + 1] == "quad"
