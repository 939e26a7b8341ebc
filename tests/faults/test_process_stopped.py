"""Processes of a loaded, secured site stand still (SIGSTOP) for a few seconds and go on (SIGCONT)."""

import os
import signal
import time

import pytest

from tests.faults.account import Account, Memory
from tests.faults.site import INSTANCES, NOTICED_S, Site
from tests.faults.witness import witness
from tests.support.bench import until
from tests.support.pace import within

LEAST_S = 4.0
"""Longer than Zenoh's lease: the process is taken for gone meanwhile."""
BACK_S = 20.0
GROWTH_MB = 30.0
MOST_STALE = 40
"""Cursors of old rays: the content of the sockets, less those that newer rays have overtaken."""
OFTEN = ("pui", "selector", "pointing.user1")
SELDOM = ("led-driver", "conveyor-sim", "keeper", "localizer.user1", "supervisor.user1", "user-sim.user1")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


@pytest.mark.parametrize(
    "instance", [*OFTEN, *(pytest.param(name, marks=pytest.mark.long) for name in SELDOM), "router"]
)
async def test_a_stopped_process_goes_on_with_the_new(site: Site, account: Account, instance: str) -> None:
    async with witness(site) as seen:
        await seen.begins(site)
        await seen.sees_selected(1)
        before, selected = seen.processes(), set(seen.selected)
        pids = {name: pid for name, (pid, _) in before.items()} | {"router": site.router.process.pid}
        memory, lost = Memory.now(pids.values()), site.says_lost()
        stopped_ns, stopped_s = time.time_ns(), time.monotonic()
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
        woken_ns, woken_s = time.time_ns(), time.monotonic()
        await seen.flows()
        await until(lambda: set(INSTANCES) <= seen.present, BACK_S, "all to be present")
        recovered_s = time.monotonic() - woken_s
        assert within(recovered_s, BACK_S)
        await until(lambda: not seen.findings(instance), BACK_S, f"nothing to be found of {instance}")
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
