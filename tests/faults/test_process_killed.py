"""Every process of a loaded, secured site is killed, stopped and started again, and its disk runs full."""

import contextlib
import errno
import os
import signal
import sqlite3
import time
from pathlib import Path

import pytest

from tests.faults.account import Account, Memory
from tests.faults.site import INSTANCES, NOTICED_S, Site
from tests.faults.witness import Witness, witness
from tests.support.bench import until
from tests.support.pace import within

BACK_S = 30.0
"""A process starts in a second or two on a quiet machine."""
GROWTH_MB = 30.0
OFTEN = ("pui", "selector", "conveyor-sim", "keeper")
SELDOM = ("led-driver", "pointing.user1", "localizer.user1", "supervisor.user1", "user-sim.user1")
pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    "instance", [*OFTEN, *(pytest.param(name, marks=pytest.mark.long) for name in SELDOM)]
)
async def test_a_killed_service_is_noticed_and_restarts(site: Site, account: Account, instance: str) -> None:
    async with witness(site) as seen:
        await seen.begins(site)
        await seen.sees_selected(1)
        before = seen.processes()
        selected = set(seen.selected)
        memory = Memory.now(pid for other, (pid, _) in before.items() if other != instance)
        killed_ns = time.time_ns()
        killed_s = time.monotonic()
        os.kill(before[instance][0], signal.SIGKILL)
        finding = await seen.finds(instance, "absent")
        noticed_s = time.monotonic() - killed_s
        assert site.run is not None
        await site.run.says(f"{instance} was ended by SIGKILL")
        service, _, user = instance.partition(".")
        command = f"pointit service run {service}" + (f" --user {user}" if user else "")

        assert finding.remedy.startswith(f"start it again: `{command}` (the log of what started ")
        del seen.health[instance]
        began_s = time.monotonic()
        again = site.restart(instance)
        await seen.hears(instance)
        await seen.flows()
        recovered_s = time.monotonic() - began_s

        assert within(recovered_s, BACK_S)
        assert seen.health[instance].pid == again.process.pid
        seen.is_undisturbed(before, instance)
        await seen.keeps(selected)
        await seen.agrees(site)
        growth_mb = Memory.now(memory.of).growth_mb(memory)
        assert growth_mb < GROWTH_MB

        lost = seen.lost_in_words(killed_ns)
        by = "doctor: absent; the run's log"
        account.add(f"kill -9 {instance}", noticed_s, by, recovered_s, lost, memory_mb=growth_mb)


async def test_a_killed_router_is_noticed_and_comes_back(site: Site, account: Account) -> None:
    async with witness(site) as seen:
        await seen.begins(site)
        await seen.sees_selected(1)
        before = seen.processes()
        selected = set(seen.selected)
        memory = Memory.now(pid for pid, _ in before.values())
        lost = site.says_lost()
        killed_ns = time.time_ns()
        killed_s = time.monotonic()

        site.router.process.kill()
        await until(lambda: site.says_lost() > lost, NOTICED_S, "the run to say so")
        noticed_s = time.monotonic() - killed_s
        report = await site.doctor()
        assert [item["code"] for item in report["findings"]] == ["unreachable"]

        began_s = time.monotonic()
        await site.route().says("router listens")
        await until(lambda: set(before) <= seen.present, BACK_S, "all to be present again")

        await seen.flows()
        recovered_s = time.monotonic() - began_s
        assert within(recovered_s, BACK_S)

        seen.is_undisturbed(before, "router")  # which reports its own health
        await seen.keeps(selected)
        await seen.agrees(site)
        growth_mb = Memory.now(memory.of).growth_mb(memory)
        assert growth_mb < GROWTH_MB

        by = "log of each; doctor: unreachable"
        account.add(
            "kill -9 router", noticed_s, by, recovered_s, seen.lost_in_words(killed_ns), memory_mb=growth_mb
        )


async def test_after_all_of_it_doctor_is_content(site: Site) -> None:
    async with witness(site) as seen:
        await seen.begins(site)
    await site.content()
    if "keeper" in site.again:  # an operator's, not the run's
        ended = await site.again["keeper"].stop(signal.SIGTERM)
        assert ended.code == 0
        site.restart("keeper")
    logs = [path.read_text() for path in site.path.glob("**/pointit-*/*.log")]
    assert logs
    assert not any("Traceback" in log for log in (*logs, *(again.err for again in site.again.values())))


LEAST_S = 4.0
"""Longer than Zenoh's lease: the process is taken for gone meanwhile."""
WOKEN_S = 20.0
MOST_STALE = 40
"""Cursors of old rays: the content of the sockets, less those that newer rays have overtaken."""
STOPPED_OFTEN = ("pui", "selector")
STOPPED_SELDOM = ("conveyor-sim", "keeper", *SELDOM)


@pytest.mark.parametrize(
    "instance",
    [*STOPPED_OFTEN, *(pytest.param(name, marks=pytest.mark.long) for name in STOPPED_SELDOM), "router"],
)
async def test_a_stopped_process_goes_on_with_the_new(site: Site, account: Account, instance: str) -> None:
    async with witness(site) as seen:
        await seen.begins(site)
        await seen.sees_selected(1)
        before = seen.processes()
        selected = set(seen.selected)
        pids = {name: pid for name, (pid, _) in before.items()} | {"router": site.router.process.pid}
        memory = Memory.now(pids.values())
        lost = site.says_lost()
        stopped_ns = time.time_ns()
        stopped_s = time.monotonic()
        os.kill(pids[instance], signal.SIGSTOP)
        try:
            if instance == "router":
                await until(lambda: site.says_lost() > lost, NOTICED_S, "the run to say so")
            else:
                await seen.finds(instance, "silent", "absent")
            noticed_s = time.monotonic() - stopped_s
            await until(lambda: time.monotonic() - stopped_s >= LEAST_S, NOTICED_S)
            growth_mb = Memory.now(pids.values()).growth_mb(memory)
        finally:
            os.kill(pids[instance], signal.SIGCONT)
        woken_ns = time.time_ns()
        woken_s = time.monotonic()

        await seen.flows()
        await until(lambda: set(INSTANCES) <= seen.present, WOKEN_S, "all to be present")
        recovered_s = time.monotonic() - woken_s
        assert within(recovered_s, WOKEN_S)
        await until(lambda: not seen.findings(instance), WOKEN_S, f"nothing to be found of {instance}")

        seen.is_undisturbed(before)
        await seen.keeps(selected)
        await seen.agrees(site)
        stale = seen.stale(woken_ns)

        growth_mb = max(growth_mb, Memory.now(pids.values()).growth_mb(memory))
        account.add(
            f"SIGSTOP {instance}",
            noticed_s,
            "log of each: router lost" if instance == "router" else "doctor: silent, absent",
            recovered_s,
            f"{seen.lost_in_words(stopped_ns)}; {stale} stale cursors after it",
            memory_mb=growth_mb,
        )
        assert stale < MOST_STALE
        assert growth_mb < GROWTH_MB


JOURNAL_BACK_S = 20.0
"""A journal tries again every 5 s."""
MORE = 3
"""Selections published while the disk is full."""


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
        before = seen.processes()
        selected = set(seen.selected)
        memory = Memory.now(pid for pid, _ in before.values())
        filler = small.state / "filler"
        full_ns = time.time_ns()
        full_s = time.monotonic()
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

        await until(lambda: not complains(seen, "selector"), JOURNAL_BACK_S, "the selector to be content")
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
        await until(
            lambda: not any(complains(seen, name) for name in seen.health), JOURNAL_BACK_S, "no problem"
        )
