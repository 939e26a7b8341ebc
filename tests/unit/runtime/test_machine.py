"""The machine of the code: given to a simulation by its process, and asked of the system nowhere else."""

import ast
import itertools
import os
import socket
from pathlib import Path

from pointit.runtime.clock import WallClock
from pointit.runtime.host.state_file import part_of_file
from pointit.runtime.machine import Machine, this_machine, using_machine
from pointit.schemas import NS_PER_S, Health
from pointit.schemas.topics import HEALTH
from pointit.services.keeper.service import Keeper
from tests.architecture import sources
from tests.support.bench import in_virtual_time, memory_bench, until

ASKED = {
    ("time", "time"),
    ("time", "time_ns"),
    ("os", "getpid"),
    ("socket", "gethostname"),
    ("platform", "node"),
    ("secrets", "token_hex"),
}
"""Functions of the system that only `machine.py` uses."""


def given() -> Machine:
    count = itertools.count()
    return Machine(
        now_ns=lambda: 5 * NS_PER_S,
        monotonic_ns=lambda: 7 * NS_PER_S,
        host_name="far",
        process_id=3,
        random_bytes=lambda length: next(count).to_bytes(length, "big"),
    )


def test_machine_is_that_of_the_system_unless_one_is_given() -> None:
    assert (this_machine().host_name, this_machine().process_id) == (socket.gethostname(), os.getpid())
    with using_machine(given()):
        assert (this_machine().host_name, this_machine().process_id) == ("far", 3)
        assert WallClock().now_ns() == 5 * NS_PER_S
        assert this_machine().monotonic_s() == 7.0
        parts = [part_of_file(Path("map.yaml")).name for _ in range(2)]
        assert parts == [".map.00000000.yaml", ".map.00000001.yaml"]
    assert this_machine().process_id == os.getpid()


@in_virtual_time
async def test_health_has_the_name_of_the_given_machine() -> None:
    async with memory_bench() as bench:
        reports: list[Health] = bench.collect(HEALTH)
        with using_machine(given()):
            bench.start(Keeper)
        await until(lambda: bool(reports))
        health = reports[0]
        assert (health.host, health.pid, health.stamp_ns) == ("far", 3, 5 * NS_PER_S)


def test_no_other_module_asks_the_system() -> None:
    found: list[str] = []
    for path in sources.shipped():
        if path.name == "machine.py" or sources.LAB in path.parents:
            continue
        for node in ast.walk(sources.tree(path)):
            if not isinstance(node, ast.Attribute) or not isinstance(node.value, ast.Name):
                continue
            if (node.value.id, node.attr) in ASKED:
                found.append(f"{path.relative_to(sources.ROOT)}:{node.lineno} {node.value.id}.{node.attr}")
    assert not found, f"use `this_machine()` of pointit.runtime.machine: {found}"
