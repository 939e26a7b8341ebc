"""Programs of `pointit run --on`: started by pointing, and ended with the run, whatever they have started."""

import json
from pathlib import Path

import psutil

from pointit.schemas import Environment, SelectionEvent
from pointit.schemas.environment import Thing
from pointit.schemas.topics import MAP, SELECTION_EVENTS
from tests.support.bench import repeated, until
from tests.support.commands import Commands, onlooker

SITE = """
about: the map and the selections are another process's
places: [{position_m: [1.0, 1.0, 0.0], yaw_deg: 0.0}]
site: {keeper: {}}
"""

FORKS = """#!/bin/sh
trap '' TERM
sh -c "trap '' TERM; while :; do sleep 100; done" &
echo "$1 $! $$" > "$2.part" && mv "$2.part" "$2"
while :; do sleep 100; done
"""
"""Never ends, nor does what it has started, and SIGTERM does not end them."""

PERIOD_S = 0.2
THINGS = tuple(
    Thing(id=name, center_m=(1.0, 1.0, 1.0), size_m=(0.2, 0.2, 0.2)) for name in ("screws", "nuts")
)


def is_running(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


async def test_program_that_forks_and_never_ends_is_ended_with_the_run(
    commands: Commands, endpoint: str, tmp_path: Path
) -> None:
    scenario, script, told, summary = (tmp_path / name for name in ("own.yaml", "fork.sh", "told", "s.json"))
    scenario.write_text(SITE)
    script.write_text(FORKS)
    script.chmod(0o755)
    run = commands.start_program(
        *("run", str(scenario), "--users", "0", "--no-view", "--listen", endpoint, "--summary", str(summary)),
        *("--on", f"screws={script} {{user}} {told}", "--on", "nuts=sh -c 'exit 3'"),
    )
    async with onlooker(endpoint) as seen:
        await seen.hears("keeper")
        seen.bus.publisher(MAP).put(Environment(stamp_ns=1, name="shop", things=THINGS))
        events = seen.bus.publisher(SELECTION_EVENTS)

        def point(name: str) -> None:
            events.put(SelectionEvent(stamp_ns=1, event="selected", object_id=name, user="anna"))

        failed = "nuts: sh -c 'exit 3' ended with exit code 3"
        async with repeated(PERIOD_S, lambda: point("nuts")):
            await run.says(failed)
        point("screws")
        await until(told.exists, what="the program")
    user, *family = told.read_text().split()
    assert user == "anna"
    assert all(is_running(int(pid)) for pid in family)
    await run.stop()
    await until(lambda: not any(is_running(int(pid)) for pid in family), what="the end of the program")
    programs = json.loads(summary.read_text())["reactions"]
    assert failed in programs["failures"]
    assert programs["failed"] == programs["started"] - 1


async def test_listen_names_a_thing_that_the_map_lacks_before_a_program_that_is_missing(
    commands: Commands, endpoint: str, tmp_path: Path
) -> None:
    scenario = tmp_path / "own.yaml"
    scenario.write_text(SITE)
    commands.start_program("run", str(scenario), "--users", "0", "--no-view", "--listen", endpoint)
    async with onlooker(endpoint) as seen:
        await seen.hears("keeper")
        seen.bus.publisher(MAP).put(Environment(stamp_ns=1, name="shop", things=THINGS))
        for thing, mistake in (("nutz", "the map has no thing 'nutz'"), ("nuts", "no program ./heat.sh")):
            verb = f"heat {thing}=./heat.sh {{user}}"
            listen = commands.start("listen", "anna", "--text", "-", "--verb", verb, "--connect", endpoint)
            ended = await listen.end(code=2)
            assert mistake in ended.err
