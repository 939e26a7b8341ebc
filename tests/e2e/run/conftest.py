"""Commands that a test has started do not outlive it."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.buses import free_port
from tests.support.commands import Commands


@pytest.fixture
def commands(tmp_path: Path) -> Iterator[Commands]:
    folder = tmp_path / "printed"
    folder.mkdir()
    started = Commands(folder)
    try:
        yield started
    finally:
        started.kill_all()


@pytest.fixture
def endpoint() -> str:
    """Return an address that nobody listens at."""
    return f"tcp/127.0.0.1:{free_port()}"
