"""Programs and webhooks of `pointit run --on`: their results are told, and programs end with the run."""

import asyncio
import json
from pathlib import Path

import psutil

from pointit.schemas import Environment
from pointit.schemas.environment import Thing
from pointit.schemas.topics import CARRIER_ALIVE, MAP, OUTCOMES, SELECTION
from tests.support.bench import until
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

THINGS = tuple(
    Thing(id=name, center_m=(1.0, 1.0, 1.0), size_m=(0.2, 0.2, 0.2)) for name in ("screws", "nuts")
)


def is_running(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


class Door:
    """A web server that answers with its status."""

    status = b"403 No"

    async def answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        writer.write(b"HTTP/1.1 " + self.status + b"\r\nContent-Length: 0\r\n\r\n")
        writer.close()


async def test_outcomes_of_programs_and_webhooks_are_published_and_summarized(
    commands: Commands, endpoint: str, tmp_path: Path
) -> None:
    script, told, summary = (tmp_path / name for name in ("fork.sh", "told", "s.json"))
    script.write_text(FORKS)
    script.chmod(0o755)
    door = Door()
    async with await asyncio.start_server(door.answer, "127.0.0.1", 0) as server:
        url = f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}/secret"
        run = commands.start_program(
            *("run", "shelf", "--users", "0", "--no-view", "--duration", "600"),
            *("--listen", endpoint, "--summary", str(summary)),
            *("--on", f"screws={script} {{user}} {told}", "--on", "nuts=sh -c 'exit 3'"),
            *("--on", f"radio={url}"),
        )
        async with onlooker(endpoint) as seen:
            await seen.hears("reactions")
            present: set[str] = set()
            seen.bus.watch(CARRIER_ALIVE, lambda name, **_: present.add(name))
            selected: list[str] = []
            seen.bus.subscribe(
                SELECTION,
                lambda now, _name: selected.__setitem__(slice(None), [one.id for one in now.objects]),
            )

            outcomes: list[tuple[str, str, str]] = []
            seen.bus.subscribe(
                OUTCOMES, lambda told, _name: outcomes.append((told.object_id, told.result, told.text))
            )
            await until(lambda: "reactions" in present, what="the carrier")

            async def try_thing(name: str) -> tuple[str, str, str]:
                """Return the first outcome, which the command may not wait for."""
                outcomes.clear()
                command = commands.start("things", "try", name, "--user", "anna", "--connect", endpoint)
                await until(lambda: bool(outcomes), what=f"the outcome of {name}")
                await command.end(code=None)
                return outcomes[0]

            failed = "sh -c 'exit 3' ended with exit code 3"
            assert await try_thing("nuts") == ("nuts", "failed", failed)
            shown = url.replace("secret", "...")
            assert await try_thing("radio") == ("radio", "failed", f"{shown} answered 403 No")
            await until(lambda: "radio" not in selected, what="the switch to go back")

            door.status = b"204 Yes"
            assert await try_thing("radio") == ("radio", "done", "")
            await until(lambda: "radio" in selected, what="the switch")
            assert await try_thing("screws") == ("screws", "started", "")
            await until(told.exists, what="the program")

            user, *family = told.read_text().split()
            assert user == "anna"
            assert all(is_running(int(pid)) for pid in family)

            await run.says("screws selected by anna")
            await run.stop()
            await until(
                lambda: not any(is_running(int(pid)) for pid in family), what="the end of the program"
            )
    acts = json.loads(summary.read_text())["acts"]

    assert acts["done"] == 1
    assert acts["failures"][:2] == [
        "nuts: sh -c 'exit 3' ended with exit code 3",
        f"radio: {shown} answered 403 No",
    ]


async def test_listen_names_a_missing_thing_before_a_missing_program(
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
