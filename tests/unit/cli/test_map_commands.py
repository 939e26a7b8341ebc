"""`pointit map`: what is printed, the exit code, the picture."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from matplotlib.collections import PatchCollection
from matplotlib.lines import Line2D
from matplotlib.text import Text

from pointit.cli.main import command
from pointit.geometry.polyline import Polyline
from pointit.maps.file import load_map_and_clouds, shipped_maps
from pointit.maps.picture import beside, map_figure
from pointit.runtime.errors import ConfigError
from pointit.schemas import Environment
from tests.support.invoked import printed

ROOM = """\
# A room with everything.
lamps: {door: {position: [-1.5, 3.2, 1.8]}, window: {position: [2, -1, 0.9]}}
strips: {edge: {line: [[0, 0.6, 1], [3, 0.6, 1]], pixels: 90, direction: -1}}
belts: {main: {centerline: [[0, 0, 1], [3, 0, 1]], width: 1.0}}
bays: {7: main}
boxes: {desk: {center: [-2, -1, 0.4], size: [1.6, 0.8, 0.8], yaw_deg: 30}}
planes:
  wall: {center: [4.5, 1, 1.5], normal: [-1, 0, 0], size: [4, 3]}
  ground: {center: [0, 0, 0], normal: [0, 0, 1]}
  curtain: {center: [0, 4, 0], normal: [0, 1, 0]}
  table: {center: [2, 2.5, 0.7], normal: [0, 0, 1], size: [1.6, 0.8]}
cylinders: {column: {center: [-0.5, 2, 0], radius: 0.3, height: 3}}
spheres: {globe: {center: [0.8, -1.6, 1.2], radius: 0.4}}
clouds: {shelf: {file: shelf.xyz}}
fences:
  yard: {kind: keep_in, outline: [[-3, -3], [8, -3], [8, 5], [-3, 5]], high: 2.5}
  stairs: {kind: keep_out, outline: [[6, 1], [7, 1], [7, 2]]}
things: {nuts: {center: [5, 3, 1], size: [0.4, 0.3, 0.3], label: the nuts}}
"""


def invoke(*arguments: str) -> Result:
    return CliRunner().invoke(command, ["map", *arguments])


@pytest.fixture
def room(tmp_path: Path) -> Path:
    (tmp_path / "shelf.xyz").write_text("x y z\n1 2 0\n1 2.5 1\n")
    path = tmp_path / "room.yaml"
    path.write_text(ROOM, encoding="utf-8")
    return path


def test_check_of_a_correct_map_is_one_line_stating_its_content(room: Path) -> None:
    result = invoke("check", str(room))
    assert result.exit_code == 0
    assert result.output == (
        f"{room}: no findings; 1 belt, 1 bay, 1 strip with 90 pixels, 2 lamps, 1 box, 4 planes, 1 cylinder, "
        "1 sphere, 1 cloud with 2 points, 2 fences, 1 thing\n"
    )


def test_warnings_are_no_failure_unless_asked_for() -> None:
    result = invoke("check", "conveyor")
    assert result.exit_code == 0
    lines = result.output.splitlines()
    assert [line.partition(":")[0] for line in lines] == [
        "warning strips.17",
        "warning strips.19",
        "conveyor",
    ]
    assert lines[-1].startswith("conveyor: 2 warnings; 8 belts, ")
    assert invoke("check", "conveyor", "--strict").exit_code == 1
    assert invoke("check", "lab", "--strict").exit_code == 0


def test_check_names_all_mistakes_of_an_unreadable_map(room: Path) -> None:
    room.write_text(
        "lamps: {a: {position: [1, 2]}, b/c: {position: [1, 2, 3]}}\nbelts: {m: {width: 0}}\n",
        encoding="utf-8",
    )
    result = invoke("check", str(room))
    assert result.exit_code == 1

    name, *others = result.output.splitlines()
    assert name.startswith("error lamps: ")
    assert "b/c" in name
    assert others == [
        "error lamps.a.position: a point is three numbers [x, y, z] in metres, up to 1e+06, not [1, 2]",
        "error belts.m.centerline: is missing; add it beside width",
        "error belts.m.width: write a number of metres above 0, not 0",
        f"{room}: 4 errors",
    ]


def test_check_names_all_clouds_that_cannot_be_read(room: Path) -> None:
    room.write_text("clouds: {a: {file: a.ply}, b: {file: b.ply}}", encoding="utf-8")
    lines = invoke("check", str(room)).output.splitlines()
    assert [line.split(": ")[0] for line in lines[:-1]] == ["error clouds.a.file", "error clouds.b.file"]


def test_check_prints_a_hundred_findings_and_counts_the_others(room: Path) -> None:
    lamps = "".join(f"  l{index}: {{position: [{index}]}}\n" for index in range(150))
    room.write_text(f"lamps:\n{lamps}", encoding="utf-8")
    lines = invoke("check", str(room)).output.splitlines()
    assert (lines[-2:], len(lines)) == (["... and 50 more: --json lists all", f"{room}: 150 errors"], 102)


def test_a_missing_map_is_an_error(room: Path) -> None:
    ended = invoke("check", str(room.parent / "none.yaml"))
    assert ended.exit_code == 1
    assert "none.yaml: cannot be read (no such file or directory); check its path and rights" in ended.output


def test_a_map_too_large_to_travel_is_an_error(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Environment, "max_bytes", 200)
    result = invoke("check", str(room))
    assert result.exit_code == 1
    assert "bytes as a message, limit 200;" in result.output


def test_findings_as_json() -> None:
    told = json.loads(invoke("check", "conveyor", "--json").output)
    assert told["map"] == "conveyor"
    assert told["has"].endswith("3 lamps")
    assert [(each["severity"], each["where"]) for each in told["findings"]] == [
        ("warning", "strips.17"),
        ("warning", "strips.19"),
    ]
    assert "49.3 a metre" in told["findings"][0]["text"]


def test_check_considers_the_position_of_a_person(room: Path) -> None:
    room.write_text("lamps: {a: {position: [-2, -0.05, 1]}, b: {position: [-4, 0.05, 2]}}", encoding="utf-8")
    assert invoke("check", str(room)).exit_code == 0
    assert invoke("check", str(room), "--person=0,0").exit_code == 1


def test_things_are_compared_as_seen_from_every_position(room: Path) -> None:
    boxes = [f"t{index}: {{center: [{index}, 9, 1], size: [0.9, 1, 1]}}" for index in range(14)]
    room.write_text("things: {" + ", ".join(boxes) + "}", encoding="utf-8")
    assert "as seen" not in invoke("check", str(room)).output
    output = invoke("check", str(room), "--pose=6.5,-9", "--pose=-3,9.1", "--person=0,8").output
    lines = [line for line in output.splitlines() if line.startswith("warning things")]
    assert any(line.partition("as seen from ")[2].startswith("0,8: ") for line in lines)
    for place, further in (("6.5,-9", 15), ("-3,9.1", 81)):
        told = [line for line in lines if f"as seen from {place}" in line]
        assert len(told) == 11
        assert told[-1].startswith(f"warning things: {further} more pairs")


@pytest.mark.parametrize("text", ["1", "1,2,3", "a,b", "nan,1", ""])
def test_a_place_is_two_numbers(text: str) -> None:
    result = invoke("check", "lab", f"--person={text}")
    assert result.exit_code == 2
    assert f"{text!r} is not a position; write x and y in metres, such as 1.5,-2" in result.output


def test_an_unknown_name_gets_the_similar_shipped_map() -> None:
    with pytest.raises(ConfigError, match="did you mean lab"):
        printed(command, "map", "check", "labb")


def test_the_shipped_maps_are_listed_with_what_they_have() -> None:
    rows = json.loads(invoke("list", "--json").output)["maps"]
    assert [row["name"] for row in rows] == list(shipped_maps())
    assert all(row["about"] and "#" not in row["about"] for row in rows)
    (conveyor,) = (row for row in rows if row["name"] == "conveyor")
    assert conveyor["about"] == "The conveyor of the paper's demonstrator"
    lines = invoke("list").output.splitlines()
    (line,) = (line for line in lines if line.split()[:1] == ["conveyor"])
    assert conveyor["has"] in line


def written(name_or_path: str, person: tuple[float, float] | None = None) -> set[str]:
    figure = map_figure(*load_map_and_clouds(name_or_path, 0), "a title", person)
    texts: list[Text] = figure.findobj(Text)
    return {line for each in texts for line in each.get_text().splitlines()}


def test_a_picture_shows_everything_by_name(room: Path) -> None:
    expected = {
        *("a title", "door", "1.80 m high", "edge", "main", "bay 7", "desk", "wall", "table", "column"),
        *("globe", "shelf", "curtain (without end)", "ground: level, without end", "x (m)", "y (m)"),
        *("its pixel 0", "belt, arrows: where it moves", "bay, where things leave", "point cloud"),
        *("the nuts", "yard", "to 2.5 m", "stairs", "robots stay inside", "robots stay outside"),
        "person at -1, 0.5",
    }
    assert expected <= written(str(room), (-1.0, 0.5))


def test_legend_has_only_contents_of_the_map() -> None:
    texts = written("lab")
    assert "strip" in texts
    assert not {"link", "point cloud", "bay, where things leave"} & texts
    assert "link" in written("conveyor")


def test_the_outline_of_a_belt_is_its_width_beside_it() -> None:
    corner = Polyline([(0, 0, 1), (2, 0, 1), (2, 3, 1)])
    np.testing.assert_allclose(beside(corner, 0.5), [[0, 0.5], [1.5, 0.5], [1.5, 3]], atol=1e-12)
    np.testing.assert_allclose(beside(corner, -0.5), [[0, -0.5], [2.5, -0.5], [2.5, 3]], atol=1e-12)


def test_vertical_plane_is_drawn_as_a_line_and_others_as_areas(room: Path) -> None:
    figure = map_figure(*load_map_and_clouds(str(room), 0), "")
    collections: list[PatchCollection] = figure.findobj(PatchCollection)
    outlines = [path for each in collections for path in each.get_paths()]
    sizes = [np.ptp(np.asarray(path.vertices, dtype=np.float64), axis=0) for path in outlines]
    extents = {(round(float(wide), 6), round(float(tall), 6)) for wide, tall in sizes}
    assert (0.0, 4.0) in extents, "the wall, 4 m along y"
    assert (1.6, 0.8) in extents, "the table"


def test_a_belt_that_is_all_but_upright_is_drawn(tmp_path: Path) -> None:
    path = tmp_path / "lift.yaml"
    path.write_text(
        "belts: {lift: {centerline: [[1, 0, 0], [1.000000001, 0, 3]], width: 0.5}}\n"
        "lamps: {door: {position: [0, 0, 1]}}\n"
    )
    assert {"lift", "door"} <= written(str(path))


def test_thousands_of_boxes_are_one_artist_without_names(tmp_path: Path) -> None:
    path = tmp_path / "store.yaml"
    boxes = "".join(
        f"  b{index}: {{center: [{index % 100}, {index // 100}, 1], size: [0.4, 0.4, 0.4]}}\n"
        for index in range(3_000)
    )
    path.write_text(f"boxes:\n{boxes}", encoding="utf-8")
    figure = map_figure(*load_map_and_clouds(str(path), 0), "")
    (collection,) = figure.findobj(PatchCollection)
    assert len(collection.get_paths()) == 3_000
    assert len(figure.findobj()) < 1000
    texts = {text.get_text() for text in figure.findobj(Text)}
    assert "3000 solids, names left out" in texts
    assert "b1" not in texts


def test_a_million_points_are_thinned() -> None:
    room, _ = load_map_and_clouds("lab", 0)
    figure = map_figure(room, {"scan": np.random.default_rng(1).uniform(0, 3, (100_000, 3))}, "")
    longest = max(len(np.atleast_1d(each.get_xdata())) for each in figure.findobj(Line2D))
    assert 10_000 < longest <= 20_000


@pytest.mark.parametrize(("suffix", "magic"), [("png", b"\x89PNG"), ("PDF", b"%PDF"), ("svg", b"<?xml")])
def test_the_suffix_is_the_format(tmp_path: Path, suffix: str, magic: bytes) -> None:
    picture = tmp_path / f"conveyor.{suffix}"
    assert invoke("plot", "conveyor", "-o", str(picture)).exit_code == 0
    assert picture.read_bytes().startswith(magic)


def test_the_same_map_is_the_same_file(tmp_path: Path) -> None:
    for name in ("one.svg", "two.svg"):
        assert invoke("plot", "lab", "-o", str(tmp_path / name)).exit_code == 0
    assert (tmp_path / "one.svg").read_bytes() == (tmp_path / "two.svg").read_bytes()


@pytest.mark.parametrize(
    ("picture", "sentence"),
    [
        ("lab.bmp", r"lab.bmp: not a picture format; give a file that ends in .svg, .png, .pdf$"),
        ("none/lab.svg", r"none/lab.svg: cannot be written \(no such file or directory\)$"),
        ("lab.svg", r"run `scripts/setup plot` in the folder of PointIt$"),
    ],
)
def test_a_picture_that_cannot_be_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, picture: str, sentence: str
) -> None:
    if picture == "lab.svg":
        monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ConfigError, match=sentence):
        printed(command, "map", "plot", "lab", "-o", str(tmp_path / picture))
    assert not list(tmp_path.iterdir())
