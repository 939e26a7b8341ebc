"""The fault suite: real processes, and a table of what each fault did at the end (`pytest tests/faults`)."""

from collections.abc import Iterator

import pytest

from tests.faults.account import Account
from tests.faults.site import Site
from tests.support.commands import Commands

_ACCOUNT = pytest.StashKey[Account]()


@pytest.fixture
def account(pytestconfig: pytest.Config) -> Account:
    """Return the table of this run."""
    return pytestconfig.stash.setdefault(_ACCOUNT, Account())


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """Return the secured site of tests that leave it as they have found it; it begins when asked to."""
    path = tmp_path_factory.mktemp("shared")
    folder = path / "printed"
    folder.mkdir()
    started = Commands(folder)
    shared = Site(path, started)
    with shared.on_small_disk():
        try:
            yield shared
        finally:
            started.kill_all()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Print what every fault did."""
    account = config.stash.get(_ACCOUNT, None)
    if account is not None and account.rows:
        terminalreporter.section("faults")
        for line in account.lines():
            terminalreporter.write_line(line)
