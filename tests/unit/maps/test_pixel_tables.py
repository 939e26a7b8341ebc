"""Tables of pixels: numbers of strips and of the wire, names, units."""

from pathlib import Path

import numpy as np
import pytest

from pointit.maps import exchange
from pointit.maps.file import parse_map_file
from pointit.maps.light_files.pixel_table import parse_pixel_columns
from pointit.maps.light_files.strip_fit import first_pixels, no_note
from pointit.runtime.errors import ConfigError
from tests.unit.maps.test_exchange_layouts import lights

TABLES = {
    "a program that maps LEDs with a camera": (
        "index,x,y,z,xn,yn,zn,error\n" + "".join(f"{n},{n / 10},0,0,1,0,0,0.1\n" for n in (0, 1, 4, 5)),
        "pixel=index", None, [0, 1, 4, 5]),
    "nodes from 1, in millimetres": (
        "Node;X [mm];Y [mm];Z [mm]\n3;200;0;0\n1;0;0;0\n2;100;0;0\n",
        "pixel=Node,x=2/mm,y=3/mm,z=4/mm", 1, [0, 1, 2]),
    "centimetres": ("x,y,z\n0,0,0\n10,0,0\n20,0,0\n", "x=cm,y=cm,z=cm", None, [0, 1, 2]),
    "a row of units": ("x,y,z\nmm,mm,mm\n0,0,0\n100,0,0\n", "x=1/mm,y=2/mm,z=3/mm", None, [0, 1]),
    "no names": ("0,0,0\n.1,0,0\n", "x=1,y=2,z=3", None, [0, 1]),
    "the number first": ("1,.1,0,0\n0,0,0,0\n", "pixel=1,x=2,y=3,z=4", None, [0, 1]),
    "decimal commas and tabs": ("X\tY\tZ\n0\t0\t0\n0,1\t0\t0\n", "", None, [0, 1]),
    "numbers of each strip": (
        "x,y,z,strip,pixel\n0,0,0,a,0\n0.1,0,0,a,1\n0.3,0,0,a,3\n0.5,0,0,b,1\n0.4,0,0,b,0\n",
        "", None, [0, 1, 3, 4, 5]),
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_tables_of_other_programs_keep_their_numbers(name: str) -> None:
    text, columns, first, numbers = TABLES[name]
    found = lights(exchange.from_csv(text, no_note, parse_pixel_columns(columns), first))
    assert sorted(found) == numbers
    for number, point in found.items():
        np.testing.assert_allclose(point, [0.1 * number, 0, 0], atol=1e-3)


def table(numbers: dict[str, list[int]], header: str = "strip,pixel,x,y,z") -> str:
    """Return a table of strips one above the other, of which the pixels have these numbers."""
    lines = [header]
    for row, (name, each) in enumerate(numbers.items()):
        lines += [f"{name},{number},{(number - each[0]) / 10},0,{row}" for number in each]
    return "\n".join([*lines, ""])


OF_STRIPS: dict[str, tuple[dict[str, list[int]], int | None, dict[str, int]]] = {
    "begin again": ({"a": [0, 1], "b": [0, 1]}, None, {"a": 0, "b": 2}),
    "begin again from 1": ({"a": [1, 2, 3], "b": [1, 2]}, 1, {"a": 0, "b": 3}),
    "other lengths": ({"a": [0], "b": [0, 1, 2, 3], "c": [0, 1]}, None, {"a": 0, "b": 1, "c": 5}),
}


@pytest.mark.parametrize("name", OF_STRIPS)
def test_numbers_of_pixels_are_those_of_each_strip(name: str) -> None:
    numbers, first, firsts = OF_STRIPS[name]
    strips = exchange.from_csv(table(numbers), first=first)
    assert first_pixels(strips) == firsts
    assert {key: strip.pixels for key, strip in strips.items()} == {
        k: len(each) for k, each in numbers.items()
    }


def test_numbers_from_1_are_refused_until_the_first_is_declared() -> None:
    with pytest.raises(
        ConfigError, match="no pixel has the number 0; set first to 1 if they are numbered from 1"
    ):
        exchange.from_csv(table({"a": [1, 2, 3]}))
    assert sorted(lights(exchange.from_csv(table({"a": [1, 2, 3]}), first=0))) == [1, 2, 3]
    with pytest.raises(ConfigError, match="a pixel has the number 0; set first to 0"):
        exchange.from_csv(table({"a": [0, 1]}), first=1)


@pytest.mark.parametrize(
    "numbers",
    [{"a": [0, 1], "b": [2, 3]}, {"a": [0, 1], "b": [2, 3, 4]}, {"a": [0, 1], "b": [2, 3], "c": [0, 1]}],
)
def test_numbers_that_run_on_are_refused_until_they_are_declared(numbers: dict[str, list[int]]) -> None:
    with pytest.raises(
        ConfigError, match="; set columns to wire=pixel if they are those of the wire, or to pixel="
    ):
        exchange.from_csv(table(numbers))
    strips = exchange.from_csv(table(numbers), columns=parse_pixel_columns("pixel=pixel"))
    assert sorted(lights(strips))[:2] == [0, 1]


def test_numbers_of_the_wire_are_kept() -> None:
    numbers = {"b": [5, 6], "a": [0, 1, 2]}
    for header, columns in (("strip,wire,x,y,z", ""), ("strip,pixel,x,y,z", "wire=pixel")):
        strips = exchange.from_csv(table(numbers, header), columns=parse_pixel_columns(columns))
        assert first_pixels(strips) == {"b": 5, "a": 0}


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
    ("text", "message"),
    [
        ("x,y,z,pixel\n0,0,0,0\n1,0,0,0\n", "line 3: pixel 0 is in line 2, too; correct one of them"),
        ("x,y,z,pixel\n0,0,0,0.5\n1,0,0,1\n", "has the number 0.5; write whole numbers"),
        ("a,b,c\n0,0,0\n1,0,0\n", "line 1 is 1 'a', 2 'b', 3 'c'; set columns to those of x, y and z"),
        ("0,0,0\n1,0,0\n", "line 1 is 1 '0', 2 '0', 3 '0'; set columns to .* such as x=1,y=2,z=3"),
        ("x [mm],y [mm],z [mm]\n0,0,0\n", r"1 'x \[mm\]', .* or x=1/cm if not metres"),
        ("x,y,z\nmm,mm,mm\n0,0,0\n", "line 2: 1 'mm', 2 'mm', 3 'mm' has no number for x, y, z; set columns"),
        ("x,y,z\n0,0,0\n1,b,0\n", "line 3: '1,b,0' is no pixel; write numbers"),
        ('"x","y","z"\n"1",0.1,2,3\n', "line 2: has 4 cells .*, and there are 3 columns; correct it, or set"),
    ],
)
def test_a_table_that_cannot_be_understood_is_refused_with_the_remedy(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        exchange.from_csv(text)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ("x", "columns: 'x' declares no column; write x, y, z, strip, pixel, wire each once"),
        ("w=1", "columns: 'w=1' declares no column"),
        ("x=1,x=2", "columns: 'x=2' declares no column"),
        ("x=1/parsec", "columns: 'x=1/parsec' has no known unit; write m, dm, .*, or its size in SI units"),
        ("x=1/-2", "has no known unit"),
    ],
)
def test_a_declaration_that_is_none_is_refused(columns: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        parse_pixel_columns(columns)


def test_pixels_that_a_program_has_not_seen_are_noted() -> None:
    notes: list[str] = []
    exchange.from_csv("pixel,x,y,z\n0,1,2,3\n1,0,0,0\n2,1.1,2,3\n3,0,0,0\n4,1.2,2,3\n", notes.append)
    assert notes[0].startswith(
        "2 pixels are at 0, 0, 0 (lines 3, 5), as programs write it for those that they"
    )
