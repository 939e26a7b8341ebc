"""The layout that is shipped names what the bridge serves."""

import json
import re
from typing import Any

from pointit.bridges.foxglove.scene import PARTS
from pointit.bridges.foxglove.server import LOG, picture_topic
from pointit.bridges.foxglove.service import LAYOUT
from pointit.bridges.foxglove.shapes import WORLD
from pointit.schemas import Health
from pointit.schemas.catalogue.json_channel import JsonChannel, channel_name
from pointit.schemas.topics import TOPICS
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
