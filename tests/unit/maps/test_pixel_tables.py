"""Tables of pixels: numbers of strips and of the wire, names, units."""

import re
from pathlib import Path

import numpy as np
import pytest

from pointit.maps import exchange
from pointit.maps.file import parse_map_file
from pointit.maps.light_files.strip_fit import first_pixels
from pointit.runtime.errors import ConfigError
from tests.unit.maps.test_exchange_layouts import assert_same_lights, lights

TABLES = {
    "a program that maps LEDs with a camera": (
        "index,x,y,z,xn,yn,zn,error\n" + "".join(f"{n},{n / 10},0,0,1,0,0,0.1\n" for n in (0, 1, 4, 5)),
        [0, 1, 4, 5]),
    "nodes from 1, in millimetres": (
        "Node;X [mm];Y [mm];Z [mm]\n3;200;0;0\n1;0;0;0\n2;100;0;0\n", [0, 1, 2]),
    "a unit in a comment": ("# Units: cm\nx,y,z\n0,0,0\n10,0,0\n20,0,0\n", [0, 1, 2]),
    "a unit in a comment, without names": ("// units in mm\n0,0,0\n100,0,0\n", [0, 1]),
    "lists of Python": ("[0, 0, 0]\n[0.1, 0, 0]\n[0.2, 0, 0]\n", [0, 1, 2]),
    "decimal commas and tabs": ("X\tY\tZ\n0\t0\t0\n0,1\t0\t0\n", [0, 1]),
    "numbers of each strip": (
        "x,y,z,strip,pixel\n0,0,0,a,0\n0.1,0,0,a,1\n0.3,0,0,a,3\n0.5,0,0,b,1\n0.4,0,0,b,0\n",
        [0, 1, 3, 4, 5]),
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_tables_of_other_programs_keep_their_numbers(name: str) -> None:
    text, numbers = TABLES[name]
    found = lights(exchange.from_csv(text))
    assert sorted(found) == numbers
    for number, point in found.items():
        np.testing.assert_allclose(point, [0.1 * number, 0, 0], atol=1e-3)


def table(numbers: dict[str, list[int]], header: str = "strip,pixel,x,y,z") -> str:
    """Return a table of strips one above the other, of which the pixels have these numbers."""
    lines = [header]
    for row, (name, each) in enumerate(numbers.items()):
        lines += [f"{name},{number},{(number - each[0]) / 10},0,{row}" for number in each]
    return "\n".join([*lines, ""])


CONVENTIONS: dict[str, tuple[dict[str, list[int]], dict[str, int]]] = {
    "runs on": ({"a": [0, 1], "b": [2, 3]}, {"a": 0, "b": 2}),
    "runs on from 1": ({"a": [1, 2, 3], "b": [4, 5]}, {"a": 0, "b": 3}),
    "runs on, the last strip first": ({"b": [5, 6, 7], "a": [0, 1, 2, 3, 4]}, {"b": 5, "a": 0}),
    "runs on, numbers between are unused": ({"a": [0, 1, 2], "b": [6, 7]}, {"a": 0, "b": 6}),
    "runs on over three": ({"a": [0, 1], "b": [2, 3, 4], "c": [5]}, {"a": 0, "b": 2, "c": 5}),
    "begins again": ({"a": [0, 1], "b": [0, 1]}, {"a": 0, "b": 2}),
    "begins again from 1": ({"a": [1, 2, 3], "b": [1, 2]}, {"a": 0, "b": 3}),
    "begins again, other lengths": ({"a": [0], "b": [0, 1, 2, 3], "c": [0, 1]}, {"a": 0, "b": 1, "c": 5}),
    "begins again, one is longer": ({"a": [0, 1, 2], "b": [*range(9)]}, {"a": 0, "b": 3}),
}


@pytest.mark.parametrize("name", CONVENTIONS)
def test_numbers_of_strips_and_of_the_wire_are_told_apart(name: str) -> None:
    numbers, firsts = CONVENTIONS[name]
    strips = exchange.from_csv(table(numbers))
    assert first_pixels(strips) == firsts
    assert {key: strip.pixels for key, strip in strips.items()} == {
        k: len(each) for k, each in numbers.items()
    }


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"a": [0, 1, 2], "b": [3, 4, 5], "c": [0, 1, 2]}, "0 is in strips a and c, and b has 3 to 5"),
        ({"a": [0, 1, 2, 3], "b": [3, 4, 5, 6]}, "3 is in strips a and b, and b has 3 to 6"),
        ({"a": [0, 1, 2, 3], "b": [2, 4, 5, 6, 7]}, "2 is in strips a and b, and b has 2 to 7"),
    ],
)
def test_numbers_that_run_on_and_begin_again_are_refused(numbers: dict[str, list[int]], message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        exchange.from_csv(table(numbers))
    assert str(caught.value) == (
        f"pixel numbers begin again and run on: {message}; "
        "number each strip from 0, or call the column wire and number all pixels of the wire"
    )
    wire = exchange.from_csv(table({"a": [0, 1], "b": [2, 3]}, "strip,wire,x,y,z"))
    assert first_pixels(wire) == {"a": 0, "b": 2}


@pytest.mark.parametrize(
    "header",
    ["Strip Name,Pixel No.", "strip_id,pixel_id", "Model,Node", "String,LED #", "Strang,Nummer",
     "fixture,led_index", "Strand,Number", "name,idx"],
)  # fmt: skip
def test_names_of_strips_and_numbers_are_found_in_columns_of_other_names(header: str) -> None:
    notes: list[str] = []
    text = table({"a": [1, 0, 2], "b": [1, 0]}, f"{header},x,y,z")
    strips = exchange.from_csv(text, notes.append)
    assert {name: strip.pixels for name, strip in strips.items()} == {"a": 3, "b": 2}
    assert exchange.positions(strips["b"])[0].tolist() == pytest.approx([-0.1, 0, 1], abs=1e-4)
    assert notes == []


def test_columns_that_are_not_used_are_reported() -> None:
    notes: list[str] = []
    exchange.from_csv("Universe,Channel,x,y,z\n1,1,0,0,0\n1,4,0.1,0,0\n", notes.append)
    assert notes == ["columns Universe, Channel are not used"]


def test_numbers_of_pixels_that_a_camera_lost_are_those_of_strips() -> None:
    strips = exchange.from_csv(table({"a": [0, 2, 3, 4], "b": [1, 2, 4]}))
    assert sorted(lights(strips)) == [0, 2, 3, 4, 6, 7, 9]


def test_names_that_no_map_can_have_are_replaced_and_reported() -> None:
    notes: list[str] = []
    numbers = {"my strip/1": [0, 1], "Küche": [0, 1], "my_strip_1": [0, 1], "客厅": [0, 1], "-": [0, 1]}
    strips = exchange.from_csv(table(numbers), notes.append)
    assert list(strips) == ["my_strip_1_2", "Kuche", "my_strip_1", "strip_4", "strip_5"]
    assert list(parse_map_file(exchange.strips_text(strips).encode(), Path("x.yaml")).strips) == list(strips)
    assert notes == [
        f"strip {name!r} is called {new}, a name that a map can have"
        for name, new in zip(numbers, strips, strict=True)
        if name != new
    ]


@pytest.mark.parametrize(
    "header",
    ["x,y,z\nmm,mm,mm\n", "x,y,z,strip\n[mm],[mm],[mm],\n",  "# coordinates in mm\nx,y,z\n",
     "x (mm),y (mm),z (mm)\nmm,mm,mm\n", "strip;x;y;z\n;(mm);(mm);(mm)\n"],
)  # fmt: skip
def test_units_of_a_table_are_read_as_those_of_a_point_cloud(header: str) -> None:
    delimiter = ";" if ";" in header else ","
    cells = [["a"] * header.startswith("strip") + [f"{100 * n}", "0", "0"] for n in range(3)]
    text = header + "".join(delimiter.join(row) + "\n" for row in cells)
    assert_same_lights(lights(exchange.from_csv(text)), {n: np.array([n / 10, 0, 0]) for n in range(3)}, 1e-6)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (
            "# units: mm\n# units: cm\nx,y,z\n",
            "states two units, 'units: mm' and 'units: cm'; keep the right",
        ),
        ("x [cm],y [cm],z [cm]\nmm,mm,mm\n", "states two units, column 'x [cm]' and the row mm, mm, mm"),
        ("x,y,z\nmm,px,mm\n", "the row mm, px, mm is no known length of x, y and z each; rename it"),
    ],
)
def test_units_of_a_table_that_contradict_are_refused(header: str, message: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(message)) as caught:
        exchange.from_csv(header + "0,0,0\n1,0,0\n")
    assert "map" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y,z,pixel\n0,0,0,1\n1,0,0,1\n", "line 3: pixel 1 is in line 2, too; correct one of them"),
        ("x,y,z,pixel\n0,0,0,0.5\n1,0,0,1\n", "has the number 0.5; write whole numbers"),
        ("a,b,c\n0,0,0\n1,0,0\n", r"does not say which columns are x, y and z \(a, b, c\); rename them"),
        ("0,0,0,0.5\n1,0,0,0.5\n1,2,3,4,5\n", "line 1: has 4 columns without names|line 3"),
        ("1,2,3,4,5\n", "line 1: has 5 columns without names; .*add a line with the names"),
        ("x [deg],y [deg],z [m]\n0,0,0\n", "has the unit deg"),
    ],
)
def test_a_table_that_cannot_be_understood_is_refused_with_the_remedy(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        exchange.from_csv(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "".join(f"{n},{100 + 7 * n},{n * n}\n" for n in range(6)),
            "first of three columns without names counts",
        ),
        (
            "".join(f"{n},{9 - n},4\n" for n in range(1, 7)),
            "counts the lines: is it the pixel, and are the others",
        ),
        ('"x","y","z"\n"1",0.1,2,3\n"2",0.2,2,3\n', "line 2: has 4 cells, and the header 3 names; name each"),
    ],
)
def test_columns_that_are_no_coordinates_are_refused(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        exchange.from_csv(text)


def test_a_header_that_numbers_the_columns_is_no_pixel() -> None:
    (strip,) = exchange.from_csv("0,1,2\n" + "".join(f"{n / 10},0.5,1.5\n" for n in range(8))).values()
    assert strip.pixels == 8


def test_pixels_a_metre_apart_on_an_axis_are_read() -> None:
    (strip,) = exchange.from_csv("".join(f"{n},0,2\n" for n in range(8))).values()
    assert strip.pixels == 8


def test_pixels_that_a_program_has_not_seen_are_noted() -> None:
    notes: list[str] = []
    exchange.from_csv("led,x,y,z\n0,1,2,3\n1,0,0,0\n2,1.1,2,3\n3,0,0,0\n4,1.2,2,3\n", notes.append)
    assert notes[0].startswith(
        "2 pixels are at 0, 0, 0 (lines 3, 5), as programs write it for those that they"
    )
