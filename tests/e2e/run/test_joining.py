"""Machines and people that join a site, with the same clock or another; sites beside each other."""

import json
import signal

import pytest

from pointit.schemas.topics import SERVICE_ALIVE
from tests.support.bench import until
from tests.support.commands import Commands, doctor_is_content, onlooker
from tests.support.pace import within


async def test_a_name_stands_for_one_person(commands: Commands, endpoint: str) -> None:
    commands.start("run", "scenario_2", "--no-view", "--duration", "600", "--listen", endpoint)
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
        assert absent.keys() == {"anna"}
        assert "pointit person add anna" in absent["anna"]  # built here, not as her deployment has it
        again = commands.start(*join)
        await seen.sees_cursors("anna")
        assert await missed(commands, endpoint) == {}
        assert (await again.stop()).code == 0
        assert await missed(commands, endpoint) == {}


PERSON = ("pointing", "localizer", "supervisor", "user-sim")


def services_of(user: str) -> set[str]:
    return {f"{service}.{user}" for service in PERSON}


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
