"""A run of a site, and several people in it."""

import asyncio
import time
from pathlib import Path
from typing import Any

import pytest

from pointit.cli.recordings.run_recorder import recorded, recorder_launch
from pointit.diagnosis.observation import start_command
from pointit.launch.plan.launches import CURSOR_COLORS, Choices, check_settings, shard_launches, site_launches
from pointit.launch.plan.plan import USUAL, Plan, Scenario
from pointit.launch.run.processes import Processes
from pointit.launch.run.run_site import LISTEN_S, ViewerPresence, check_names, moved_notice, surroundings
from pointit.launch.run.running_scenario import DeploymentPublisher
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.link import SILENT_S, Link
from pointit.runtime.service.service import Launch, check_launches
from pointit.schemas import Deployment, ExpectedService, Figure, Health, KeyNameError, UserProfile
from pointit.schemas.topics import DEPLOYMENT, PROFILE, SERVICE_ALIVE, SHARD_ALIVE
from pointit.services.pointing.service import Pointing
from pointit.services.pui.config import PuiConfig
from pointit.services.pui.service import Pui
from pointit.services.selector.config import SelectorConfig
from tests.support.bench import until
from tests.support.recorded import session, write_recording


def runs(bus: MemoryBus, name: str) -> None:
    """Publish a deployment as `run` and `user` do; a person's has no scenario."""
    scenario, key = ("", name) if name == "anna" else (name, f"run.{name}")
    bus.publisher(DEPLOYMENT, key).put(Deployment(stamp_ns=1, name=name, scenario=scenario))


@pytest.mark.parametrize(
    ("names", "scenario"),
    [
        (["scenario_4", "anna"], "scenario_4"),
        (["scenario_1"], "scenario_1"),
        ([], USUAL),
        (["mine"], USUAL),
        (["scenario_1", "scenario_2"], USUAL),
    ],
)
async def test_surroundings_are_the_scenario_of_the_joined_site(
    names: list[str], scenario: str, bus: MemoryBus
) -> None:
    for name in names:
        runs(bus, name)
    assert await surroundings(bus) == (scenario, 1)


@pytest.mark.parametrize(
    ("site", "options"),
    [
        ("lab", "--connect tcp/[::]:7448, and start one of two runs on the same machine with --site NAME"),
        ("hall", "--site hall --connect tcp/[::]:7448"),
    ],
)
def test_moved_run_notice_advises_a_site_only_when_none_was_named(site: str, options: str) -> None:
    notice = moved_notice(Link(site=site, listen=("tcp/[::]:7447",)), "tcp/[::]:7448")
    assert notice.endswith(f"so this run listens at tcp/[::]:7448. Give other commands {options}")


async def test_surroundings_have_the_first_free_colour(bus: MemoryBus) -> None:
    for user, color in (("user1", CURSOR_COLORS[0]), ("ben", CURSOR_COLORS[2])):
        bus.publisher(PROFILE, user).put(UserProfile(stamp_ns=1, cursor_color=color))
    assert await surroundings(bus) == (USUAL, 2)


async def test_person_may_not_have_the_name_of_anothers_shard(
    monkeypatch: pytest.MonkeyPatch, bus: MemoryBus
) -> None:
    monkeypatch.setattr("pointit.launch.run.run_site.SILENT_S", 0.01)
    for instance in ("pui", "pui.hall", "pui.anna", "robot.quad", "pointing.carl"):
        bus.announce(SERVICE_ALIVE, instance)
    for served in ("pui.anna", "pui.ben"):
        bus.announce(SHARD_ALIVE, served)
    await check_names(bus, ["anna", "ben", "carl", "quad"])
    with pytest.raises(ConfigError, match=r"^hall: pui.hall on site .* is a shard that serves nobody"):
        await check_names(bus, ["anna", "hall"])


async def test_name_check_waits_for_a_shard_about_to_serve(bus: MemoryBus) -> None:
    bus.announce(SERVICE_ALIVE, "selector.anna")
    asyncio.get_running_loop().call_later(LISTEN_S + 0.2, bus.announce, SHARD_ALIVE, "selector.anna")
    await check_names(bus, ["anna"])


def health(viewers: float | None, service: str = "web") -> Health:
    figures = () if viewers is None else (Figure(name="viewers", value=viewers),)
    return Health(stamp_ns=1, service=service, instance=f"{service}.2", pid=1, figures=figures)


def test_viewers_are_present_until_the_page_has_been_silent() -> None:
    onlookers = ViewerPresence()
    assert onlookers.until_s <= 0.0
    assert onlookers.on_health(health(2.0), 10.0)
    assert onlookers.until_s > 10.0 + SILENT_S - 0.1
    assert not onlookers.on_health(health(0.0), 11.0)  # closed, or only reloaded
    assert onlookers.until_s > 10.0 + SILENT_S - 0.1
    assert onlookers.until_s <= 10.0 + SILENT_S


PLAN = Plan(name="anna", person="anna", launches=(), link=Link())
LINES = [
    (Launch(service=Pointing, config=Pointing.CONFIG(), user="anna"), ("pointit", "person", "add", "anna"))
]
AWAY_NS = 10**9


def posted(bus: MemoryBus) -> tuple[DeploymentPublisher, list[Deployment]]:
    """Tell of anna's run; return what tells it, and all that is told under her name."""
    told: list[Deployment] = []
    bus.subscribe(DEPLOYMENT, lambda deployment, _name: told.append(deployment), "anna")
    notice = DeploymentPublisher(bus)
    notice.post(PLAN, LINES)
    return notice, told


def other(stamp_ns: int) -> Deployment:
    services = (ExpectedService(service="pointing", user="anna", command=("elsewhere",)),)
    return Deployment(stamp_ns=stamp_ns, name="anna", services=services)


async def test_retracted_deployment_has_no_services(bus: MemoryBus) -> None:
    notice, told = posted(bus)
    await until(lambda: len(told) == 1, what="the run")
    notice.retract()
    await until(lambda: len(told) == 2, what="its end")
    assert [len(each.services) for each in told] == [1, 0]
    notice.retract()


async def test_newer_deployment_of_another_process_is_not_retracted(bus: MemoryBus) -> None:
    notice, told = posted(bus)
    bus.publisher(DEPLOYMENT, "anna").put(other(time.time_ns() + AWAY_NS))
    await until(lambda: bool(told) and told[-1].services[0].command == ("elsewhere",), what="the other one")
    later: list[str] = []
    bus.subscribe(DEPLOYMENT, lambda _deployment, name: later.append(name), "ben")
    notice.retract()
    bus.publisher(DEPLOYMENT, "ben").put(other(0))
    await until(lambda: bool(later), what="what is told after it")
    assert all(each.services for each in told)


def test_truncated_recording_is_not_reported_as_a_success(tmp_path: Path) -> None:
    launch = recorder_launch(tmp_path / "session.mcap")
    assert "is not there" in recorded(launch)
    write_recording(tmp_path / "session.mcap", session("scenario_1", 1.0))
    content = (tmp_path / "session.mcap").read_bytes()
    assert recorded(launch).endswith(" MB")
    (tmp_path / "session.mcap").write_bytes(content[:-100])
    assert recorded(launch).endswith("cut off; the log says why")


@pytest.mark.parametrize(
    ("file", "sentence"),
    [
        ("/proc/x.mcap", r"/proc/x\.mcap: cannot be written \(.+\); record in another folder"),
        ("/none/x.mcap", "its folder does not exist; create it, or record elsewhere"),
        ("/proc", "/proc is a folder; give a file in it, such as /proc/session.mcap"),
    ],
)
def test_unwritable_file_is_refused_before_anything_starts(file: str, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        check_launches([recorder_launch(Path(file))])


def test_a_check_leaves_no_file(tmp_path: Path) -> None:
    check_launches([recorder_launch(tmp_path / "x.mcap")])
    assert list(tmp_path.iterdir()) == []


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


def test_setting_of_a_driver_is_not_applied_to_a_robot() -> None:
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


def test_shards_have_the_scenarios_parameters_and_the_sites_map() -> None:
    pui, selector = shards("pui", "selector", "led_driver")
    assert (pui.instance, selector.instance) == ("pui.anna", "selector.anna")
    room = pui.config
    deciding = selector.config
    assert isinstance(room, PuiConfig)
    assert isinstance(deciding, SelectorConfig)
    assert (room.map_to_read, room.surfaces, room.people) == ("", ("strip",), ("anna",))
    assert (deciding.method, deciding.people) == ("hold", ("anna",))
    assert [launch.user for launch in (pui, selector)] == ["", ""]
    check_launches([pui, selector])


def test_persons_shard_has_the_set_map_and_their_own_settings() -> None:
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


def test_shared_service_may_run_twice_and_a_shard_once() -> None:
    assert not Launch(service=Pui, config=PuiConfig()).is_single
    assert Launch(service=Pui, config=PuiConfig(people=("anna",)), name="anna").is_single


def test_command_restarts_the_named_instance() -> None:
    assert start_command("robot", "quad") == "pointit service run robot --name quad"
    assert start_command("robot") == "pointit service run robot"
    (launch,) = site_launches(scenario(robot_quad={}), Choices())
    command = Processes([launch], site="lab", connect="tcp/a:1").command(launch)
    assert command[command.index("--name") + 1] == "quad"
