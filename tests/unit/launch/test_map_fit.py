"""Whether a run is refused, and a scenario not offered, where the map lacks what it needs."""

from pathlib import Path

import pytest

from pointit.launch.plan.launches import Choices
from pointit.launch.plan.scenario import read_scenario, scenario_names
from pointit.launch.plan.scenario_catalog import ScenarioCatalog, scenario_launches
from pointit.maps.file import load_map
from pointit.runtime.errors import ConfigError
from pointit.services.conveyor_sim.config import ConveyorSimConfig
from pointit.services.localizer.config import LocalizerConfig

ROOM = """
leds: {a: {position: [0, 0, 1]}, b: {position: [1, 2, 1]}}
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
    return ScenarioCatalog.beginning_with("scenario_2", "scenario_2", scenario, choices).offered


@pytest.mark.parametrize("name", scenario_names())
@pytest.mark.parametrize("localize", [False, True])
def test_shipped_scenario_fits_its_map(name: str, localize: bool) -> None:  # noqa: FBT001 - pytest's
    assert scenario_launches(read_scenario(name), Choices(localize=localize), 2)
    assert set(offered()) == set(scenario_names())


def test_refusal_names_the_belt_and_the_option(tmp_path: Path) -> None:
    choices = Choices(settings=[f"pui.map={written(tmp_path, ROOM)}"])
    with pytest.raises(
        ConfigError,
        match=r"^conveyor-sim: feeders\.entry: map 'room' has no belt 'part_e', there are main, next; "
        r"set conveyor-sim\.feeders\.entry\.belt, or choose another map: pui\.map$",
    ):
        scenario_launches(read_scenario("scenario_4"), choices, 1)


def test_scenario_is_offered_where_its_feeder_names_a_belt_of_the_map(tmp_path: Path) -> None:
    room = f"pui.map={written(tmp_path, ROOM)}"
    assert set(offered(room)) == {
        *("scenario_1", "scenario_2", "scenario_3", "scenario_5", "scenario_6"),
        "send_a_robot",
    }
    assert "scenario_4" in offered(room, "conveyor-sim.feeders.entry.belt=main")


def test_feeders_of_a_file_replace_those_of_the_scenario(tmp_path: Path) -> None:
    feeders = "conveyor-sim: {feeders: {mine: {belt: main, sequence: [red], min_interval_s: 2}}}"
    file = written(tmp_path, feeders, "mine.yaml")
    choices = Choices(settings=[f"pui.map={written(tmp_path, ROOM)}"], files=[file])
    configs = [launch.config for launch in scenario_launches(read_scenario("scenario_4"), choices, 1)]
    (conveyor,) = [config for config in configs if isinstance(config, ConveyorSimConfig)]
    assert list(conveyor.feeders) == ["mine"]


def test_bay_that_a_map_of_several_bays_lacks_is_refused(tmp_path: Path) -> None:
    room = written(
        tmp_path, ROOM.replace("bays: {1: next}", "bays: {1: next, 2: main}").replace("links:", "#")
    )
    settings = [f"pui.map={room}", "conveyor-sim.feeders.entry.belt=main"]
    with pytest.raises(
        ConfigError,
        match=r"^conveyor-sim: bay_rest: map 'room' has no bay '3', there are 1, 2; "
        r"set conveyor-sim\.bay_rest$",
    ):
        scenario_launches(read_scenario("scenario_4"), Choices(settings=settings), 1)
    assert scenario_launches(
        read_scenario("scenario_4"), Choices(settings=[*settings, "conveyor-sim.bay_rest=2"]), 1
    )


def test_only_workspaces_and_lamps_are_offered_on_a_map_of_lamps(tmp_path: Path) -> None:
    lamps = written(tmp_path, "leds: {a: {position: [0, 0, 1]}, b: {position: [1, 2, 1]}}")
    assert set(offered(f"pui.map={lamps}")) == {"scenario_1", "scenario_5", "send_a_robot"}


@pytest.mark.parametrize(("leds", "count"), [("{}", "no lamps"), ("{a: {position: [0, 0, 1]}}", "1 lamp")])
def test_localizing_by_lamps_takes_two_lamps(tmp_path: Path, leds: str, count: str) -> None:
    strip = "strips: {1: {line: [[0, 0.3, 1], [4, 0.3, 1]], pixels: 120, direction: 1}}"
    room = written(tmp_path, f"leds: {leds}\n{strip}")
    choices = Choices(settings=[f"pui.map={room}"], localize=True)
    with pytest.raises(
        ConfigError, match=rf"^localizer\.user1: map 'room' has {count} and .* leave --localize out"
    ):
        scenario_launches(read_scenario("scenario_2"), choices, 1)


def test_map_that_cannot_be_read_is_told_as_by_pui(tmp_path: Path) -> None:
    room = written(tmp_path, "leds: [")
    with pytest.raises(ConfigError, match=r"^pui: .*room\.yaml: is not YAML"):
        scenario_launches(read_scenario("scenario_2"), Choices(settings=[f"pui.map={room}"]), 1)


def test_map_with_a_broken_bay_is_left_for_pui_to_tell(tmp_path: Path) -> None:
    room = written(tmp_path, ROOM.replace("bays: {1: next}", "bays: {1: nowhere}"))
    assert scenario_launches(read_scenario("scenario_4"), Choices(settings=[f"pui.map={room}"]), 1)
    with pytest.raises(ConfigError, match=r"room\.yaml: bays\.1\S* there is no belt 'nowhere'"):
        load_map(str(room), 0)


def test_localizing_by_a_moving_robot_takes_no_lamps(tmp_path: Path) -> None:
    room = written(tmp_path, ROOM.replace("leds: {a: {position: [0, 0, 1]}, b: {position: [1, 2, 1]}}", ""))
    settings = (f"pui.map={room}", "localizer.method=moving_target")
    configs = [
        launch.config
        for launch in scenario_launches(read_scenario("scenario_2"), Choices(settings=settings), 1)
    ]
    (localizer,) = [config for config in configs if isinstance(config, LocalizerConfig)]
    assert localizer.method == "moving_target"
