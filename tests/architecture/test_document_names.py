"""Names in backticks that have no suffix: modules of the maintainers' map, identifiers and keys.

`test_documents.py` reads links, paths and commands.
"""

import re
from pathlib import Path

import pytest

from pointit.schemas.topics import REQUESTS, TOPICS
from tests.architecture.sources import ROOT
from tests.architecture.test_documents import texts

WEB = ROOT / "bridges/web"
PAGE = WEB / "client/src"
SUFFIXES = {WEB: (".py",), PAGE: (".ts", ".tsx"), ROOT / "pointit": (".py",)}
THIS = "tests/architecture/test_document_names.py"
FOREIGN = {
    "GraphDriverName", "DeviceAllow", "PrivateDevices", "SupplementaryGroups",  # podman, systemd
    "StaticFiles", "serialTimeout",  # starlette, Adafruit's LEDstream
    "readOnlyHint", "destructiveHint",  # Model Context Protocol
    "foxglove_bridge", "robot_state_publisher", "compression_mode",  # ROS 2
    "control_msgs", "FollowJointTrajectory", "GripperCommand", "pointing_target",
    "bodyID", "personID", "PointingTarget",  # a proposal of messages
    "belts_vr",  # a set of a finished experiment
    "measured_trials",  # `measured_` and the name of a table
}  # fmt: skip
FOREIGN_KEYS = {"home/zigbee2mqtt", "selection/acts"}
"""A topic of Zigbee2MQTT, and a key that a decision rejected."""
SYMBOLS = {"h_n", "h_e", "d_s", "l_w", "l_f", "d_cutoff", "f_c", "min_cutoff", "vMAJOR", "vVERSION", "rX"}
"""Letters of formulas and of a mode, and places for numbers."""
FUNCTIONS_OF_THE_MAP = {"check"}
"""Functions that the map names beside modules."""
MADE_BY_READERS = {"my_map", "my_end", "my_lamps", "my_shelf"}
PAGES_OF_EXAMPLES = {ROOT / "docs/writing.md", ROOT / "CHANGELOG.md"}
"""Pages whose names are examples of good and bad ones, or history."""
DOCUMENTS = sorted(
    {
        *ROOT.glob("*.md"),
        *(ROOT / "docs").rglob("*.md"),
        *(ROOT / "examples").rglob("*.md"),
        *(ROOT / folder / "README.md" for folder in ("bridges", "deploy", "lab")),
    }
    - PAGES_OF_EXAMPLES
)


@pytest.fixture(scope="module")
def words_of_sources() -> set[str]:
    words: set[str] = set()
    for name, text in texts().items():
        if name.endswith(".md") or name == THIS:
            continue
        words.update(re.findall(r"\w+", text))
        words.update(Path(name).with_suffix("").parts)
    return words


def without_blocks(text: str) -> str:
    """Return `text` without its blocks of code, which tests run or read."""
    return re.sub(r"(?ms)^[ ]*```.*?^[ ]*```", "", text)


def quoted_identifiers(text: str) -> set[str]:
    """Return the words in backticks that only a program writes: `snake_case` and `CamelCase`."""
    quoted = " ".join(re.findall(r"`([^`\n]+)`", without_blocks(text)))
    words = re.findall(r"\b\w+\b", quoted)
    snakes = {word for word in words if "_" in word.strip("_") and word.islower()}
    camels = {word for word in words if re.search(r"[a-z][A-Z]", word)}
    return snakes | camels


def unknown_keys(text: str) -> set[str]:
    """Return the keys in backticks that begin like a topic or request, such as `selector/…`, and are none."""
    keys = {row.key for row in (*REQUESTS, *TOPICS)}
    beginnings = {key.split("/")[0] for key in keys}
    patterns = [re.sub(r"\\\{\w+\\\}", "[^/]+", re.escape(key)) for key in keys]
    unknown: set[str] = set()
    for quoted in re.findall(r"`(?:pointit service call )?([a-z-]+(?:/[\w{}]+)+)[^`/.]*`", text):
        is_key = quoted.split("/")[0] in beginnings and quoted not in FOREIGN_KEYS
        is_file = (ROOT / "services" / quoted).exists()
        if is_key and not is_file and not any(re.fullmatch(pattern, quoted) for pattern in patterns):
            unknown.add(quoted)
    return unknown


def has_module(folder: Path, name: str) -> bool:
    """Return True if `name`, such as `pages/page_session`, is a module or a folder below `folder`."""
    end = name.rstrip("/")
    if (folder / end).exists():
        return True
    stem = end.rsplit("/", maxsplit=1)[-1]
    files = [file for suffix in SUFFIXES[folder] for file in folder.rglob(f"{stem}{suffix}")]
    return any(file.with_suffix("").as_posix().endswith(f"/{end}") for file in files)


def missing_modules(table: str) -> set[str]:
    """Return the names of the map `table` (part, server, page) that are no module, folder or class there."""
    missing: set[str] = set()
    for row in re.findall(r"(?m)^\|([^|]*)\|([^|]*)\|([^|]*)\|$", table)[2:]:
        for folder, cell in ((WEB, row[1]), (PAGE, row[2])):
            for name in re.findall(r"`([a-z][\w/]*(?:\.tsx?|\.py)?)`", cell):
                is_elsewhere = "/" in name and has_module(ROOT / "pointit", name)
                if not (name in FUNCTIONS_OF_THE_MAP or is_elsewhere or has_module(folder, name)):
                    missing.add(name)
    return missing


@pytest.mark.parametrize(
    "path", [pytest.param(path, id=path.relative_to(ROOT).as_posix()) for path in DOCUMENTS]
)
def test_identifiers_and_keys_of_documents_exist(path: Path, words_of_sources: set[str]) -> None:
    text = path.read_text(encoding="utf-8")
    unknown = quoted_identifiers(text) - words_of_sources - FOREIGN - SYMBOLS - MADE_BY_READERS
    assert unknown == set()
    assert unknown_keys(text) == set()


def test_modules_of_the_map_of_bridges_exist() -> None:
    text = (ROOT / "bridges/README.md").read_text(encoding="utf-8")
    (part,) = [part for part in text.split("\n## ") if part.startswith("Where things are\n")]
    assert missing_modules(part) == set()


def test_names_that_are_gone_are_found(words_of_sources: set[str]) -> None:
    """Names that documents had when they were gone."""
    stale = "`open_pages`, `selector/set_method`, `RobotGoal`, and `selector/method` of `PageSession`"
    assert quoted_identifiers(stale) - words_of_sources == {"open_pages", "set_method", "RobotGoal"}
    assert unknown_keys(stale) == {"selector/set_method"}
    head = "| part | server | page |\n|---|---|---|\n"
    row = "| paths | `open_pages`, `pages/page_session`; `wrists/phone_connection` | `worn_arm`, `mouse` |\n"
    row += "| devices | `devices`, `process`, `lanes`, `maps/checks` | `past/`: `lanes` |\n"
    assert missing_modules(head + row) == {
        "open_pages",
        "wrists/phone_connection",
        "worn_arm",
        "process",
        "lanes",
    }


def test_each_page_of_the_repository_is_read_by_a_test_or_made_by_a_program() -> None:
    made = ("bridges/web/static/", "schemas/catalogue/shipped/", ".github/")
    pages = {ROOT / name for name in texts() if name.endswith(".md") and not name.startswith(made)}
    templates = {page for page in pages if "templates" in page.parts}
    assert pages - templates - PAGES_OF_EXAMPLES <= {*DOCUMENTS}
    assert len(pages) > 100
