"""Runs in several processes: who takes over, and who serves a person."""

import contextlib
import json
import os
import signal
import time
from collections.abc import AsyncGenerator
from typing import Any

import psutil
import pytest

from pointit.schemas import SelectionEvent, SetTolerance
from pointit.schemas.topics import CURSOR, HOVER, RAY, SELECTION_EVENTS, SET_TOLERANCE, Topic
from tests.support.bench import until
from tests.support.commands import Command, Commands, Onlooker, doctor_is_content, onlooker
from tests.support.pace import Patience

TAKEN_OVER_S = 20.0
"""Lease and listening are 5 s; the rest is a busy machine."""


@contextlib.asynccontextmanager
async def site_seen(
    commands: Commands, endpoint: str, scenario: str = "scenario_2", service: str = "pui"
) -> AsyncGenerator[Onlooker]:
    """Start a site without people. Yield who looks on, once `service` is heard.

    It never runs out of objects to point at, however long a busy machine takes.
    """
    endless = ("--set", "conveyor-sim.feeder.count=0") if scenario == "scenario_3" else ()
    commands.start("run", scenario, "--site-only", "--no-view", *endless, "--listen", endpoint)
    async with onlooker(endpoint) as seen:
        await seen.hears(service)
        yield seen


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
async def test_a_stopped_process_loses_its_name_and_ends_awake(commands: Commands, endpoint: str) -> None:
    join = ("person", "add", "anna", "--no-view", "--connect", endpoint)
    async with site_seen(commands, endpoint) as seen:
        old = commands.start(*join)
        await seen.sees_cursors("anna")
        freeze(old, signal.SIGSTOP)
        new = commands.start(*join)
        await is_run_by(seen, new)
        freeze(old, signal.SIGCONT)

        ended = await old.end(code=0)
        assert "which started later, has taken over its name" in ended.err
        assert f"process {new.process.pid}" in ended.err
        assert new.is_running

        await is_run_by(seen, new)
        refused = await commands.pointit(*join, code=2)
        assert f"process {new.process.pid} on " in refused.sentence


async def test_a_killed_process_is_followed_at_once(commands: Commands, endpoint: str) -> None:
    join = ("person", "add", "anna", "--no-view", "--connect", endpoint)
    async with site_seen(commands, endpoint) as seen:
        for _ in range(2):
            command = commands.start(*join)
            await is_run_by(seen, command)
            command.process.kill()
            await until(lambda: "anna" not in seen.people, what="her to be gone")
        last = commands.start(*join)
        await is_run_by(seen, last)
        assert "already" not in last.err


async def test_a_single_service_is_refused_beside_a_living_one(commands: Commands, endpoint: str) -> None:
    commands.start("run", "scenario_2", "--no-view", "--duration", "600", "--listen", endpoint)
    async with onlooker(endpoint) as seen:
        await seen.sees_cursors("user1")
        ended = await commands.pointit("service", "run", "pointing", "--user", "user1", "--connect", endpoint)
        assert ended.code == 2
        assert ended.sentence.startswith("pointing.user1: already on site lab")


async def test_two_of_what_all_share_are_told(commands: Commands, endpoint: str) -> None:
    async with site_seen(commands, endpoint, service="led-driver") as seen:
        second = commands.start("service", "run", "led-driver", "--connect", endpoint)
        await until(
            lambda: any("runs twice" in warning for h in seen.health.values() for warning in h.warnings),
            TAKEN_OVER_S,
            "the warning",
        )
        patience = Patience(TAKEN_OVER_S)
        codes = set[tuple[str, str]]()
        while ("twice", "led-driver") not in codes:
            assert not patience.is_over(), codes
            report = json.loads((await commands.pointit("doctor", "--json", "--connect", endpoint)).out)
            codes = {(finding["code"], finding["service"]) for finding in report["findings"]}
        assert second.is_running


async def is_served_by(seen: Onlooker, pui: str, selector: str) -> None:
    """Wait until her cursor moves, and only these instances get rays and cursors."""
    seen.health.clear()

    def heard(service: str, topic: Topic[Any]) -> set[str]:
        """Return those present that have heard her lately; a last report may come late."""
        return {
            health.instance
            for health in seen.health.values()
            for key in health.keys
            if health.service == service
            and health.instance in seen.present
            and (key.key, key.direction) == (topic.key, "in")
            and key.rate_hz > 0
        }

    await until(
        lambda: (
            {"pui", "selector"} <= seen.health.keys()
            and (heard("pui", RAY), heard("selector", CURSOR)) == ({pui}, {selector})
        ),
        TAKEN_OVER_S,
        lambda: (
            f"{pui} and {selector} alone to hear her, not {heard('pui', RAY)}, {heard('selector', CURSOR)}; "
            f"present are {sorted(seen.present)}, and {sorted(seen.health)} report"
        ),
    )
    await seen.sees_cursors("anna", patience_s=TAKEN_OVER_S)


async def selects(seen: Onlooker) -> None:
    """Wait until she hovers over something and selects it from now on."""
    hovered: set[str | None] = set()
    events: list[SelectionEvent] = []
    reading = (
        seen.bus.subscribe(HOVER, lambda hover, _user: hovered.add(hover.object_id), "anna"),
        seen.bus.subscribe(SELECTION_EVENTS, lambda event, _name: events.append(event)),
    )
    await until(
        lambda: any((each.event, each.user) == ("selected", "anna") for each in events), 60.0, "a selection"
    )
    assert hovered - {None, ""}
    for each in reading:
        each.close()


async def test_a_persons_process_computes_the_cursor_until_it_ends(commands: Commands, endpoint: str) -> None:
    join = ("person", "add", "anna", "--here", "--no-view", "--connect", endpoint)
    async with site_seen(commands, endpoint, "scenario_3") as seen:
        person = commands.start(*join)
        await is_served_by(seen, "pui.anna", "selector.anna")
        await selects(seen)
        await doctor_is_content(commands, endpoint)
        person.process.kill()
        await until(lambda: not {"pui.anna", "selector.anna"} & seen.present, TAKEN_OVER_S, "her end")
        assert (await seen.bus.call(SET_TOLERANCE, SetTolerance(), timeout_s=TAKEN_OVER_S)).tolerance_rad
        commands.start(*join)
        await is_served_by(seen, "pui.anna", "selector.anna")


@pytest.mark.long
async def test_site_serves_people_of_failed_shards(commands: Commands, endpoint: str) -> None:
    async with site_seen(commands, endpoint, "scenario_3") as seen:
        commands.start("person", "add", "anna", "--here", "--processes", "--no-view", "--connect", endpoint)
        await is_served_by(seen, "pui.anna", "selector.anna")
        stopped = seen.health["selector.anna"].pid
        os.kill(seen.health["pui.anna"].pid, signal.SIGKILL)
        os.kill(stopped, signal.SIGSTOP)  # as if its machine were gone
        await is_served_by(seen, "pui", "selector")
        await selects(seen)
        os.kill(stopped, signal.SIGCONT)
        await is_served_by(seen, "pui", "selector.anna")


async def test_run_that_is_killed_while_starting_leaves_no_orphan(commands: Commands, endpoint: str) -> None:
    run = commands.start(
        "run", "scenario_3", "--processes", "--no-view", "--duration", "600", "--listen", endpoint
    )
    await until(lambda: len(run.family()) >= 5, 30, "its children")
    children = run.family()[1:]
    run.process.kill()
    await until(lambda: not any(is_alive(child) for child in children), 10, "the children to end")


def is_alive(process: psutil.Process) -> bool:
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
