"""The disk of the journal, and of all state, runs full under load, and is emptied again."""

import contextlib
import errno
import sqlite3
import time
from pathlib import Path

import pytest

from tests.faults.account import Account, Memory
from tests.faults.site import NOTICED_S, Site
from tests.faults.witness import Witness, witness
from tests.support.bench import until

BACK_S = 20.0
"""A journal tries again every 5 s."""
MORE = 3
"""Selections published while the disk is full."""
GROWTH_MB = 30.0

pytestmark = pytest.mark.slow


async def fill(site: Site, path: Path) -> None:
    """Write to `path` until the disk takes no more, not even in files that are there."""
    # SQLite writes over its log from the start when the log has been long: megabytes fit without any room.
    await until(lambda: is_cut(site.journal), what="the journal's log to be cut")
    with path.open("wb", buffering=0) as file:
        for size in (65536, 4096, 1):
            try:
                while True:
                    file.write(bytes(size))
            except OSError as error:
                assert error.errno == errno.ENOSPC  # noqa: PT017 - the expected error


def is_cut(journal: Path) -> bool:
    with contextlib.closing(sqlite3.connect(journal)) as db:
        busy, *_ = db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
    return not busy


@pytest.fixture
def small(site: Site) -> Site:
    if not site.has_small_disk:
        pytest.skip("needs a small disk for the site's state: no tmpfs can be mounted here without root")
    return site


def complains(seen: Witness, service: str) -> bool:
    return any("cannot be written" in warning for warning in seen.health[service].warnings)


async def test_selecting_goes_on_and_nothing_is_lost(small: Site, account: Account) -> None:
    async with witness(small) as seen:
        await seen.begins(small)
        await seen.sees_selected(1)
        before, selected = seen.processes(), set(seen.selected)
        memory = Memory.now(pid for pid, _ in before.values())
        filler = small.state / "filler"
        full_ns, full_s = time.time_ns(), time.monotonic()
        try:
            await fill(small, filler)
            await until(lambda: complains(seen, "selector"), NOTICED_S, "the selector to say so")
            noticed_s = time.monotonic() - full_s
            await until(lambda: bool(seen.findings("selector")), NOTICED_S, "doctor to say so")
            told = len(seen.told())
            await until(lambda: len(seen.told()) >= told + MORE, 30.0, "selecting to go on")
            assert len(small.told()) < seen.told()[-1][0], "what is told is in memory only"
            await seen.flows()
        finally:
            filler.unlink()
        room_s = time.monotonic()
        await until(lambda: not complains(seen, "selector"), BACK_S, "the selector to be content")
        recovered_s = time.monotonic() - room_s
        await seen.agrees(small)
        seen.is_undisturbed(before)
        await seen.keeps(selected)
        growth_mb = Memory.now(memory.of).growth_mb(memory)
        assert growth_mb < GROWTH_MB
        account.add(
            "disk full",
            noticed_s,
            "health of selector, conveyor, keeper",
            recovered_s,
            seen.lost_in_words(full_ns),
            memory_mb=growth_mb,
        )
        await until(lambda: not any(complains(seen, name) for name in seen.health), BACK_S, "no problem")
