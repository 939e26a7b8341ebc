"""The shipped layout names what the bridge serves; sizes and colours are those of the page."""

import json
import re
from pathlib import Path
from typing import Any

from pointit.bridges import web
from pointit.bridges.foxglove import objects, people, room
from pointit.bridges.foxglove.scene import PARTS
from pointit.bridges.foxglove.server import LOG, picture_topic
from pointit.bridges.foxglove.service import LAYOUT
from pointit.bridges.foxglove.shapes import WORLD
from pointit.schemas import Health
from pointit.schemas.catalogue.json_channel import JsonChannel, channel_name
from pointit.schemas.environment import KIND_COLORS, OTHER_COLOR
from pointit.schemas.topics import TOPICS
from pointit.services.led_driver.config import StyleConfig
from pointit.services.registry import PROCESSES

layout: dict[str, Any] = json.loads(LAYOUT.read_text(encoding="utf-8"))
panels: dict[str, Any] = layout["configById"]
PATH = re.compile(r'"/health/(?P<service>[\w-]+)"\.(?P<field>\w+)(?P<rest>.*)')


def panel(kind: str) -> dict[str, Any]:
    found: dict[str, Any]
    (found,) = [config for name, config in panels.items() if name.startswith(f"{kind}!")]
    return found


def test_every_panel_is_in_the_picture_once() -> None:
    def leaves(node: Any) -> list[str]:
        return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]

    assert sorted(leaves(layout["layout"])) == sorted(panels)


def test_all_parts_of_the_scene_are_visible() -> None:
    scene = panel("3D")
    parts = {picture_topic(part) for part in PARTS if part != "frames"}
    assert {topic for topic, each in scene["topics"].items() if each["visible"]} == parts
    assert scene["followTf"] == WORLD


def test_the_log_and_a_topic_are_shown() -> None:
    assert panel("RosOut")["topicToRender"] == LOG
    assert panel("RawMessages")["topicPath"] in {channel_name(topic.key) for topic in TOPICS}


def test_plots_are_of_fields_of_services_that_there_are() -> None:
    fields = JsonChannel(Health).schema["properties"]
    names = {row.name for row in PROCESSES if row.scope == "site"}
    plots = [config for name, config in panels.items() if name.startswith("Plot!")]
    assert len(plots) == 2
    for path in (each["value"] for plot in plots for each in plot["paths"]):
        found = PATH.fullmatch(path)
        assert found, path
        assert found["service"] in names
        if found["field"] == "latency":
            assert found["rest"].lstrip(".") in fields["latency"]["properties"]
        else:
            assert found["field"] == "keys"
            assert found["rest"] == '[:]{direction=="out"}.rate_hz'
            assert {"direction", "rate_hz"} <= set(fields["keys"]["items"]["properties"])


def test_dots_would_end_a_topic_in_a_path() -> None:
    assert channel_name("users/anna/cursor") == "/users/anna/cursor"
    assert channel_name("health/pointing.anna") == "/health/pointing/anna"


APPEARANCE = (Path(web.__path__[0]) / "client/src/geometry/appearance.ts").read_text(encoding="utf-8")


def told(name: str) -> list[float]:
    found = re.search(
        rf"^export const {name}(?:: \w+)? = (\[[^\]]*\]|[\d.]+)(?: as const)?;$", APPEARANCE, re.MULTILINE
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
        assert f'{kind}: {{ dark: "#{bytes(rgb).hex()}"' in APPEARANCE


def test_kinds_have_equal_colours_on_strips_page_and_viewers() -> None:
    start = APPEARANCE.index("export const KIND_COLORS")
    table = APPEARANCE[start : APPEARANCE.index("};", start)]
    page = {
        kind: tuple(int(part) for part in parts.split(","))
        for kind, parts in re.findall(r"(\w+): \[([\d, ]+)\]", table)
    }
    assert page == KIND_COLORS
    assert StyleConfig().kind_colors == KIND_COLORS
    assert tuple(told("OTHER_COLOR")) == OTHER_COLOR == StyleConfig().default_color
