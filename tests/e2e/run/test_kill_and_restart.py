"""`pointit run --processes`: any one may die; doctor says so, a restart heals, nobody else notices."""

import json
import os
import shlex
import signal
import time
from typing import Any

import psutil
import pytest

from pointit.schemas import Health
from tests.support.bench import until
from tests.support.commands import Command, Commands, Ended, Onlooker, onlooker

SERVICES = (
    "pui",
    "selector",
    "led-driver",
    "conveyor-sim",
    "pointing.user1",
    "localizer.user1",
    "supervisor.user1",
    "user-sim.user1",
)
NOTICED_S = 5.0
REMEDY = "start it again: "


def reported(ended: Ended) -> dict[str, Any]:
    report: dict[str, Any] = json.loads(ended.out)
    return report


async def doctor_is_content(commands: Commands, endpoint: str) -> None:
    """Ask until all is well: what waited for the restarted one may still say so for a moment."""
    deadline_s = time.monotonic() + 20
    while True:
        ended = await commands.pointit("doctor", "--json", "--connect", endpoint)
        if ended.code == 0:
            assert reported(ended)["healthy"] is True
            return
        assert time.monotonic() < deadline_s, f"doctor still finds {reported(ended)['findings']}"


async def all_have_reported(seen: Onlooker) -> None:
    await until(lambda: set(SERVICES) <= set(seen.health), 30, f"health of all, not only {set(seen.health)}")


async def flows(seen: Onlooker, instance: str) -> None:
    """Wait for what would stand still without `instance`."""
    seen.cursors.clear()
    await seen.sees_more(seen.frames, f"frames after {instance} was restarted")
    await seen.sees_more(seen.objects, f"objects after {instance} was restarted")
    await seen.sees_cursors("user1")


def undisturbed(before: dict[str, Health], seen: Onlooker, killed: str) -> None:
    """All but the killed one are the processes that they were, and have not begun anew."""
    for instance, health in before.items():
        if instance != killed:
            assert seen.health[instance].pid == health.pid, instance
            assert seen.health[instance].uptime_s >= health.uptime_s, instance


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(240)
async def test_each_service_may_be_killed_and_started_again(commands: Commands, endpoint: str) -> None:
    endless = (
        "conveyor-sim.feeder.count=0"  # it is killed and goes on where it was, so it would come to its end
    )
    run = commands.start(
        *("run", "scenario_3", "--processes", "--duration", "600", "--no-view", "--set", endless),
        *("--listen", endpoint),
    )
    restarted: list[Command] = []
    async with onlooker(endpoint) as seen:
        await all_have_reported(seen)
        await seen.sees_cursors("user1")
        await doctor_is_content(commands, endpoint)
        for instance in SERVICES:
            before = dict(seen.health)
            os.kill(before[instance].pid, signal.SIGKILL)
            killed_s = time.monotonic()
            ended = await commands.pointit("doctor", "--json", "--connect", endpoint)
            noticed_s = time.monotonic() - killed_s
            print(f"{instance}: doctor noticed after {noticed_s:.2f} s")  # noqa: T201 - shown with -s
            assert noticed_s < NOTICED_S
            assert ended.code == 1
            (finding,) = (item for item in reported(ended)["findings"] if item["service"] == instance)
            assert (finding["severity"], finding["code"]) == ("error", "absent")
            assert finding["remedy"].startswith(REMEDY)
            await run.says(f"{instance} was ended by SIGKILL; start it again with: ")
            assert any(finding["remedy"].removeprefix(REMEDY) in line for line in run.logged())
            del seen.health[instance]
            restarted.append(commands.run(shlex.split(finding["remedy"].removeprefix(REMEDY))))
            await seen.hears(instance)
            assert seen.health[instance].pid == restarted[-1].process.pid
            await flows(seen, instance)
            await doctor_is_content(commands, endpoint)
            undisturbed(before, seen, instance)
        ended = await run.stop()
    assert ended.code == 0, ended.err
    assert ended.took_s < 2
    assert "Traceback" not in ended.err
    assert "scenario_3 ran" in ended.out
    for command in restarted:  # an operator's, not the run's: they wait for the next run
        assert command.is_running
        left = await command.stop(signal.SIGTERM)
        assert left.code == 0
        assert left.took_s < 2
        assert "Traceback" not in left.err


async def test_a_stopped_service_is_noticed(commands: Commands, endpoint: str) -> None:
    commands.start("run", "scenario_3", "--processes", "--no-view", "--listen", endpoint)
    async with onlooker(endpoint) as seen:
        await all_have_reported(seen)
        pid = seen.health["pui"].pid
        os.kill(pid, signal.SIGSTOP)
        try:
            began_s = time.monotonic()
            ended = await commands.pointit("doctor", "--json", "--connect", endpoint)
            assert time.monotonic() - began_s < NOTICED_S
        finally:
            os.kill(pid, signal.SIGCONT)
        assert ended.code == 1
        (finding,) = (item for item in reported(ended)["findings"] if item["service"] == "pui")
        assert finding["code"] in {"silent", "absent"}
        await doctor_is_content(commands, endpoint)


@pytest.mark.parametrize("when", ["while it runs", "while it starts"])
async def test_a_killed_run_leaves_no_orphan(commands: Commands, endpoint: str, when: str) -> None:
    run = commands.start("run", "scenario_3", "--processes", "--no-view", "--listen", endpoint)
    count = 1 + len(SERVICES)
    if when == "while it runs":
        async with onlooker(endpoint) as seen:
            await all_have_reported(seen)
    else:
        count = 5
    await until(lambda: len(run.family()) >= count, 30, "its children")
    children = run.family()[1:]
    run.process.kill()
    await until(lambda: not any(is_alive(child) for child in children), 10, "the children to end")


def is_alive(process: psutil.Process) -> bool:
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


async def test_a_child_that_cannot_begin_is_named_with_its_reason(commands: Commands, endpoint: str) -> None:
    run = commands.start(
        "run",
        "scenario_3",
        "--processes",
        "--no-view",
        "--set",
        "led-driver.outputs=[{kind: expander, port: /nowhere}, {kind: expander, port: /nowhere}]",
        "--listen",
        endpoint,
    )
    await run.says("start it again with")
    (sentence,) = (line for line in run.logged() if "start it again with" in line)
    assert sentence.startswith("led-driver ended with exit code 2: outputs.0.port: /nowhere is used by two")
    async with onlooker(endpoint) as seen:
        await until(lambda: set(SERVICES) - {"led-driver"} <= set(seen.health), 30, "the others to go on")
        ended = await commands.pointit("doctor", "--json", "--connect", endpoint)
    assert ended.code == 1
    assert ("absent", "led-driver") in {
        (item["code"], item["service"]) for item in reported(ended)["findings"]
    }
    ended = await run.stop()
    assert ended.code == 0
    assert "Traceback" not in ended.err
