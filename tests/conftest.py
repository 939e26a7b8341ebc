"""Rules for every test: no task or command outlives it, and no state of this machine is read or written."""

import asyncio
import os
import signal
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest
import pytest_asyncio
from hypothesis import HealthCheck, settings

from tests.support.buses import free_port
from tests.support.commands import Commands

# The same examples in every run: a failure is due to a change; `--hypothesis-profile=search` tries others.
# How fast this machine is says nothing about a property.
settings.register_profile("search", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("repeatable", settings.get_profile("search"), derandomize=True)
settings.load_profile("repeatable")


def pytest_configure() -> None:
    """Restore Ctrl-C and the width of tables.

    A shell starts background jobs with SIGINT ignored, and children inherit that. Workers of pytest-xdist set
    COLUMNS, which would make tables as narrow as a terminal.
    """
    os.environ.pop("COLUMNS", None)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give each test, and the processes it starts, an empty state directory."""
    path = tmp_path / "state"
    monkeypatch.setenv("POINTIT_STATE", str(path))
    return path


@pytest_asyncio.fixture(autouse=True)
async def no_task_is_left() -> AsyncIterator[None]:
    """Fail a test that leaves tasks behind."""
    before = asyncio.all_tasks()
    yield
    mine = {asyncio.current_task()}
    left = [task for task in asyncio.all_tasks() - before - mine if not task.done()]
    for task in left:
        task.cancel()
    await asyncio.gather(*left, return_exceptions=True)
    assert not left, f"tasks left running: {[task.get_name() for task in left]}"


@pytest.fixture
def commands(tmp_path: Path) -> Iterator[Commands]:
    """Start `pointit …`; nothing outlives the test."""
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
