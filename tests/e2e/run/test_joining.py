"""Machines that join a site, with the same clock or another."""

import asyncio
import json
import sys
from typing import Any

import pytest

from pointit.runtime.bus.site_clock import SiteClock
from pointit.schemas.topics import SERVICE_ALIVE
from tests.support.bench import until
from tests.support.commands import Commands, onlooker

SPEED = 5.0


async def test_who_joins_takes_over_the_time_of_the_site(commands: Commands, endpoint: str) -> None:
    commands.start(
        "run", "scenario_3", "--site-only", "--speed", str(SPEED), "--no-view", "--listen", endpoint
    )
    async with onlooker(endpoint) as seen:
        await seen.hears("conveyor-sim")
        commands.start("person", "add", "anna", "--no-view", "--connect", endpoint)
        await seen.sees_cursors("anna")
        clock = SiteClock(seen.bus)
        assert await clock.wait_for_tick(60.0)
        await until(lambda: len(seen.cursors["anna"]) > 50, 20, "more cursors")
        behind_s = abs(clock.now_ns() - seen.cursors["anna"][-1].stamp_ns) / 1e9
        assert behind_s < 5.0 * SPEED  # wall time would be behind by four seconds for each that passed
        clock.close()


async def test_a_name_stands_for_one_person(commands: Commands, endpoint: str) -> None:
    commands.start("run", "scenario_2", "--no-view", "--listen", endpoint)
    async with onlooker(endpoint) as seen:
        await seen.sees_cursors("user1")
        ended = await commands.pointit("person", "add", "user1", "--connect", endpoint, code=2)
        assert ended.sentence.startswith("user1: already on site lab; choose another name")
        seen.bus.announce(SERVICE_ALIVE, "pui.hall")
        ended = await commands.pointit("person", "add", "hall", "--connect", endpoint, code=2)
        assert ended.sentence.startswith("hall: pui.hall on site lab is a shard that serves nobody")
        await seen.sees_cursors("user1")


async def missed(commands: Commands, endpoint: str) -> dict[str, str]:
    """Return the missing services, each with its remedy, as reported by a doctor that has just joined."""
    report = json.loads((await commands.pointit("doctor", "--json", "--connect", endpoint)).out)
    absent = [finding for finding in report["findings"] if finding["code"] == "absent"]
    return {finding["service"]: finding["remedy"] for finding in absent}


async def test_who_vanished_is_missed_by_who_looks_later(commands: Commands, endpoint: str) -> None:
    commands.start("run", "scenario_2", "--site-only", "--no-view", "--listen", endpoint)
    join = ("person", "add", "anna", "--no-view", "--connect", endpoint)
    async with onlooker(endpoint) as seen:
        await seen.hears("pui")
        anna = commands.start(*join)
        await seen.sees_cursors("anna")
        anna.kill()
        await until(lambda: "anna" not in seen.people, what="her to be gone")
        absent = await missed(commands, endpoint)
        assert absent.keys() >= {"pointing.anna", "supervisor.anna"}
        for instance, remedy in absent.items():  # built here, not as her deployment has it
            assert f"pointit service run {instance.removesuffix('.anna')} --user anna" in remedy
        again = commands.start(*join)
        await seen.sees_cursors("anna")
        assert await missed(commands, endpoint) == {}
        assert (await again.stop()).code == 0
        assert await missed(commands, endpoint) == {}


async def test_without_a_terminal_the_log_tells_what_happens(commands: Commands, endpoint: str) -> None:
    run = commands.start("run", "scenario_3", "--speed", "4", "--no-view", "--listen", endpoint)
    for news in ("user1: pointing.", "red 1 selected by user1", "wrist to light p50"):
        await run.says(news)


SKEWED = """\
import socket, sys, time
real = time.time_ns
time.time_ns = lambda: real() + int({ahead_s} * 1e9)
socket.gethostname = lambda: "watch"
sys.argv = ["pointit", "service", "run", "pointing", "--user", "anna", "--connect", "{endpoint}"]
from pointit.cli.main import main
main()
"""


async def found(commands: Commands, endpoint: str) -> list[dict[str, Any]]:
    """Return doctor's findings on clocks, its own or the keeper's warning."""
    report = json.loads((await commands.pointit("doctor", "--json", "--connect", endpoint)).out)
    return [finding for finding in report["findings"] if "the clock of machine" in finding["sentence"]]


@pytest.mark.long
@pytest.mark.parametrize(
    ("keeper", "ahead_s"), [(True, 1.5), (True, -0.2), (True, 0.0), (False, 1.5), (False, -1.5)]
)
async def test_doctor_names_the_machine(
    commands: Commands,
    endpoint: str,
    keeper: bool,  # noqa: FBT001
    ahead_s: float,
) -> None:
    if keeper:
        commands.start("run", "scenario_2", "--site-only", "--no-view", "--listen", endpoint)
    else:
        commands.start("router", "--listen", endpoint)
    async with onlooker(endpoint) as seen:
        if keeper:
            await seen.hears("keeper")
        commands.run([sys.executable, "-c", SKEWED.format(ahead_s=ahead_s, endpoint=endpoint)])
        await seen.hears("pointing.anna")
        await asyncio.sleep(3.0 if ahead_s else 10.0)  # time enough for a false report on a right clock
        if keeper and ahead_s:
            await until(
                lambda: any("clock of machine watch" in w for w in seen.health["keeper"].warnings), 20
            )
        findings = await found(commands, endpoint)
        assert len(findings) == (1 if ahead_s else 0)
        for finding in findings:
            way = "ahead of" if ahead_s > 0 else "behind"
            assert f"machine watch is {abs(ahead_s):.1f} s {way}" in finding["sentence"] or abs(ahead_s) < 1
            assert "NTP" in finding["sentence"] + finding["remedy"]
