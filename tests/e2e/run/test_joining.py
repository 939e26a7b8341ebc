"""Machines and people that join a site, with the same clock or another; sites beside each other."""

import asyncio
import json
import signal
import sys
from collections.abc import Callable
from typing import Any

import pytest

from pointit.runtime.bus.site_clock import SiteClock
from pointit.schemas import SelectionEvent
from pointit.schemas.topics import SELECTION_EVENTS, SERVICE_ALIVE
from tests.support.bench import until
from tests.support.buses import router_process
from tests.support.commands import Commands, doctor_is_content, onlooker, summary_of
from tests.support.pace import within

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
        assert within(behind_s, 5.0 * SPEED)  # wall time would be behind by four seconds for each that passed
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


PERSON = ("pointing", "localizer", "supervisor", "user-sim")


def services_of(user: str) -> set[str]:
    return {f"{service}.{user}" for service in PERSON}


def noting(sites: set[str], site: str) -> Callable[[SelectionEvent, str], None]:
    """Return a handler that adds `site` when something was selected."""

    def on_event(event: SelectionEvent, _name: str) -> None:
        if event.event == "selected":
            sites.add(site)

    return on_event


@pytest.mark.slow
async def test_two_systems_on_one_router_do_not_see_each_other(commands: Commands) -> None:
    async with router_process() as router:
        common = ("--connect", router.endpoint, "--speed", "4", "--duration", "600", "--no-view", "--json")
        runs = {
            "a": commands.start("run", "scenario_3", "--site", "a", "--users", "2", *common),
            "b": commands.start("run", "scenario_3", "--site", "b", "--seed", "7", *common),
        }
        async with onlooker(router.endpoint, "a") as a, onlooker(router.endpoint, "b") as b:
            selected: set[str] = set()
            for site, seen in (("a", a), ("b", b)):
                seen.bus.subscribe(SELECTION_EVENTS, noting(selected, site))
            await a.sees_cursors("user1", "user2")
            await b.sees_cursors("user1")
            await until(lambda: a.people == {"user1", "user2"}, what="the people of a")
            await until(lambda: b.people == {"user1"}, what="the people of b")
            await until(lambda: services_of("user2") <= a.present, what="all services of a")
            await until(
                lambda: b.present == a.present - services_of("user2"),
                what=f"the same services on b: {b.present} and {a.present}",
            )
            await until(lambda: bool(a.health) and bool(b.health), what="health on both sites")
            assert {health.pid for health in a.health.values()} == {runs["a"].process.pid}
            assert {health.pid for health in b.health.values()} == {runs["b"].process.pid}
            echo = await commands.pointit(
                *("topic", "echo", "objects/*", "--count", "5", "--json"),
                *("--site", "b", "--connect", router.endpoint),
                code=0,
            )
            await until(lambda: bool(a.object_ids()), what="objects of a")
            of_b = {thing["id"] for line in echo.out.splitlines() for thing in json.loads(line)["objects"]}
            assert of_b
            assert of_b <= b.object_ids()
            assert not a.object_ids() & b.object_ids()
            await until(lambda: selected == {"a", "b"}, 60, "selections on both sites")
            assert "user2" not in b.cursors
        for site, users in (("a", 2), ("b", 1)):
            ended = await runs[site].stop(code=0)
            summary = summary_of(ended)
            assert summary["site"] == site
            assert summary["selected"] > 0
            assert (summary["wrong"], len(summary["services"])) == (0, 5 + 4 * users)


@pytest.mark.slow
async def test_a_site_and_people_who_come_and_go(commands: Commands, endpoint: str) -> None:
    site = commands.start("run", "scenario_3", "--site-only", "--no-view", "--listen", endpoint)
    join = ("--connect", endpoint)
    async with onlooker(endpoint) as seen:
        await until(
            lambda: {"pui", "selector", "led-driver", "conveyor-sim", "keeper"} == seen.present,
            30,
            "the site",
        )
        assert not seen.people
        anna = commands.start("person", "add", "anna", *join)
        ben = commands.start("person", "add", "ben", "--place", "2", "--seed", "5", *join)
        await seen.sees_cursors("anna", "ben")
        await until(lambda: services_of("anna") | services_of("ben") <= seen.present, what="all of both")
        for user, person in (("anna", anna), ("ben", ben)):
            await seen.hears(f"pointing.{user}")
            assert seen.health[f"pointing.{user}"].pid == person.process.pid
        keys = await commands.pointit("topic", "echo", "users/*/imu", "--count", "30", "--json", *join)
        assert {json.loads(line)["key"] for line in keys.out.splitlines()} == {
            "users/anna/imu",
            "users/ben/imu",
        }
        states = len(seen.interactions["anna"])
        uptime_s = seen.health["pointing.anna"].uptime_s

        left = await ben.stop(code=0)
        assert within(left.took_s, 4.0)
        assert "Traceback" not in left.err
        await until(lambda: "ben" not in seen.people, what="ben to be gone")
        await until(lambda: not services_of("ben") & seen.present, what="his services to be gone")
        await doctor_is_content(commands, endpoint)  # ben left regularly
        seen.cursors["ben"].clear()
        await seen.sees_cursors("anna")
        assert not seen.cursors["ben"]

        again = commands.start("person", "add", "ben", "--place", "2", *join)
        await seen.sees_cursors("ben")
        pid = again.process.pid
        await until(lambda: seen.health["pointing.ben"].pid == pid, what="health of ben's new process")
        await seen.sees_cursors("anna")
        assert seen.health["pointing.anna"].pid == anna.process.pid
        assert seen.health["pointing.anna"].uptime_s > uptime_s
        assert [state.state for state in seen.interactions["anna"][states:]] == []  # she went on as if alone

        last = await site.stop(signal.SIGTERM, code=0)
        assert last.out == ""  # no summary without an end
    for person in (anna, again):
        await person.says("is lost")
        assert (await person.stop(signal.SIGTERM)).code == 0


async def test_people_may_come_before_the_site(commands: Commands, endpoint: str) -> None:
    anna = commands.start("person", "add", "anna", "--connect", endpoint)
    await anna.says(f"nobody answers at {endpoint} yet; trying again until somebody does")
    commands.start("run", "scenario_3", "--site-only", "--no-view", "--listen", endpoint)
    async with onlooker(endpoint) as seen:
        await seen.sees_cursors("anna")
