"""Clocks of single machines jump while everything runs: this is reported and affects no one else."""

import asyncio
import mmap
import os
import signal
import struct
import time
from collections.abc import Mapping
from pathlib import Path

import pytest

from tests.faults.account import Account
from tests.faults.site import NOTICED_S, Site
from tests.faults.witness import Witness, witness
from tests.support.bench import until
from tests.support.pace import within

BACK_S = 20.0
JUMPS_S = (-5.0, 5.0)
"""Jumps in this order: for 20 s the keeper still reports a clock that was ahead."""
MINES = ("selector", "conveyor-sim")
"""Services that run on a machine of their own."""
pytestmark = [pytest.mark.slow, pytest.mark.long]


FAKED = '''\
"""Has this process go by the clock of its machine, which a test sets."""
import mmap, os, socket, struct, time

with open(os.environ["FAKED_CLOCK"], "rb") as file:
    offset = mmap.mmap(file.fileno(), 8, access=mmap.ACCESS_READ)
wall_ns = time.time_ns
time.time_ns = lambda: wall_ns() + struct.unpack("q", offset[:])[0]
time.time = lambda: time.time_ns() / 1e9
if os.environ.get("FAKED_HOST"):
    socket.gethostname = lambda: os.environ["FAKED_HOST"]
'''


class MachineClock:
    """The wall's time and an offset, which is in a file that all processes of the machine have mapped."""

    def __init__(self, folder: Path, host: str = "") -> None:
        """Begin right; `host` is how the machine is called, else as this one."""
        folder.mkdir()
        (folder / "sitecustomize.py").write_text(FAKED)
        self._folder = folder
        self._host = host
        self._path = folder / "offset"
        self._path.write_bytes(bytes(8))
        with self._path.open("r+b") as file:
            self._offset = mmap.mmap(file.fileno(), 8)
        self.ahead_s = 0.0
        """Lead of this machine's own clock."""

    def set(self, ahead_s: float) -> None:
        self.ahead_s = ahead_s
        self._offset[:] = struct.pack("q", round(ahead_s * 1e9))

    @property
    def environment(self) -> Mapping[str, str]:
        paths = [str(self._folder), os.environ.get("PYTHONPATH", "")]
        return {
            "PYTHONPATH": os.pathsep.join(path for path in paths if path),
            "FAKED_CLOCK": str(self._path),
            "FAKED_HOST": self._host,
        }


def names(seen: Witness, machine: str) -> bool:
    return any(f"the clock of machine {machine} is" in finding.sentence for finding in seen.findings())


async def test_of_a_persons_machine(site: Site, account: Account, tmp_path: Path) -> None:
    clock = MachineClock(tmp_path / "watch", "watch")
    async with witness(site) as seen:
        await seen.begins(site)
        before = seen.processes()
        environment = {**site.environment("anna"), **clock.environment}
        anna = site.commands.start_program("person", "add", "anna", "--no-view", environment=environment)
        await seen.flows("anna")
        for ahead_s in JUMPS_S:
            jump_ns = time.time_ns()
            jump_s = time.monotonic()
            clock.set(ahead_s)
            await until(lambda: names(seen, "watch"), NOTICED_S, "doctor to name the machine")
            noticed_s = time.monotonic() - jump_s
            await seen.flows()
            clock.set(0.0)
            right_s = time.monotonic()
            await seen.flows("anna")
            recovered_s = time.monotonic() - right_s
            await seen.agrees(site)
            account.add(
                f"clock of a person's machine {ahead_s:+.0f} s, and back",
                noticed_s,
                "doctor, keeper: clock of machine",
                recovered_s,
                seen.lost_in_words(jump_ns, but="anna"),
            )
            assert within(recovered_s, BACK_S)
            if ahead_s < 0:
                await until(lambda: not names(seen, "watch"), BACK_S, "nothing to be found of the clock")

        seen.is_undisturbed(before)
        assert (await anna.stop(signal.SIGINT)).code == 0
        await until(lambda: "anna" not in seen.people, what="her to be gone")


async def moved(site: Site, seen: Witness, clock: MachineClock) -> None:
    """Run `MINES` on the machine of `clock`."""
    for instance in MINES:
        os.kill(seen.health[instance].pid, signal.SIGKILL)
        await seen.finds(instance, "absent")
        assert site.run is not None
        await site.run.says(f"{instance} was ended by SIGKILL")
        del seen.health[instance]
        site.restart(instance, clock.environment)
    for instance in MINES:
        await seen.hears(instance)
    await seen.flows()


@pytest.mark.parametrize("ahead_s", [30.0, -30.0])
@pytest.mark.long
async def test_of_the_conveyors_machine(site: Site, account: Account, tmp_path: Path, ahead_s: float) -> None:
    machine = f"plc{ahead_s:+.0f}"
    clock = MachineClock(tmp_path / "plc", machine)
    async with witness(site) as seen:
        await seen.begins(site)
        await moved(site, seen, clock)
        before = seen.processes()
        await seen.sees_selected(1)
        jump_ns = time.time_ns()
        jump_s = time.monotonic()
        selected = set(seen.selected)

        clock.set(ahead_s)
        await until(lambda: names(seen, machine), NOTICED_S, "doctor to name the machine")
        noticed_s = time.monotonic() - jump_s
        await asyncio.sleep(max(0.0, 3.0 - noticed_s))
        clock.set(0.0)
        right_s = time.monotonic()
        told = len(seen.told())
        dispatched = len(seen.events)
        await seen.flows()
        flows_s = time.monotonic() - right_s

        await until(lambda: len(seen.told()) > told, 30.0, "selecting to go on")
        await until(lambda: len(seen.events) > dispatched, 30.0, "dispatching to go on")
        recovered_s = time.monotonic() - right_s
        await seen.keeps(selected)
        await seen.agrees(site)
        seen.is_undisturbed(before)

        account.add(
            f"clock of selector's and conveyor's machine {ahead_s:+.0f} s, and back",
            noticed_s,
            "doctor, keeper: clock of machine",
            flows_s,
            f"{seen.lost_in_words(jump_ns)}; selects again after {recovered_s:.1f} s",
        )
        assert within(flows_s, BACK_S)
