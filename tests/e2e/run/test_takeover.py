"""A person's process that is started again elsewhere: the name goes over, and of two at once one ends."""

import json
import signal
import time

import pytest

from tests.support.bench import until
from tests.support.commands import Command, Commands, Onlooker, onlooker
from tests.support.pace import Patience

TAKEN_OVER_S = 20.0
"""Lease and listening are 5 s; the rest is a busy machine."""


def freeze(command: Command, number: int) -> None:
    for process in command.family():
        process.send_signal(number)


async def is_run_by(seen: Onlooker, command: Command, patience_s: float = TAKEN_OVER_S) -> None:
    """Wait until all messages of anna are from `command`, and her cursor moves."""
    pids = {process.pid for process in command.family()}
    began_s = time.monotonic()
    for instance in list(seen.health):
        if instance.endswith(".anna"):
            del seen.health[instance]
    await until(lambda: "pointing.anna" in seen.health, patience_s, "anna's health")
    await until(
        lambda: all(h.pid in pids for i, h in seen.health.items() if i.endswith(".anna")),
        patience_s,
        f"{command.err[-2000:]}",
    )
    await seen.sees_cursors("anna", patience_s=max(5.0, patience_s - (time.monotonic() - began_s)))


@pytest.mark.long
async def test_a_stopped_process_loses_its_name_and_ends_when_it_wakes(
    commands: Commands, endpoint: str
) -> None:
    commands.start("run", "scenario_2", "--site-only", "--no-view", "--listen", endpoint)
    join = ("person", "add", "anna", "--no-view", "--connect", endpoint)
    async with onlooker(endpoint) as seen:
        await seen.hears("pui")
        old = commands.start(*join)
        await seen.sees_cursors("anna")
        freeze(old, signal.SIGSTOP)
        new = commands.start(*join)
        await is_run_by(seen, new)
        freeze(old, signal.SIGCONT)
        ended = await old.end()
        assert ended.code == 0, "as when it is asked to end"
        assert "has taken over the name, having begun later" in ended.err
        assert f"process {new.process.pid}" in ended.err
        assert new.is_running
        await is_run_by(seen, new)
        refused = await commands.pointit(*join)
        assert refused.code == 2
        assert f"process {new.process.pid} on " in refused.sentence


async def test_a_killed_process_is_followed_at_once(commands: Commands, endpoint: str) -> None:
    commands.start("run", "scenario_2", "--site-only", "--no-view", "--listen", endpoint)
    join = ("person", "add", "anna", "--no-view", "--connect", endpoint)
    async with onlooker(endpoint) as seen:
        await seen.hears("pui")
        for _ in range(2):
            command = commands.start(*join)
            await is_run_by(seen, command)
            command.process.kill()
            await until(lambda: "anna" not in seen.people, what="her to be gone")
        last = commands.start(*join)
        await is_run_by(seen, last)
        assert "already" not in last.err


async def test_a_single_service_of_a_person_is_refused_beside_a_living_one(
    commands: Commands, endpoint: str
) -> None:
    commands.start("run", "scenario_2", "--no-view", "--listen", endpoint)
    async with onlooker(endpoint) as seen:
        await seen.sees_cursors("user1")
        ended = await commands.pointit("service", "run", "pointing", "--user", "user1", "--connect", endpoint)
        assert ended.code == 2
        assert ended.sentence.startswith("pointing.user1: already on site lab")


async def test_two_of_what_all_share_are_told(commands: Commands, endpoint: str) -> None:
    commands.start("run", "scenario_2", "--site-only", "--no-view", "--listen", endpoint)
    async with onlooker(endpoint) as seen:
        await seen.hears("led-driver")
        second = commands.start("service", "run", "led-driver", "--connect", endpoint)
        await until(
            lambda: any("runs twice" in warning for h in seen.health.values() for warning in h.warnings),
            TAKEN_OVER_S,
            "the warning",
        )
        patience, codes = Patience(TAKEN_OVER_S), set[tuple[str, str]]()
        while ("twice", "led-driver") not in codes:
            assert not patience.is_over(), codes
            report = json.loads((await commands.pointit("doctor", "--json", "--connect", endpoint)).out)
            codes = {(finding["code"], finding["service"]) for finding in report["findings"]}
        assert second.is_running
