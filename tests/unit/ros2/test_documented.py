"""docs/how-to/ros2.md names every route as the table has it, and proposed messages are definitions."""

import re
from pathlib import Path

from rosbags.typesys import get_types_from_msg

from pointit.bridges.ros2.routing.routes import routes
from pointit.bridges.ros2.types.definitions import Definitions

DOCS = Path(__file__).parents[3] / "docs"
TEXT = (DOCS / "how-to/ros2.md").read_text(encoding="utf-8")
PROPOSAL = (DOCS / "explanation/pointing-messages-proposal.md").read_text(encoding="utf-8")


def test_every_route_is_documented_and_no_other() -> None:
    rows = [line.split("|") for line in TEXT.splitlines() if line.startswith("| `") and line.count("|") == 5]
    told = {(row[1].strip(" `"), row[2].strip(" `"), row[3].strip()) for row in rows}
    there = {
        (route.name, route.ros, route.type.replace("/msg/", "/").replace("/srv/", "/"))
        for route in routes(ros4hri=True).all
    }
    assert told == there


def test_what_yields_and_what_is_off_is_said() -> None:
    for route in routes(ros4hri=True).all:
        (line,) = (line for line in TEXT.splitlines() if line.startswith(f"| `{route.name}` "))
        assert ("yields" in line) is route.yields
        assert ("off by default" in line) is not route.enabled


def test_proposed_messages_are_valid_definitions() -> None:
    texts = dict(
        re.findall(r"^## (hri_msgs/msg/\w+)\n\n```text\n(.+?)```", PROPOSAL, re.MULTILINE | re.DOTALL)
    )
    store = Definitions("jazzy").store
    for name, text in texts.items():
        store.register(get_types_from_msg(text, name))
    assert len(texts) == 3
    for name in texts:
        assert store.hash_rihs01(name).startswith("RIHS01_")
