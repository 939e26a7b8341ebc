"""`pointit map fetch` in a graph of one node: how a map is found, what is written, what is said."""

import logging
import textwrap
from pathlib import Path
from typing import Any

import click
import pytest
import yaml
from click.testing import CliRunner, Result

from pointit.bridges.ros2 import map_parameters
from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.types.types import Types
from pointit.cli.main import command
from pointit.cli.maps import fetch as fetch_module
from pointit.maps.file import load_map
from pointit.runtime.errors import ConfigError, NoAnswerError
from tests.support.parameter_server import OneNode, ParameterServer, parameters_of

TYPES = Types("jazzy")
ROOM = """\
# What stands here is not written.
lamps: {door: {position: [-1.5, 3.2, 1.8]}, window: {position: [2, -1, 0.9]}}
strips: {1: {line: [[0, 0.6, 1], [3, 0.6, 1]], pixels: 90, direction: -1}}
belts: {main: {centerline: [[0, 0, 1], [3, 0, 1]], width: 1.0}}
bays: {7: main}
"""
TREE: dict[str, Any] = yaml.safe_load(ROOM)
ADVICE = "--parameter names the one that holds a map, --prefix what stands before lamps., strips., belts."
NOTHING = "nothing in the parameters of /pui is a map; it has use_sim_time"
SUMMARY = "no findings; 1 belt, 1 bay, 1 strip with 90 pixels, 2 lamps"


class Graph:
    """ROS graph with one node that records the configurations with which the command joins."""

    def __init__(self) -> None:
        self.node = OneNode(ParameterServer(TYPES, {}))
        self.configs: list[BackendConfig] = []

    async def opened(self, config: BackendConfig, _warnings: object, *, patience_s: float) -> OneNode:
        assert patience_s > 0
        self.configs.append(config)
        return self.node

    def has(self, parameters: dict[str, Any]) -> None:
        self.node.server.parameters = {"use_sim_time": False, **parameters}


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Graph:
    made = Graph()
    monkeypatch.setattr(map_parameters, "opened", made.opened)
    monkeypatch.setattr(fetch_module, "quiet", lambda: None)
    return made


def fetch(*arguments: str) -> Result:
    return CliRunner().invoke(command, ["map", "fetch", "pui", *arguments])


def sentence(result: Result, kind: type[Exception] = ConfigError) -> str:
    assert isinstance(result.exception, kind), result
    assert not result.stdout
    return str(result.exception)


@pytest.mark.parametrize(
    ("prefix", "arguments"), [("", ()), ("site", ("--prefix", "site")), ("a.b", ("--prefix", "a.b."))]
)
def test_a_map_of_many_parameters_is_written(graph: Graph, prefix: str, arguments: tuple[str, ...]) -> None:
    graph.has(parameters_of(TREE, prefix))
    result = fetch(*arguments)
    assert result.exit_code == 0
    assert result.stdout.startswith("# The map of the ROS node /pui, from its parameters.\n")
    wanted = {section: {str(name): entry for name, entry in TREE[section].items()} for section in TREE}
    assert yaml.safe_load(result.stdout) == wanted
    assert result.stderr == f"the map of /pui: {SUMMARY}\n"
    assert graph.node.is_closed
    assert logging.getLogger("pointit.bridges.ros2").level == logging.NOTSET


@pytest.mark.parametrize(("name", "arguments"), [("map", ()), ("the_room", ("--parameter", "the_room"))])
def test_a_map_in_a_text_is_read(graph: Graph, tmp_path: Path, name: str, arguments: tuple[str, ...]) -> None:
    graph.has({name: ROOM, "lamps.other.position": [1.0, 2.0, 3.0]})
    path = tmp_path / "site.yaml"
    result = fetch("-o", str(path), *arguments)
    assert (result.exit_code, result.stdout, result.stderr) == (0, f"{path}: {SUMMARY}\n", "")
    assert "not written" not in path.read_text(encoding="utf-8")
    assert graph.node.server.asked == [[name]], "nothing else is wanted"
    (tmp_path / "by_hand.yaml").write_text(ROOM, encoding="utf-8")
    theirs, ours = (load_map(str(tmp_path / each), 0) for each in ("by_hand.yaml", "site.yaml"))
    assert ours == theirs.model_copy(update={"name": "site"})
    assert CliRunner().invoke(command, ["map", "check", str(path), "--strict"]).exit_code == 0


def test_text_with_all_lines_indented_is_the_same_map(graph: Graph) -> None:
    graph.has({"map": ROOM})
    plain = fetch()
    sections = ROOM.partition("\n")[2]
    graph.has({"map": f"\n{textwrap.indent(sections, '    ')}    "})
    assert fetch().stdout == plain.stdout


def test_a_path_is_taken_where_the_file_is_here_too(graph: Graph, tmp_path: Path) -> None:
    path = tmp_path / "theirs.yaml"
    path.write_text(ROOM, encoding="utf-8")
    graph.has({"map": f"{path}"})
    result = fetch()
    assert result.exit_code == 0
    assert set(yaml.safe_load(result.stdout)) == {"lamps", "strips", "belts", "bays"}
    assert f"parameter map of /pui is the path {path}, of a file that is here too" in result.stderr

    (tmp_path / "secret.txt").write_text(ROOM, encoding="utf-8")
    endless = "/proc/kmsg"  # a file, as far as the system says; only root would wait for its next line
    for there in (
        *(endless, f"{tmp_path}/secret.txt", f"{tmp_path}/none.yaml", "theirs.yaml", f"{tmp_path}"),
        *("/dev/zero", f"/{'x' * 999}"),
    ):
        graph.has({"map": there})
        assert sentence(fetch()).startswith(
            f"parameter map of /pui is a path, {there!r}, of a file on that node's machine; copy the"
        )


@pytest.mark.parametrize(
    "bad", ["lamps: [", "a: 1\na: 2", "a: &a [*a]\n", "- a\n- b: c", "lamps: {a: \x1b[2J}\n"]
)
def test_a_text_that_is_no_map_is_one_sentence(graph: Graph, bad: str) -> None:
    graph.has({"map": bad})
    result = fetch()
    if isinstance(result.exception, ConfigError):
        assert str(result.exception).startswith("parameter map of /pui: ")
    else:
        assert result.exit_code == 1
        assert result.stderr.startswith(("error the map of /pui: ", "error a: is not known"))
    assert "\x1b" not in f"{result.stderr}{result.exception}"
    assert not result.stdout


@pytest.mark.parametrize(
    "bad",
    [
        '"\\e]0;x\\a": 1\nleds: {a: {position: [1, 2, 3]}}\n',
        'lamps: {a: {position: [1, 2, 3], "\\e[2J\\n": 3}}\n',
        f'lamps: {{a: {{position: [1, 2, 3]}}}}\nclouds: {{c: {{file: "/\\e[2J{"x" * 100_000}.csv"}}}}\n',
    ],
)
def test_foreign_names_neither_write_on_the_terminal_nor_fill_it(graph: Graph, bad: str) -> None:
    graph.has({"map": bad})
    result = CliRunner().invoke(command, ["map", "fetch", "pui"], color=True)
    first, *others = result.stderr.splitlines()
    assert click.unstyle(first).startswith("error ")
    assert first.count("\x1b") == 3, "of the colour, and its end"
    assert len(first) < 1100
    assert len(others) == 2


def test_devices_and_links_stay_what_they_are(graph: Graph, tmp_path: Path) -> None:
    graph.has(parameters_of(TREE))
    device = tmp_path / "null"
    link = tmp_path / "link.yaml"
    path = tmp_path / "site.yaml"
    device.symlink_to("/dev/null")
    link.symlink_to(path)
    for output in (device, link):
        assert fetch("-o", f"{output}").exit_code == 0
    assert device.resolve() == Path("/dev/null")
    assert device.is_char_device()
    assert link.is_symlink()
    assert set(yaml.safe_load(path.read_text(encoding="utf-8"))) == set(TREE)
    assert sentence(fetch("-o", "/dev/full")).startswith("/dev/full: cannot be written (")
    assert fetch("-o", "-").stdout == fetch().stdout != ""


def test_fetched_map_with_an_error_is_reported_and_not_written(graph: Graph, tmp_path: Path) -> None:
    path = tmp_path / "site.yaml"
    graph.has(parameters_of(TREE) | {"lamps.door.position": [-1.5, 3.2, -1.8], "bays.8": "mian"})
    result = fetch("-o", str(path))
    assert result.exit_code == 1
    assert result.stderr.splitlines() == [
        "error bays.8: there is no belt 'mian'; use one of main",
        "error lamps.door: is 1.8 m below the floor; correct its z",
        f"{path}: 2 errors; 1 belt, 2 bays, 1 strip with 90 pixels, 2 lamps",
        f"{path}: not written because of errors; correct the parameters of /pui",
    ]
    assert not path.exists()

    graph.has({"strips.1.line": [0.0, 0.0, 1.0, 2.0, 0.0, 1.0]})
    assert fetch().stderr.splitlines()[0] == "error strips.1.pixels: is missing; add it beside line"
    graph.has({"lamps.a b.position": [0.0, 0.0, 1.0]})
    assert "error lamps: name 'a b': use 1 to 64 letters" in fetch().stderr

    graph.has({"lamps.a.position": [0.0, float("1e300"), 1.0]})
    assert "lamps.a.position: a point is three numbers [x, y, z] in metres" in fetch().stderr
    graph.has({"map.lamps.a.position": [0.0, 0.0, 1.0], "map.colour": "red"})
    assert "map.colour is not a parameter of a map" in sentence(fetch("--prefix", "map"))


def test_warnings_are_told_and_the_map_is_written(graph: Graph) -> None:
    graph.has({"lamps.door.position": [0.0, 0.0, 6.0]})
    result = fetch()
    assert result.exit_code == 0
    assert "warning lamps.door: is 6 m high" in result.stderr
    assert yaml.safe_load(result.stdout) == {"lamps": {"door": {"position": [0.0, 0.0, 6.0]}}}


def test_clouds_are_read_beside_the_written_file(graph: Graph, tmp_path: Path) -> None:
    graph.has({"clouds.shelf.file": "shelf.xyz"})
    path = tmp_path / "site.yaml"
    result = fetch("-o", str(path))
    assert result.exit_code == 1
    assert f"clouds.shelf.file: {tmp_path / 'shelf.xyz'}: cannot be read" in result.stderr
    (tmp_path / "shelf.xyz").write_text("x y z\n1 2 0\n1 2.5 1\n")
    assert fetch("-o", str(path)).exit_code == 0


@pytest.mark.parametrize(
    ("parameters", "words", "said"),
    [
        ({"speed": 1.0}, "", f"{NOTHING}, speed; {ADVICE}"),
        ({"map": "", "x.map.lamps.a.at": [1.0]}, "", f"{NOTHING}, map, x.map.lamps.a.at; {ADVICE}"),
        (
            *({"a": 1}, "--prefix site"),
            f"no parameter of /pui begins with 'site.'; it has use_sim_time, a; {ADVICE}",
        ),
        ({"a": 1}, "--parameter b", "node /pui has no parameter 'b'; it has use_sim_time, a"),
        (
            *({"a": [1.0]}, "--parameter a"),
            "parameter a of /pui is not the text of a map or its path; --parameter names another",
        ),
    ],
)
def test_parameters_without_a_map_are_one_sentence(
    graph: Graph, parameters: dict[str, Any], words: str, said: str
) -> None:
    graph.has(parameters)
    assert sentence(fetch(*words.split())) == said
    assert graph.node.is_closed


def test_it_joins_as_a_client_unless_it_is_told(graph: Graph) -> None:
    graph.has({"map": ROOM})
    usual = BackendConfig(mode="client", node="/pointit_map")
    assert fetch().exit_code == 0
    options = (
        *("--backend.endpoint", "tcp/10.0.0.1:7450", "--backend.mode", "peer"),
        *("--backend.domain-id", "7"),
    )
    assert fetch(*options).exit_code == 1
    changed = {"endpoint": "tcp/10.0.0.1:7450", "mode": "peer", "domain_id": 7}
    assert graph.configs == [usual, usual.model_copy(update=changed)]


def test_a_node_that_is_not_there_is_one_sentence(graph: Graph) -> None:
    graph.node.nodes = frozenset({"/arm"})
    graph.node.name = "/arm"
    assert (
        sentence(fetch("--timeout", "0.1"), NoAnswerError)
        == "there is no node /pui in domain 0; there are /arm"
    )
    assert graph.node.is_closed


def test_options_are_checked(graph: Graph) -> None:
    said = sentence(fetch("--backend.domain-id", "300"))
    assert said.startswith("--backend.domain-id: domain_id: must be at most 232 (got 300)")
    assert sentence(fetch("--backend.endpoint", "somewhere")).startswith(
        "backend.endpoint: 'somewhere' is no"
    )
    assert not graph.configs


def test_wrong_arguments_are_one_sentence() -> None:
    result = CliRunner().invoke(command, ["map", "fetch", "pui node"])
    assert result.exit_code == 2
    assert "NODE 'pui node': not a full node name; write one like /pui_node" in result.output
    result = fetch("--prefix", "a", "--parameter", "b")
    assert result.exit_code == 2
    assert "the map is in one parameter or in many; give one of them" in result.output


def test_without_the_extra_it_is_said_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def has_extra(extra: str) -> bool:
        return extra != "ros2"

    monkeypatch.setattr(fetch_module, "has_extra", has_extra)
    assert sentence(fetch()) == "map fetch needs `scripts/setup ros2` in the folder of PointIt"
    assert CliRunner().invoke(command, ["map", "fetch", "--help"]).exit_code == 0
