"""The fault suite: real processes, and a table of each fault's effect at the end (`pytest tests/faults`)."""

import contextlib
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest

from tests.faults.account import Account
from tests.faults.site import Site
from tests.support.commands import Commands

_ACCOUNT = pytest.StashKey[Account]()


@pytest.fixture
def account(pytestconfig: pytest.Config) -> Account:
    return pytestconfig.stash.setdefault(_ACCOUNT, Account())


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """Return the secured site of a module's tests, which leave it as they have found it.

    It ends with them, since it takes half of two cores.
    """
    with _running(tmp_path_factory.mktemp("shared")) as shared, shared.on_small_disk():
        yield shared


@pytest.fixture(scope="module")
def password_site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """Return the same that goes by passwords."""
    with _running(tmp_path_factory.mktemp("passwords"), password=True) as shared:
        yield shared


@pytest.fixture(
    params=["site", pytest.param("password_site", marks=pytest.mark.long)], ids=["certificates", "passwords"]
)
def either_site(request: pytest.FixtureRequest) -> Site:
    found: Site = request.getfixturevalue(request.param)
    return found


@contextlib.contextmanager
def _running(path: Path, *, password: bool = False) -> Generator[Site]:
    folder = path / "printed"
    folder.mkdir()
    started = Commands(folder)
    try:
        yield Site(path, started, password=password)
    finally:
        started.kill_all()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    account = config.stash.get(_ACCOUNT, None)
    if account is not None and account.rows:
        terminalreporter.section("faults")
        for line in account.lines():
            terminalreporter.write_line(line)
