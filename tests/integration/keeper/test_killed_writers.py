"""Killed writers, real processes: who comes late finds what they have said all the same."""

import asyncio
import functools
import os
import signal
import subprocess
from collections.abc import AsyncGenerator, AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio

from pointit.launch.plan.launches import Choices, site_launches, user_launches
from pointit.launch.plan.plan import read_scenario
from pointit.launch.run.processes import Processes
from pointit.runtime.link.link import Link
from pointit.runtime.service.service import Launch
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Message
from pointit.schemas.table_types import PresenceHandler
from pointit.schemas.topics import (
    INTERACTION,
    KEEPER_ALIVE,
    MAP,
    POSE,
    PROFILE,
    SELECTION,
    SERVICE_ALIVE,
    USER_ALIVE,
    Topic,
)
from pointit.services.keeper.retained_states import FILE, read
from tests.support.bench import until
from tests.support.buses import free_port

WRITERS = {"pui": MAP, "localizer.anna": POSE, "selector": SELECTION, "supervisor.anna": PROFILE}
ALL: tuple[Topic[Any], ...] = (MAP, POSE, SELECTION, PROFILE, INTERACTION)
ABSENT_S = 3.0
"""Time without a message after which nobody has it, s: what is there comes in a tenth of that."""
START_S = 40.0
"""Processes on a busy machine."""


class Site:
    """Processes of a site that can be killed, and those who come to look."""

    def __init__(
        self, endpoint: str, bus: ZenohBus, processes: Processes, launches: Sequence[Launch]
    ) -> None:
        self.endpoint = endpoint
        self._processes = processes
        self._launches = {launch.instance: launch for launch in launches}
        self._again: list[subprocess.Popen[Any]] = []
        self.present: set[str] = set()
        self.people: set[str] = set()
        self.keepers: set[str] = set()
        bus.watch(SERVICE_ALIVE, self._note(self.present))
        bus.watch(USER_ALIVE, self._note(self.people))
        bus.watch(KEEPER_ALIVE, self._note(self.keepers))

    @staticmethod
    def _note(names: set[str]) -> PresenceHandler:
        return lambda name, *, present: (names.add if present else names.discard)(name)

    async def kill(self, instance: str) -> None:
        os.kill(self._processes._children[instance].pid, signal.SIGKILL)
        await until(lambda: instance not in self.present, what=f"{instance} to be gone")

    async def start_again(self, instance: str) -> None:
        command = self._processes.command(self._launches[instance])
        self._again.append(await asyncio.to_thread(subprocess.Popen, command))
        await until(lambda: instance in self.present, START_S, f"{instance} to be back")

    @staticmethod
    def _see(seen: dict[str, Message], key: str, message: Message, _name: str) -> None:
        seen[key] = message

    def end(self) -> None:
        for process in self._again:
            process.kill()
            process.wait()

    @asynccontextmanager
    async def _joined(self, topics: Sequence[Topic[Any]]) -> AsyncGenerator[dict[str, Message]]:
        """Join late, and yield what comes of `topics`, by key."""
        bus = await ZenohBus.open(Link(connect=(self.endpoint,)), patience_s=30)
        seen: dict[str, Message] = {}
        try:
            for topic in topics:
                bus.subscribe(topic, functools.partial(self._see, seen, topic.key))
            yield seen
        finally:
            await bus.close()

    async def found(self, topics: Sequence[Topic[Any]]) -> None:
        wanted = {topic.key for topic in topics}
        async with self._joined(topics) as seen:
            await until(lambda: wanted <= seen.keys(), what=f"{wanted}; there are only {seen.keys()}")

    async def is_missing(self, topics: Sequence[Topic[Any]]) -> bool:
        """Join late, and return True if one of `topics` has not come after some time."""
        async with self._joined(topics) as seen:
            await asyncio.sleep(ABSENT_S)
            return not {topic.key for topic in topics} <= seen.keys()


def on_disk(path: Path) -> set[str]:
    """Return the keys of what the keeper has written below `path`."""
    return {state.key for file in path.rglob(FILE) if (record := read(file)) for state in record.states}


@pytest_asyncio.fixture
async def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Site]:
    monkeypatch.setenv("POINTIT_STATE", str(tmp_path))
    scenario = read_scenario("scenario_4")
    wanted = {"pui", "selector", "keeper", "localizer", "supervisor", "pointing"}
    launches = [
        launch
        for launch in (*site_launches(scenario, Choices()), *user_launches(scenario, Choices(), "anna"))
        if launch.service.NAME in wanted
    ]
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    bus = await ZenohBus.open(Link(listen=(endpoint,)))
    try:
        async with Processes(launches, site="lab", connect=endpoint, clock="wall") as processes:
            site = Site(endpoint, bus, processes, launches)
            instances = {launch.instance for launch in launches}
            await until(lambda: instances <= site.present, START_S, "all to be present")
            await until(lambda: bool(site.keepers), what="the keeper to answer")
            try:
                yield site
            finally:
                site.end()
    finally:
        await bus.close()


@pytest.mark.slow
async def test_late_reader_gets_states_of_killed_writers(site: Site, tmp_path: Path) -> None:
    await site.found(ALL)
    for instance in WRITERS:
        await site.kill(instance)
        await site.found(ALL)
    await until(lambda: {topic.key for topic in ALL} <= on_disk(tmp_path), what="all to be on disk")

    await site.kill("keeper")
    assert await site.is_missing(ALL)
    await site.start_again("keeper")
    await until(lambda: bool(site.keepers), what="the keeper to answer")

    await site.found(ALL)
    await site.start_again("selector")  # which reads the map at its own start, and writes again itself
    await site.kill("pointing.anna")
    await until(lambda: not site.people, what="anna to be gone")

    await site.found((MAP, SELECTION))
    assert await site.is_missing((POSE,)), "hers, and she has left"
