"""`pointit run --processes`: one that stops is noticed, none is left behind; killed ones: tests/faults."""

import json
import os
import signal
from typing import Any

import psutil
import pytest

from tests.support.bench import until
from tests.support.commands import Commands, Ended, Onlooker, doctor_is_content, onlooker, start_delay_s
from tests.support.pace import within

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


def reported(ended: Ended) -> dict[str, Any]:
    report: dict[str, Any] = json.loads(ended.out)
    return report


async def all_have_reported(seen: Onlooker) -> None:
    await until(lambda: set(SERVICES) <= set(seen.health), 30, f"health of all, not only {set(seen.health)}")


async def test_a_stopped_service_is_noticed(commands: Commands, endpoint: str) -> None:
    commands.start("run", "scenario_3", "--processes", "--no-view", "--listen", endpoint)
    async with onlooker(endpoint) as seen:
        await all_have_reported(seen)
        pid = seen.health["pui"].pid
        delay_s = await start_delay_s(commands.pointit)
        os.kill(pid, signal.SIGSTOP)
        try:
            ended = await commands.pointit("doctor", "--json", "--connect", endpoint)
            assert within(ended.took_s, NOTICED_S + delay_s)
        finally:
            os.kill(pid, signal.SIGCONT)
        assert ended.code == 1
        (finding,) = (item for item in reported(ended)["findings"] if item["service"] == "pui")
        assert finding["code"] in {"silent", "absent"}
        await doctor_is_content(commands, endpoint)


@pytest.mark.parametrize("when", [pytest.param("while it runs", marks=pytest.mark.long), "while it starts"])
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
    assert sentence.startswith("led-driver ended with exit code 2: outputs.1.port: /nowhere is used by two")
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
