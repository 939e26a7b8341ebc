"""Foxglove's viewers show the same sizes and colours as the page, in Python and in TypeScript."""

import re
from pathlib import Path

from pointit.bridges import web
from pointit.bridges.foxglove import objects, people, room
from pointit.bridges.foxglove.config import FoxgloveConfig
from pointit.schemas.environment import KIND_COLORS, OTHER_COLOR
from pointit.services.led_driver.config import StyleConfig

LOOKS = (Path(web.__path__[0]) / "client/src/geometry/looks.ts").read_text(encoding="utf-8")


def told(name: str) -> list[float]:
    found = re.search(
        rf"^export const {name}(?:: \w+)? = (\[[^\]]*\]|[\d.]+)(?: as const)?;$", LOOKS, re.MULTILINE
    )
    assert found, name
    return [float(part) for part in found[1].strip("[]").split(",")]


def test_sizes_and_lengths_are_the_pages() -> None:
    assert told("PACKAGE_WIDE") == list(objects.PACKAGE_WIDE)
    assert told("PACKAGE_HIGH") == list(objects.PACKAGE_HIGH)
    assert told("SEGMENT") == list(objects.SEGMENT)
    assert told("USUAL_LENGTH_M") == [objects.USUAL_LENGTH_M]
    assert told("ROBOT_M") == [objects.ROBOT_M]
    assert told("FREE_RAY_M") == [people.FREE_RAY_M]


def test_fences_have_the_colours_of_the_dark_page() -> None:
    for kind, rgb in room.FENCES.items():
        assert f'{kind}: {{ dark: "#{bytes(rgb).hex()}"' in LOOKS


def test_kinds_have_one_colour_on_strips_in_the_page_and_in_viewers() -> None:
    start = LOOKS.index("export const KIND_COLORS")
    table = LOOKS[start : LOOKS.index("};", start)]
    page = {
        kind: tuple(int(part) for part in parts.split(","))
        for kind, parts in re.findall(r"(\w+): \[([\d, ]+)\]", table)
    }
    assert page == KIND_COLORS
    assert FoxgloveConfig().kind_colors == KIND_COLORS
    assert StyleConfig().kind_colors == KIND_COLORS
    assert tuple(told("OTHER_COLOR")) == OTHER_COLOR == StyleConfig().default_color
