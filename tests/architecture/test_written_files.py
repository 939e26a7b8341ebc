"""Files that a person keeps are replaced as a whole: a full disk or a crash leaves the earlier one."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROOMS = ("pointit", "services", "bridges", "schemas", "lab/pointit_lab")
WRITERS = {"write_text", "write_bytes", "savefig", "write_table"}
OWN_WAY = {
    "bridges/web/wrists/pairing.py": "a picture in memory",
    "lab/pointit_lab/benchmarks/against.py": "temporary",
    "lab/pointit_lab/benchmarks/ros2.py": "temporary",
    "lab/pointit_lab/devices/contracts/imu.py": "temporary",
    "lab/pointit_lab/loadtest/network/routers.py": "temporary",
    "pointit/assistants/audit_file.py": "lines that are appended",
    "pointit/cli/maps/scan.py": "temporary",
    "pointit/cli/shell.py": "a line appended to the start file of a shell",
    "pointit/cli/plugins/check.py": "temporary",
    "pointit/conversion/bag_file.py": "temporary",
    "pointit/conversion/export_csv.py": "files of a folder, all replaced at the end",
    "pointit/conversion/export_bids.py": "files of a folder, all replaced at the end",
    "pointit/launch/run/processes.py": "temporary",
    "pointit/maps/edit.py": "complete before it has its name",
    "pointit/replay/replayed_services.py": "temporary",
    "services/recorder/sink.py": "a recording, written for hours",
    "pointit/study/append_only_csv.py": "rows that are appended",
    "pointit/study_report/figures.py": "text in memory",
}
"""Modules that write without `replaced_file`, with the reason."""


def writes(path: Path) -> list[int]:
    """Return the lines that write a file which is not one of `replaced_file`."""
    found: list[int] = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
            continue
        names = {each.id for each in (node.func.value, *node.args) if isinstance(each, ast.Name)}
        mode = next((each.value for each in node.args if isinstance(each, ast.Constant)), "")
        is_open = node.func.attr == "open" and isinstance(mode, str) and re.fullmatch(r"[wax][bt+]*", mode)
        if (node.func.attr in WRITERS or is_open) and not names & {"part", "formatter"}:
            found.append(node.lineno)
    return found


@pytest.mark.parametrize("room", ROOMS)
def test_each_file_is_written_beside_and_then_renamed(room: str) -> None:
    found = {
        f"{path.relative_to(ROOT)}:{line}"
        for path in (ROOT / room).rglob("*.py")
        for line in writes(path)
        if str(path.relative_to(ROOT)) not in OWN_WAY
    }
    assert not found, "use `replaced_file` of runtime/host/state_file.py, its file called `part`"


def test_modules_with_a_way_of_their_own_exist() -> None:
    assert [path for path in OWN_WAY if not (ROOT / path).exists()] == []
