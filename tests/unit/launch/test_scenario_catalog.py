"""Plan that results from a request for another scenario."""

import re
from pathlib import Path
from typing import Any

import pytest

from pointit.launch.plan.launches import Choices
from pointit.launch.plan.plan import FloorPose, Plan, read_scenario, scenario_names
from pointit.launch.plan.scenario_catalog import ScenarioCatalog, scenario_launches
from pointit.maps.file import load_map
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.link import Link
from pointit.schemas import RunScenario
from pointit.services.localizer.config import LocalizerConfig


def beginning(
    source: str = "scenario_4", choices: Choices | None = None, people: int = 1, **said: Any
) -> tuple[ScenarioCatalog, Plan]:
    scenario = read_scenario(source)
    chosen = choices or Choices(page=True)
    name = Path(source).stem
    program = ScenarioCatalog.beginning_with(name, source, scenario, chosen)
    plan = Plan(
        name=name,
        scenario=name,
        launches=scenario_launches(scenario, chosen, people),
        link=Link(),
        localizes=chosen.localize,
        offers=program.offered,
        duration_s=scenario.duration_s,
        **said,
    )
    return program, plan


def wish(source: str = "scenario_2", choices: Choices | None = None, people: int = 1, **asked: Any) -> Plan:
    program, plan = beginning(choices=choices, people=people)
    return program.plan(RunScenario(scenario=source, **asked), plan)


def config_of(plan: Plan, instance: str) -> dict[str, Any]:
    (launch,) = (launch for launch in plan.launches if launch.instance == instance)
    values: dict[str, Any] = launch.config.model_dump()
    return values


@pytest.mark.parametrize("name", scenario_names())
def test_every_shipped_scenario_can_be_asked_for(name: str) -> None:
    plan = wish(name, people=2)
    scenario = read_scenario(name)
    assert (plan.name, plan.scenario, plan.target_kinds) == (name, name, scenario.target_kinds)
    assert plan.duration_s == scenario.duration_s
    assert plan.users == ["user1", "user2"]
    assert config_of(plan, "pui")["map"] == scenario.site["pui"]["map"]
    assert config_of(plan, "imu-bridge.user2")["source"] == "page"
    assert plan.notes == ()


def test_people_and_localizing_are_as_asked_or_as_now() -> None:
    as_now = wish(people=3, choices=Choices(localize=True))
    assert as_now.users == ["user1", "user2", "user3"]
    assert as_now.localizes
    assert config_of(as_now, "localizer.user3")["method"] == "static_targets"
    asked = wish(people=3, choices=Choices(localize=True, targets=3), users=1, localizes=False)
    assert asked.users == ["user1"]
    assert not asked.localizes
    assert config_of(asked, "localizer.user1")["method"] == "fixed"
    assert wish(users=0).users == []
    program, plan = beginning()
    second = program.plan(RunScenario(scenario="scenario_2", users=4, localizes=True), plan)
    third = program.plan(RunScenario(scenario="scenario_3"), second)
    assert (len(third.users), third.localizes) == (4, True)


def test_choices_are_kept_in_scenarios_that_they_fit() -> None:
    settings = [
        "selector.window_s=0.7",
        "pui.tolerance_deg=7",
        "imu-bridge.yaw_origin_deg=3",
        "web.rate_hz=9",
    ]

    choices = Choices(settings=settings, method="hold", page=True)
    there = wish("scenario_3", choices)
    assert config_of(there, "selector")["window_s"] == 0.7
    assert config_of(there, "selector")["method"] == "hold"
    assert there.notes == ()

    lacking = wish("scenario_2", choices)
    assert config_of(lacking, "pui")["tolerance_deg"] == 7
    assert config_of(lacking, "imu-bridge.user1")["yaw_origin_deg"] == 3
    assert lacking.notes == (
        "--set selector.window_s=0.7 is ignored: scenario_2.yaml has no selector",
        "--method hold is ignored: scenario_2.yaml has no selector",
    )


def test_devices_stay_with_their_persons_and_poses_with_their_room() -> None:
    poses = [FloorPose(x_m=-1.0, y_m=-1.0), FloorPose(x_m=-2.0, y_m=-1.0)]
    choices = Choices(imu=["sim", "serial:/dev/ttyUSB7"], poses=poses)
    plan = wish("scenario_2", choices, people=2)
    assert config_of(plan, "imu-bridge.user2")["serial"]["port"] == "/dev/ttyUSB7"
    place = read_scenario("scenario_2").places[1]
    assert config_of(plan, "localizer.user2")["position_m"] == place.position_m
    assert plan.notes[0].startswith("--pose is ignored: it is for another map; people stand where scenario_2")
    assert plan.notes[1].startswith("user2 is assumed to stand at ")
    same_room = wish("scenario_4", choices, people=2)
    assert config_of(same_room, "localizer.user2")["position_m"] == (-2.0, -1.0, 0.0)
    found = wish("scenario_4", choices, people=2, localizes=True)
    assert config_of(found, "localizer.user2")["method"] == "static_targets"
    assert config_of(found, "user-sim.user1")["position_m"] == (-1.0, -1.0, 0.0)


def test_a_wish_that_cannot_be_is_refused_with_a_sentence() -> None:
    with pytest.raises(ConfigError, match=r"no scenario 'nope'; there are scenario_1, .*, shelf$"):
        wish("nope")
    with pytest.raises(ConfigError, match=r"^no scenario '/etc/passwd\.yaml'; there are"):
        wish("/etc/passwd.yaml")  # only what was shipped or typed here
    with pytest.raises(ConfigError, match=r"^pui: /nowhere\.yaml: cannot be read"):
        wish("scenario_2", Choices(settings=["pui.map=/nowhere.yaml"]))


def test_a_scenario_of_ones_own_can_be_come_back_to(tmp_path: Path) -> None:
    text = "about: mine\nduration_s: 9\nplaces: [{position_m: [0, 0, 0]}]\n"
    mine = written(tmp_path, f"{text}site: {{pui: {{map: lab}}}}\nuser: {{pointing: {{}}}}\n", "mine.yaml")
    program, plan = beginning(str(mine))
    assert {each.name for each in plan.offers} == {*scenario_names(), "mine"}
    (own,) = (each for each in plan.offers if not each.is_shipped)
    assert (own.name, own.title, own.about) == ("mine", "mine", "mine")
    other = program.plan(RunScenario(scenario="scenario_1"), plan)
    back = program.plan(RunScenario(scenario="mine"), other)
    assert (back.name, back.duration_s) == ("mine", 9.0)


def test_a_duration_that_was_asked_for_stays() -> None:
    program, plan = beginning(is_limited=True)
    assert program.plan(RunScenario(scenario="scenario_2"), plan).duration_s == plan.duration_s


def test_map_is_refused_as_a_scenario_with_a_remedy(tmp_path: Path) -> None:
    path = written(tmp_path, "lamps:\n  led_0:\n    position: [3, 1, 2]\n", "my_room.yaml")
    with pytest.raises(ConfigError) as caught:
        read_scenario(str(path))
    assert str(caught.value).startswith(f"{path}: is a map, not a scenario; ")
    assert f"`pointit run scenario_2 --set pui.map={path}`" in str(caught.value)


def test_thing_with_a_missing_light_is_refused_at_the_start(tmp_path: Path) -> None:
    path = tmp_path / "my_room.yaml"
    path.write_text("strips: {shelf: {line: [[0, 0, 1], [2, 0, 1]], pixels: 9}}\n"
        "things: {nuts: {light: {strip: shelv, from: 0, to: 1}}}\n", encoding="utf-8")  # fmt: skip
    with pytest.raises(ConfigError, match=r"things.nuts.light.strip: there is no strip 'shelv'"):
        load_map(str(path), 0)
    beginning(str(path))  # does not fail before pui says that


ROOM = """
lamps: {a: {position: [0, 0, 1]}, b: {position: [1, 2, 1]}}
strips: {1: {line: [[0, 0.3, 1], [4, 0.3, 1]], pixels: 120, direction: 1}}
belts:
  main: {centerline: [[0, 0, 1], [2, 0, 1]], width: 0.5}
  next: {centerline: [[2.1, 0, 1], [4, 0, 1]], width: 0.5}
links: [{from: main, to: next}]
bays: {1: next}
"""


def written(folder: Path, text: str, name: str = "room.yaml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def offered(*settings: str, files: tuple[Path, ...] = ()) -> tuple[str, ...]:
    choices = Choices(settings=settings, files=files)
    scenario = read_scenario("scenario_2")
    offered = ScenarioCatalog.beginning_with("scenario_2", "scenario_2", scenario, choices).offered
    return tuple(each.name for each in offered)


def test_refusal_names_the_belt_and_the_option(tmp_path: Path) -> None:
    choices = Choices(settings=[f"pui.map={written(tmp_path, ROOM)}"])
    with pytest.raises(
        ConfigError,
        match=r"^conveyor-sim: feeders\.entry: map 'room' has no belt 'part_e', there are main, next; "
        r"--set conveyor-sim\.feeders\.entry\.belt=main, or choose another map: --set pui\.map=NAME$",
    ):
        scenario_launches(read_scenario("scenario_4"), choices, 1)


def test_scenario_is_offered_when_its_feeder_fits_the_map(tmp_path: Path) -> None:
    room = f"pui.map={written(tmp_path, ROOM)}"
    assert set(offered(room)) == {
        *("scenario_1", "scenario_2", "scenario_3", "scenario_5", "scenario_6"),
        *("send_a_robot", "shelf"),
    }
    assert "scenario_4" in offered(room, "conveyor-sim.feeders.entry.belt=main")


def test_bay_that_a_map_of_several_bays_lacks_is_refused(tmp_path: Path) -> None:
    bays = ROOM.replace("bays: {1: next}", "bays: {1: next, 2: main}")
    room = written(tmp_path, bays.replace("links:", "#"))
    settings = [f"pui.map={room}", "conveyor-sim.feeders.entry.belt=main"]
    said = "conveyor-sim: bay_rest: map 'room' has no bay '3', there are 1, 2; --set conveyor-sim.bay_rest=1"
    with pytest.raises(ConfigError, match=f"^{re.escape(said)}$"):
        scenario_launches(read_scenario("scenario_4"), Choices(settings=settings), 1)
    settings.append("conveyor-sim.bay_rest=2")
    assert scenario_launches(read_scenario("scenario_4"), Choices(settings=settings), 1)


@pytest.mark.parametrize(("lamps", "count"), [("{}", "no lamps"), ("{a: {position: [0, 0, 1]}}", "1 lamp")])
def test_localizing_by_lamps_takes_two_lamps(tmp_path: Path, lamps: str, count: str) -> None:
    strip = "strips: {1: {line: [[0, 0.3, 1], [4, 0.3, 1]], pixels: 120, direction: 1}}"
    room = written(tmp_path, f"lamps: {lamps}\n{strip}")
    choices = Choices(settings=[f"pui.map={room}"], localize=True)
    with pytest.raises(ConfigError, match=rf"^localizer.user1: map 'room' has {count} and .* --localize out"):
        scenario_launches(read_scenario("scenario_2"), choices, 1)


def test_localizing_by_a_moving_robot_takes_no_lamps(tmp_path: Path) -> None:
    room = written(tmp_path, ROOM.replace("lamps: {a: {position: [0, 0, 1]}, b: {position: [1, 2, 1]}}", ""))
    settings = (f"pui.map={room}", "localizer.method=moving_target")
    configs = [
        launch.config
        for launch in scenario_launches(read_scenario("scenario_2"), Choices(settings=settings), 1)
    ]
    (localizer,) = [config for config in configs if isinstance(config, LocalizerConfig)]
    assert localizer.method == "moving_target"
