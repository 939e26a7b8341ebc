"""A person's cursor and hovers computed in their own process, and by the site when that fails."""

import os
import signal
from typing import Any

from pointit.schemas import SelectionEvent, SetTolerance
from pointit.schemas.topics import CURSOR, HOVER, RAY, SELECTION_EVENTS, SET_TOLERANCE, Topic
from tests.support.bench import until
from tests.support.commands import Commands, Onlooker, doctor_is_content, onlooker

TAKEN_OVER_S = 20.0
"""The lease is 3 s; the rest is a busy machine."""


async def is_served_by(seen: Onlooker, pui: str, selector: str) -> None:
    """Wait until her cursor moves, and only these instances get rays and cursors."""
    seen.health.clear()

    def heard(service: str, topic: Topic[Any]) -> set[str]:
        """Return the instances that have heard her lately."""
        return {
            health.instance
            for health in seen.health.values()
            for key in health.keys
            if health.service == service and (key.key, key.direction) == (topic.key, "in") and key.rate_hz > 0
        }

    await until(
        lambda: (
            {"pui", "selector"} <= seen.health.keys()
            and (heard("pui", RAY), heard("selector", CURSOR)) == ({pui}, {selector})
        ),
        TAKEN_OVER_S,
        f"{pui} and {selector} alone to hear her",
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


async def test_a_persons_process_computes_their_cursor_and_the_site_goes_on_without_it(
    commands: Commands, endpoint: str
) -> None:
    commands.start("run", "scenario_3", "--site-only", "--no-view", "--listen", endpoint)
    join = ("person", "add", "anna", "--here", "--no-view", "--connect", endpoint)
    async with onlooker(endpoint) as seen:
        await seen.hears("pui")
        person = commands.start(*join)
        await is_served_by(seen, "pui.anna", "selector.anna")
        await selects(seen)
        await doctor_is_content(commands, endpoint)
        person.process.kill()
        await until(lambda: not {"pui.anna", "selector.anna"} & seen.present, TAKEN_OVER_S, "her end")
        assert (await seen.bus.call(SET_TOLERANCE, SetTolerance())).tolerance_rad
        commands.start(*join)
        await is_served_by(seen, "pui.anna", "selector.anna")


async def test_when_only_the_shards_fail_the_site_serves_the_person(
    commands: Commands, endpoint: str
) -> None:
    commands.start("run", "scenario_3", "--site-only", "--no-view", "--listen", endpoint)
    async with onlooker(endpoint) as seen:
        await seen.hears("pui")
        commands.start("person", "add", "anna", "--here", "--processes", "--no-view", "--connect", endpoint)
        await is_served_by(seen, "pui.anna", "selector.anna")
        stopped = seen.health["selector.anna"].pid
        os.kill(seen.health["pui.anna"].pid, signal.SIGKILL)
        os.kill(stopped, signal.SIGSTOP)  # as if its machine were gone
        await is_served_by(seen, "pui", "selector")
        await selects(seen)
        os.kill(stopped, signal.SIGCONT)
        await is_served_by(seen, "pui", "selector.anna")
