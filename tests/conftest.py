"""Rules for every test: no task or command outlives it, and no state of this machine is read or written."""

import gc
import itertools
import logging
import os
import signal
import sys
from collections.abc import AsyncIterator, Generator, Iterator
from pathlib import Path

import pytest
import pytest_asyncio
from hypothesis import HealthCheck, given, settings
from hypothesis.strategies import none

from pointit.runtime.config.environment_variables import LOG_FORMAT
from pointit.schemas.base import ConstructorChecks
from pointit.testing.bench import no_task_left
from tests.support.buses import free_port
from tests.support.commands import Commands
from tests.support.schedule import (
    pytest_xdist_make_scheduler,  # noqa: F401 - a hook
    start_shares,
    unit_of,
)
from tests.support.thread_report import pytest_runtest_makereport  # noqa: F401 - a hook

# The same few examples in every run: a failure is due to a change. `--hypothesis-profile=search` tries more,
# and others each time; `few` are for other versions of Python. How fast this machine is says nothing about a
# property.
settings.register_profile(
    "search", max_examples=200, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("repeatable", settings.get_profile("search"), derandomize=True, max_examples=25)
settings.register_profile("few", settings.get_profile("repeatable"), max_examples=8)
settings.load_profile("repeatable")


def pytest_configure() -> None:
    """Restore Ctrl-C and the width of tables, validate what services calculate, and compile modules once.

    A shell starts background jobs with SIGINT ignored, and children inherit that. Workers of pytest-xdist set
    COLUMNS, which would make tables as narrow as a terminal. Containers set PYTHONDONTWRITEBYTECODE,
    with which each process would compile all that it imports, and the assertions of all tests.
    """
    ConstructorChecks.are_on = True
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False
    os.environ.pop("COLUMNS", None)
    os.environ[LOG_FORMAT] = "json"  # tests read the logs of commands
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@given(none())
def _use_hypothesis(_nothing: None) -> None:
    """Do nothing."""


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Import all tests without garbage collections, which took a seventh of that time."""
    _use_hypothesis()  # it looks through all objects for its generator: now they are few, and none is frozen
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mix the folders' files for the processes of pytest-xdist: in their order, all would wait first."""
    if not hasattr(config, "workerinput"):
        return
    tests = [(item.nodeid, item.get_closest_marker("slow") is not None) for item in items]
    shares = start_shares(tests)
    items.sort(key=lambda item: shares[unit_of(item.nodeid)])


@pytest.fixture(autouse=True, scope="module")
def only_garbage_of_this_file() -> None:
    """Leave what is imported, and what earlier files left, out of garbage collections: an eighth of CI."""
    gc.collect()
    gc.freeze()


_states = itertools.count()


@pytest.fixture(autouse=True)
def own_state(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give each test, and the processes it starts, a state directory that does not exist yet."""
    path = tmp_path_factory.getbasetemp() / f"state{next(_states)}"
    monkeypatch.setenv("POINTIT_STATE", str(path))
    return path


@pytest.fixture(autouse=True)
def no_log_handler_is_left() -> Iterator[None]:
    """Take back the logging that a command has set up here: its handler hides tracebacks from later tests."""
    root = logging.getLogger()
    other = logging.getLogger("asyncio")
    handlers = [*root.handlers]
    levels = (root.level, other.level)
    yield
    root.handlers[:] = handlers
    root.setLevel(levels[0])
    other.setLevel(levels[1])


@pytest.fixture(autouse=True)
def no_task_is_left(request: pytest.FixtureRequest) -> None:
    """Fail an asynchronous test that leaves tasks behind; others need no loop."""
    if pytest_asyncio.is_async_test(request.node):
        request.getfixturevalue("only_tasks_of_before")


@pytest_asyncio.fixture
async def only_tasks_of_before() -> AsyncIterator[None]:
    """Fail if tasks are left at the end that were not there at the begin."""
    async with no_task_left():
        yield


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
