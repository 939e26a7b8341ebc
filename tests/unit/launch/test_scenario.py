"""From a scenario's file and the command line to the services that start."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from pointit.cli.run.user import command as user
from pointit.launch.plan.launches import Choices, check_settings, site_launches, user_launches
from pointit.launch.plan.plan import read_scenario, scenario_names
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch, check_launches
from pointit.schemas import KeyNameError
from pointit.schemas.system import RUN
from pointit.schemas.text import hide_secrets
from pointit.schemas.topics import check_name
from pointit.services.registry import PROCESSES

GOOD = "about: a\nplaces: [{position_m: [0, 0, 0]}]\n"


def config_of(launches: Sequence[Launch], name: str) -> dict[str, Any]:
    (launch,) = (launch for launch in launches if launch.instance.split(".")[0] == name)
    values: dict[str, Any] = launch.config.model_dump()
    return values


def names(launches: Sequence[Launch]) -> set[str]:
    return {launch.instance for launch in launches}


def site(scenario: str = "scenario_3", **choices: Any) -> list[Launch]:
    return site_launches(read_scenario(scenario), Choices(**choices))


def person(name: str = "anna", index: int = 0, scenario: str = "scenario_3", **choices: Any) -> list[Launch]:
    return user_launches(read_scenario(scenario), Choices(**choices), name, index)


@pytest.fixture(autouse=True)
def plain_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for process in PROCESSES:
        monkeypatch.delenv(f"POINTIT_{process.name.upper().replace('-', '_')}__", raising=False)


@pytest.mark.parametrize("name", scenario_names())
@pytest.mark.parametrize("localize", [False, True])
def test_every_shipped_scenario_builds(name: str, localize: bool) -> None:
    scenario = read_scenario(name)
    choices = Choices(localize=localize)
    site = site_launches(scenario, choices)
    user = user_launches(scenario, choices, "anna")
    assert {"pui", "led-driver"} <= names(site)
    of_their_own = {"goal.anna"} if name in {"scenario_5", "scenario_6", "send_a_robot"} else set[str]()
    everybodys = {"pointing.anna", "localizer.anna", "supervisor.anna", "user-sim.anna"}
    assert everybodys | of_their_own == names(user)
    assert all(launch.service.SCOPE == "site" for launch in site)
    assert scenario.about.endswith(("m", "s"))
    assert scenario.duration_s is not None
    assert scenario.duration_s > 0


@pytest.mark.parametrize("name", scenario_names())
def test_a_shipped_scenario_can_be_started_for_several_people(name: str) -> None:
    scenario = read_scenario(name)
    launches = site_launches(scenario, Choices())
    for index in range(4):
        launches += user_launches(scenario, Choices(localize=True), f"user{index + 1}", index)
    check_launches(launches)


def test_selection_method_can_be_chosen_only_where_something_is_selected() -> None:
    assert config_of(site(method="hold"), "selector")["method"] == "hold"
    with pytest.raises(ConfigError, match=r"--method hold: nothing is selected in scenario_2\.yaml"):
        site("scenario_2", method="hold")


def test_people_get_places_and_seeds_of_their_own() -> None:
    scenario = read_scenario("scenario_3")
    people = [person(f"user{index + 1}", index, seed=40) for index in range(4)]
    for index, launches in enumerate(people):
        place = scenario.places[index % len(scenario.places)]
        simulated = config_of(launches, "user-sim")
        localizer = config_of(launches, "localizer")
        assert simulated["seed"] == 40 + index
        assert simulated["position_m"] == localizer["position_m"] == place.position_m
        assert simulated["yaw_deg"] == localizer["yaw_deg"] == place.yaw_deg
        services = ("pointing", "localizer", "supervisor", "user-sim")
        assert names(launches) == {f"{name}.user{index + 1}" for name in services}
    assert len(scenario.places) == 3
    assert people[3][0].config == people[0][0].config


@pytest.mark.parametrize(
    ("device", "source", "section", "field"),
    [
        ("serial:/dev/ttyUSB7", "serial", "serial", "port"),
        ("serial", "serial", None, None),
        ("replay:/tmp/a:b.csv", "replay", "replay", "recording"),
        ("simulated", "simulated", None, None),
    ],
)
def test_a_device_replaces_the_simulation(
    device: str, source: str, section: str | None, field: str | None
) -> None:
    imu = ["sim", device]
    first, second, third = (person(name, index, imu=imu) for index, name in enumerate("abc"))
    assert "user-sim.a" in names(first)
    assert "user-sim.b" not in names(second)
    assert config_of(second, "supervisor")["autostart"] is True  # nobody may be able to press
    assert config_of(first, "supervisor")["autostart"] is False
    by_hand = person("b", 1, imu=imu, settings=["supervisor.autostart=false"])
    assert config_of(by_hand, "supervisor")["autostart"] is False
    bridge = config_of(second, "imu-bridge")
    assert bridge["source"] == source
    if section is not None and field is not None:
        assert bridge[section][field] == device.partition(":")[2]
    assert "user-sim.c" in names(third)


@pytest.mark.parametrize("name", scenario_names())
def test_a_page_may_take_anybodys_wrist(name: str) -> None:
    imu = ["sim", "serial:/dev/ttyUSB7"]
    simulated, wearing = (person("a", index, name, imu=imu, page=True) for index in range(2))
    assert {"imu-bridge.a", "user-sim.a"} <= names(simulated)
    assert config_of(simulated, "imu-bridge")["source"] == "page"  # which only waits for one
    assert config_of(wearing, "imu-bridge")["source"] == "serial"
    assert "imu-bridge.a" not in names(person("a", scenario=name))


def test_ros_may_take_anybodys_wrist_without_a_page(tmp_path: Path) -> None:
    named = str(written(tmp_path / "a.yaml", GOOD + "site: {ros2: {}}\nuser: {user-sim: {}}\n"))
    for launches in (person("a", scenario="scenario_4", ros2=True), person("a", scenario=named)):
        assert {"imu-bridge.a", "user-sim.a"} <= names(launches)
        assert config_of(launches, "imu-bridge")["source"] == "page"  # it only waits for a wrist


@pytest.mark.parametrize("device", ["nonsense", "replay", "simulated:x", ""])
def test_another_device_is_refused(device: str) -> None:
    with pytest.raises(ConfigError, match=f"--imu '{device}': (no IMU source|write [a-z])"):
        person(imu=[device])


def test_real_strips(tmp_path: Path) -> None:
    (output,) = config_of(site(output="expander:/dev/ttyUSB0"), "led-driver")["outputs"]
    assert (output["kind"], output["port"]) == ("expander", "/dev/ttyUSB0")
    for wrong in ("expander", "expander:", "ddp", "nonsense:x"):
        with pytest.raises(ConfigError, match="--output"):
            site(output=wrong)
    path = written(tmp_path / "a.yaml", GOOD + "site: {pui: {}}\n")
    with pytest.raises(ConfigError, match="no led-driver"):
        site(str(path), output="expander:/dev/x")


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def window_s(**choices: Any) -> Any:
    return config_of(site(**choices), "selector")["window_s"]


def test_the_later_source_wins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = written(tmp_path / "first.yaml", "selector: {window_s: 1.1}\npui: {map: lab}\n")
    second = written(tmp_path / "second.yaml", "selector: {window_s: 1.2}\n")
    assert window_s() == 0.8
    assert window_s(files=[first]) == 1.1
    assert window_s(files=[first, second]) == 1.2
    monkeypatch.setenv("POINTIT_SELECTOR__WINDOW_S", "1.3")
    assert window_s(files=[first, second]) == 1.3
    assert window_s(files=[first], settings=["selector.window_s=1.4"]) == 1.4
    assert window_s(settings=["selector.window_s=1.4", "selector.window_s=1.5"]) == 1.5


def test_file_overrides_single_parameters_of_the_command_line(tmp_path: Path) -> None:
    path = written(tmp_path / "a.yaml", "user-sim: {seed: 77, arm: {tremor_rms_deg: 0.0}}\n")
    simulated = config_of(person(seed=3, files=[path]), "user-sim")
    assert (simulated["seed"], simulated["behaviour"]) == (77, "select")
    assert (simulated["arm"]["tremor_rms_deg"], simulated["arm"]["reach_base_s"]) == (0.0, 0.25)


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        ("selector", "write service.parameter=value"),
        ("selektor.window_s=1", "'selektor' is no service"),
        ("selector.window_s=soon", r"--set selector.window_s=soon: window_s: .*'soon'"),
        ("selector.nope=1", r"--set selector.nope=1: no parameter nope; there are "),
    ],
)
def test_a_wrong_setting_is_named(setting: str, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        site(settings=[setting])


def test_a_setting_without_effect_is_refused() -> None:
    scenario = read_scenario("scenario_3")
    choices = Choices(settings=["user-sim.think_s=0"])
    launches = site_launches(scenario, choices)
    with pytest.raises(ConfigError, match=r"'user-sim.think_s=0': user-sim is not among .*: conveyor-sim,"):
        check_settings(launches, choices)
    check_settings(launches + user_launches(scenario, choices, "anna"), choices)


def test_service_names_may_have_underscores_in_files_and_settings(tmp_path: Path) -> None:
    file = written(tmp_path / "room.yaml", "user_sim: {rate_hz: 30}\nrobot.quad: {}\n")
    chosen: dict[str, Any] = {"files": [file], "settings": ["conveyor_sim.seed=7"]}
    assert config_of(person(**chosen), "user-sim")["rate_hz"] == 30
    assert config_of(site(**chosen), "conveyor-sim")["seed"] == 7
    scenario = GOOD + "site: {pui: {}, led_driver: {brightness: 0.5}}\nuser: {user_sim: {}}\n"
    launches = site(str(written(tmp_path / "a.yaml", scenario)))
    assert config_of(launches, "led-driver")["brightness"] == 0.5


def test_home_assistant_has_both_spellings_and_errors_hide_its_token(tmp_path: Path) -> None:
    token = "eyJhbGciOiJIUzI1NiJ9.eyJpc3MiOiI4ZGUwIn0.s3cr3t"  # noqa: S105 - of this test
    (tmp_path / "token").write_text(token)
    (tmp_path / "token").chmod(0o600)
    fields = f"url: 'http://hub:8123', token_file: {tmp_path / 'token'}"
    file = written(tmp_path / "site.yaml", f"home_assistant: {{{fields}}}\n")
    launches = site("shelf", services=["home_assistant"], files=[file])
    assert config_of(launches, "home-assistant")["url"] == "http://hub:8123"
    for wrong in (token, f"[{token}]", f"{{token: {token}}}", f"{{token_file: Bearer {token}}}"):
        with pytest.raises(ConfigError) as caught:
            site("shelf", services=["home-assistant"], files=[written(file, f"home_assistant: {wrong}\n")])
        assert "s3cr3t" not in hide_secrets(str(caught.value))


def test_service_with_both_spellings_is_refused(tmp_path: Path) -> None:
    sections = "{user_sim: {}, user-sim: {}}"
    file = written(tmp_path / "room.yaml", sections)
    with pytest.raises(ConfigError, match=r"room.yaml: user_sim and user-sim are the same; keep one"):
        person(files=[file])
    scenario = written(tmp_path / "a.yaml", GOOD + f"user: {sections}\n")
    with pytest.raises(ConfigError, match=r"a.yaml: user: user_sim and user-sim are the same; keep one"):
        person(scenario=str(scenario))


@pytest.mark.parametrize(
    ("is_scenario", "text", "sentence"),
    [
        (False, "selektor: {}", "'selektor' is no service"),
        (False, "selector: {window_s: soon}", r"a.yaml, selector: window_s: .*'soon'"),
        (False, "[", "is not YAML in line"),
        (True, "about: a\n", "places: is missing"),
        (True, "about: a\nplaces: [{position_m: [0, 0]}]\n", "places.0.position_m"),
        (True, GOOD + "sites: {}\n", "no parameter sites; did you mean site"),
        (True, GOOD + "site: {puj: {}}\n", "site: no service 'puj'"),
        (True, GOOD + "site: {pui: {mapp: lab}}\n", "pui: no parameter mapp; did you mean map"),
    ],
)
def test_a_wrong_file_of_parameters_or_scenario_is_named(
    tmp_path: Path, text: str, sentence: str, *, is_scenario: bool
) -> None:
    path = written(tmp_path / "a.yaml", text)
    with pytest.raises(ConfigError, match=sentence) as caught:
        site(str(path)) if is_scenario else site(files=[path])
    assert str(path) in str(caught.value)


def test_a_scenario_that_does_not_exist() -> None:
    known = r"no scenario 'nope'; there are scenario_1, .*scenario_4, .*; or give a .yaml file"
    for name, sentence in (
        ("nope", known),
        ("/nowhere/nope.yml", r"nope\.yml: cannot be read .*; check its path"),
    ):
        with pytest.raises(ConfigError, match=sentence):
            read_scenario(name)


def test_a_scenario_whose_file_name_cannot_stand_in_a_key(tmp_path: Path) -> None:
    path = written(tmp_path / "my room.yaml", GOOD)
    with pytest.raises(ConfigError, match=r"my room\.yaml: rename the file: scenario 'my room': use 1 to 64"):
        read_scenario(str(path))


@pytest.mark.parametrize("length", [60, 61])
def test_scenario_name_that_exceeds_a_key_is_refused(length: int, tmp_path: Path) -> None:
    """The longest that is taken can be told (`DeploymentPublisher`); once a run began and failed by it."""
    path = written(tmp_path / f"{'x' * length}.yaml", GOOD)
    if length > 60:
        with pytest.raises(ConfigError, match="rename the file: a scenario's name has at most 60 characters"):
            read_scenario(str(path))
    else:
        read_scenario(str(path))
        check_name(RUN + path.stem)


def test_a_person_is_not_called_as_a_run() -> None:
    sentence = r"user 'run\.bob': names that begin with 'run\.' are those of runs"
    with pytest.raises(KeyNameError, match=sentence):
        person("run.bob", scenario="scenario_1")
    with pytest.raises(KeyNameError, match=sentence):
        CliRunner().invoke(user, ["run.bob"], catch_exceptions=False)


def test_people_have_different_cursor_colours_unless_the_scenario_sets_them() -> None:
    people = [person(f"user{index}", index) for index in range(3)]
    profiles = [config_of(launches, "supervisor")["profile"] for launches in people]
    assert len({tuple(profile["cursor_color"]) for profile in profiles}) == 3
    assert len({profile["pattern"] for profile in profiles}) == 3
    scenario = read_scenario("scenario_3")
    own = {**scenario.user, "supervisor": {"profile": {"cursor_color": [1, 2, 3]}}}
    launches = user_launches(scenario.model_copy(update={"user": own}), Choices(), "anna")
    assert config_of(launches, "supervisor")["profile"]["cursor_color"] == (1, 2, 3)


def test_map_is_beside_its_scenario_and_people_want_target_kinds(tmp_path: Path) -> None:
    text = "target_kinds: [purple]\nsite: {pui: {map: room.yaml}}\nuser: {user-sim: {behaviour: select}}\n"
    file = str(written(tmp_path / "mine.yaml", GOOD + text))
    assert read_scenario(file).site["pui"]["map"] == str(tmp_path / "room.yaml")
    assert config_of(person(scenario=file), "user-sim")["target_kinds"] == ("purple",)


def test_names_in_scenarios_and_files_of_parameters_are_literal_text(tmp_path: Path) -> None:
    text = (
        f"{GOOD}target_kinds: [on, 01, 2e1]\n"
        "site: {pui: {map: conveyor}, conveyor-sim: {kinds: {01: no, 1: 1.10}, feeder_belts: {on: 010}}}\n"
        "user: {}\n"
    )
    read = read_scenario(str(written(tmp_path / "s.yaml", text)))
    parameters = written(tmp_path / "p.yaml", "conveyor-sim: {feeder_belts: {off: 1_0}}\n")
    assert read.target_kinds == ("on", "01", "2e1")
    setting = "conveyor-sim.feeder_belts.0x1=12:30"
    config = config_of(site_launches(read, Choices(files=[parameters], settings=[setting])), "conveyor-sim")
    assert config["kinds"] == {"01": "no", "1": "1.10"}
    assert config["feeder_belts"] == {"on": "010", "off": "1_0", "0x1": "12:30"}


def test_goal_belongs_to_the_scenario_and_not_to_own_rooms(tmp_path: Path) -> None:
    assert read_scenario("scenario_4").goal == "Move onto a red package and stay on it until it is full."
    room = tmp_path / "room.yaml"
    room.write_text("things: {lamp: {center: [2, 0, 1], size: [0.2, 0.2, 0.2]}}\n", encoding="utf-8")
    assert read_scenario(str(room)).goal == ""
