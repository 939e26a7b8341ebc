"""Commands whose standard streams are closed, as programs that start others may leave them."""

import subprocess
import sys
from itertools import combinations
from pathlib import Path

import pytest

COMMANDS = (
    (["plugin", "list"], 0),
    (["map", "export", "conveyor", "--as", "csv"], 0),
    (["map", "check", "conveyor"], 0),
    (["map", "export", "missing", "--as", "csv"], 2),
)
CLOSED = [numbers for count in (1, 2, 3) for numbers in combinations((0, 1, 2), count)]


@pytest.mark.parametrize("numbers", CLOSED, ids=str)
def test_command_ends_as_usual_when_streams_are_closed(numbers: tuple[int, ...], tmp_path: Path) -> None:
    words, expected = COMMANDS[sum(numbers)]
    closing = " ".join(f"{number}>&-" for number in numbers)
    errors = tmp_path / "errors"
    command = f'"$@" 2>"{errors}" {closing}'

    result = subprocess.run(
        ["/bin/sh", "-c", command, "sh", sys.executable, "-m", "pointit", *words], check=False
    )

    assert result.returncode == expected
    assert "Traceback" not in errors.read_text()
    assert "fault of PointIt" not in errors.read_text()
