"""Captured output of a running ROS 2 (Jazzy, Kilted, rmw_zenoh 0.2.10), in `golden/`."""

import json
import re
from pathlib import Path
from typing import Any

from pointit.bridges.ros2.types.rihs01 import ARRAY, BASE, NAME, SEQUENCE, Fields

FOLDER = Path(__file__).parent / "golden"

LINE = re.compile(r"([\w/]+)(?:<=(\d+))?(\[(<=)?(\d*)\])? (\w+)(?: .*)?")


def golden(name: str) -> Any:
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def definitions() -> dict[str, Fields]:
    """Fields of types that rosbags does not bring, so that their hashes can be compared, too."""
    return {name: [field(line) for line in lines] for name, lines in golden("definitions").items()}


def field(line: str) -> tuple[str, Any]:
    """A line of a definition as `rihs01` describes fields; a reader of its own, so that two must agree."""
    found = LINE.fullmatch(line)
    assert found is not None, line
    kind, text_bound, listed, at_most, count, name = found.groups()
    of: Any = (NAME, kind.replace("/", "/msg/")) if "/" in kind else (BASE, (kind, int(text_bound or 0)))
    if listed:
        of = (ARRAY if count and not at_most else SEQUENCE, (of, int(count or 0)))
    return name, of
