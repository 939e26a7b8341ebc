"""Runs of scenarios, and people who join them."""

import json
import signal
import time
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from pointit.recording.reader import Recording
from pointit.schemas import ImuSample, Localization, SelectionEvent, UserPose
from pointit.schemas.topics import LOCALIZATION, POSE, SELECTION_EVENTS, SERVICE_ALIVE
from tests.support.bench import until
from tests.support.buses import free_port
from tests.support.commands import Commands, doctor_is_content, onlooker, summary_of
from tests.support.pace import within

SITE = {"pui", "selector", "led-driver", "conveyor-sim", "keeper"}
PERSON = ("pointing", "localizer", "supervisor", "user-sim")


def listen() -> tuple[str, str]:
    return "--listen", f"tcp/127.0.0.1:{free_port()}"


def person(*users: str) -> set[str]:
    return {f"{service}.{user}" for service in PERSON for user in users}


def red_ids(events: list[SelectionEvent]) -> set[str]:
    return {event.object_id for event in events if (event.event, event.kind) == ("selected", "red")}


def assert_flawless(summary: dict[str, Any]) -> None:
    assert summary["selected"] > 0, summary
    assert (summary["missed"], summary["pending"], summary["wrong"]) == (0, 0, 0), summary


@pytest.mark.slow
async def test_the_simulated_person_selects_all_that_is_red_only(commands: Commands, tmp_path: Path) -> None:
    """Other seeds, and without processes: tests/integration/scenario, in virtual time."""
    path = tmp_path / "summary.json"
    run = commands.start_program(
        *("run", "scenario_3", "--duration", "60", "--speed", "2", "--seed", "1", "--no-view"),
        *("--set", "user-sim.mind.lapse_share=0"),  # a wrong intention selects a wrong one
        *("--set", "conveyor-sim.feeder.count=22"),  # all have passed before the end
        *("--summary", str(path)),
        *listen(),
    )
    ended = await run.end(120, code=0)

    assert "Traceback" not in ended.err
    summary = json.loads(path.read_text())
    assert_flawless(summary)
    assert (summary["seed"], set(summary["services"])) == (1, SITE | person("user1"))
    assert 60.0 <= summary["duration_s"] + 0.1 < 64.0
    assert 0 < summary["latency_ms"]["p50"] <= summary["latency_ms"]["p99"]
    assert within(summary["latency_ms"]["p50"], 50.0)
    assert summary["cursors"] > 300  # of 3000 samples; the arm rests when there is nothing to select
    assert summary["frames"] > 500
    assert summary["first_frame_unix_s"] < summary["first_cursor_unix_s"]
    assert f"Selected {summary['selected']} of {summary['selected']} red objects" in ended.out


async def test_the_person_meets_the_lamps(commands: Commands) -> None:
    arguments = ("run", "scenario_1", "--speed", "4", "--duration", "48", "--no-view", "--json")
    ended = await commands.pointit(*arguments, *listen(), code=0)
    met = summary_of(ended)["lamps_missed_by_deg"]
    assert len(met) == 4
    assert max(met.values()) < 12.0  # they point without a cursor


async def test_a_short_run_ends_by_itself_and_is_recorded_whole(commands: Commands, tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    options = ("--duration", "8", "--no-view", "--json", "--record", str(path))
    ended = await commands.pointit("run", "scenario_2", *options, *listen(), code=0)
    summary = summary_of(ended)
    assert 8.0 <= summary["duration_s"] + 0.1 < 12.0
    assert ended.took_s > 8
    assert within(ended.took_s, 16.0)
    assert summary["latency_ms"]["p50"] is not None
    assert f"recorded in {path}" in ended.err

    with Recording.open(path) as recording:
        assert (recording.problem, recording.head.seed) == ("", 0)
        entries = list(recording.entries())
    samples = [each.body.seq for each in entries if isinstance(each.body, ImuSample)]
    assert samples == list(range(1, len(samples) + 1))

    alive = {each.name: each.body for each in entries if each.row is SERVICE_ALIVE}
    assert {name for name, present in alive.items() if not present} >= person("user1") | {"pui"}


@pytest.mark.slow
async def test_processes_select_as_well_and_follow_the_simulated_clock(commands: Commands) -> None:
    """At speed 2 a segment comes every 1.5 s of the wall: without the site's clock nothing would fit."""
    option, endpoint = listen()
    run = commands.start(
        *("run", "scenario_3", "--processes", "--no-view", "--json"),
        *("--duration", "600", "--speed", "2", option, endpoint),
    )
    async with onlooker(endpoint) as seen:
        events: list[SelectionEvent] = []
        seen.bus.subscribe(SELECTION_EVENTS, lambda event, _name: events.append(event))
        await seen.sees_more(seen.objects, "objects")
        first_ns = seen.objects[-1].stamp_ns
        began_s = time.monotonic()
        await until(lambda: seen.objects[-1].stamp_ns - first_ns > 12e9, 40, "12 s of the site's time")

        passed_s = time.monotonic() - began_s
        assert 1.4 < (seen.objects[-1].stamp_ns - first_ns) / 1e9 / passed_s < 3.0
        # The run may not know of the last selection yet, and a wrong one may not be corrected yet.
        await until(lambda: len(red_ids(events)) > 1, 90, "two red objects are selected")

    ended = await run.stop(code=0)
    assert "Traceback" not in ended.err
    summary = summary_of(ended)
    assert summary["speed"] == 2
    assert summary["selected"] > summary["wrong"]
    assert summary["latency_ms"]["p50"] > 0
    assert within(summary["latency_ms"]["p50"], 60.0)  # ms of the wall


async def test_a_device_not_there_is_why_no_cursor_appeared(commands: Commands, tmp_path: Path) -> None:
    port = tmp_path / "ttyUSB0"
    ended = await commands.pointit(
        "run", "scenario_1", "--duration", "3", "--imu", f"serial:{port}", "--no-view", *listen(), code=1
    )
    (verdict,) = (line for line in ended.err.splitlines() if "no cursor ever appeared; " in line)
    assert f"imu-bridge.user1: {port} is not there: plug the device in; ports found: " in verdict


async def test_a_person_of_unknown_place_is_found_by_three_lamps(commands: Commands) -> None:
    """With a bias and a drift, on real Zenoh: progress, pose with its sigma, cursors, and the result."""
    option, endpoint = listen()
    person_errs = ("user-sim.aim.elevation_bias_deg=10", "user-sim.wristband.yaw_drift_degpmin=15")
    settings = [part for setting in person_errs for part in ("--set", setting)]
    run = commands.start(
        *("run", "scenario_2", "--localize", "--targets", "3", "--seed", "2", "--speed", "4"),
        *("--no-view", "--json", *settings, option, endpoint),
    )
    async with onlooker(endpoint) as seen:
        progress: list[Localization] = []
        poses: list[UserPose] = []
        seen.bus.subscribe(LOCALIZATION, lambda news, _user: progress.append(news))
        seen.bus.subscribe(POSE, lambda pose, _user: poses.append(pose))
        await until(lambda: "static_targets" in {pose.method for pose in poses}, 40, "a pose")
        await seen.sees_cursors("user1")
    ended = await run.stop(code=0)

    assert {news.target_index for news in progress if news.phase == "sampling"} >= {2}
    assert max(news.target_count for news in progress) == 3
    found = next(pose for pose in poses if pose.method == "static_targets")
    assert found.elevation_bias_rad > 0.05
    assert 0.0 < found.covariance[0] < 0.5**2

    told = summary_of(ended)["people"]["user1"]
    assert told["method"] == "static_targets"
    assert told["position_error_m"] < 1.0
    assert 0.0 < told["position_sigma_m"] < 0.5


TARGET = "red"
BAY_SELECTED = "1"
BAY_REST = "3"


async def test_red_packages_leave_at_bay_1_others_at_bay_3(commands: Commands, own_state: Path) -> None:
    ended = await commands.pointit(
        *("run", "scenario_4", "--speed", "3", "--duration", "75", "--no-view", "--json"), *listen(), code=0
    )
    assert "Traceback" not in ended.err
    summary = summary_of(ended)
    bays = {bay: Counter[str](kinds) for bay, kinds in summary["dispatched"].items()}
    assert set(bays) <= {BAY_SELECTED, BAY_REST}
    assert bays[BAY_SELECTED][TARGET] >= 1, summary
    assert bays[BAY_REST]["blue"] >= 1, summary
    assert bays[BAY_SELECTED]["blue"] == 0, summary
    kept = {path.parent.name for path in (own_state / "lab").glob("*/*.sqlite")}
    assert kept == {"selector", "conveyor-sim"}, "services keep what they must not lose, in this folder"


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


async def test_late_observer_misses_a_killed_person_until_she_returns(
    commands: Commands, endpoint: str
) -> None:
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
