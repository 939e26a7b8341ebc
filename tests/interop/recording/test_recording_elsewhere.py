"""A recording in the library of Foxglove and Lichtblick: every channel and message, whole or cut off."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pointit.recording.entries import Entry, body_kind, entry
from pointit.schemas import NS_PER_S
from pointit.schemas.catalogue.catalogue import example
from pointit.schemas.topics import PRESENCES, REQUESTS, TOPICS
from tests.support.environments import FETCH_S, fetched
from tests.support.recorded import write_recording

READER = Path(__file__).with_name("reader")
START = 1_700_000_000 * NS_PER_S

Read = Callable[..., dict[str, Any]]


@pytest.fixture(scope="module")
def read(tmp_path_factory: pytest.TempPathFactory) -> Read:
    """Return a function that reads a file with @mcap/core."""
    folder = tmp_path_factory.mktemp("reader")
    node = fetched(READER, folder)

    def run(*arguments: str) -> dict[str, Any]:
        command = (node, f"{folder / 'read.mjs'}", *arguments)
        told = subprocess.run(command, capture_output=True, text=True, timeout=FETCH_S, check=True)
        found: dict[str, Any] = json.loads(told.stdout)
        return found

    return run


def of_every_row(second: int) -> list[Entry]:
    """Return an entry of each row of the tables."""
    time_ns = START + second * NS_PER_S
    found = [entry(time_ns, row, "anna" if row.placeholder else "", example(row.message)) for row in TOPICS]
    for row in REQUESTS:
        kind: Any = body_kind(row)
        body = kind(stamp_ns=time_ns, query=example(row.query), reply=example(row.reply))
        found.append(entry(time_ns, row, "anna" if row.placeholder else "", body))
    return found + [entry(time_ns, row, "anna", True) for row in PRESENCES]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    entries = [each for second in range(20) for each in of_every_row(second)]
    return write_recording(tmp_path / "session.mcap", entries, START)


@pytest.mark.parametrize("mode", ["--index", "--stream"])
def test_library_of_foxglove_and_lichtblick_reads_every_channel(read: Read, path: Path, mode: str) -> None:
    found = read(f"{path}", mode)
    assert found["counts"] == {each.key: 20 for each in of_every_row(0)}
    assert found["heads"] == 1
    assert found["schemas"]["users/anna/imu"].startswith("ImuSample.v")


def test_truncated_recording_is_read_as_far_as_it_goes(read: Read, path: Path) -> None:
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    found = read(f"{path}", "--stream")
    assert set(found["counts"]) == {each.key for each in of_every_row(0)}
    assert 5 < min(found["counts"].values()) < 20
