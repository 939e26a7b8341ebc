"""Recordings for tests: simulated people in a scenario, in virtual time, as the recorder would see them."""

import asyncio
import functools
import os
import tempfile
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

from pointit.conversion.recording_file import new_recording
from pointit.launch.plan.launches import Choices, site_launches, user_launches
from pointit.launch.plan.plan import read_scenario
from pointit.recording.entries import Entry, entry
from pointit.recording.head import make_head
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.service.service import run_services
from pointit.runtime.virtual_time import START_NS, VirtualClock, run_virtually
from pointit.schemas import Message
from pointit.schemas.topics import PRESENCES, TOPICS, Delivery, Presence, Topic

SITE = "lab"


def session(scenario: str, duration_s: float, users: tuple[str, ...] = ("anna",)) -> list[Entry]:
    """Return the entries of a recorder while `users` point in `scenario`."""
    others = {name: value for name, value in os.environ.items() if not name.startswith("POINTIT_")}
    with (
        tempfile.TemporaryDirectory() as folder,
        mock.patch.dict(os.environ, others | {"POINTIT_STATE": folder}, clear=True),
    ):
        return run_virtually(_session(scenario, duration_s, users))


def write_recording(path: Path, entries: Iterable[Entry], began_ns: int = START_NS, **head: Any) -> Path:
    """Write a recording of `entries`, with more fields of its `head` if given, and return its path."""
    with new_recording(path, make_head(SITE, began_ns, **head), overwrite=True) as writer:
        for each in entries:
            writer.add(each)
    return path


async def _session(scenario: str, duration_s: float, users: tuple[str, ...]) -> list[Entry]:
    plan = read_scenario(scenario)
    choices = Choices(seed=1)
    launches = site_launches(plan, choices)
    for index, user in enumerate(users):
        launches += user_launches(plan, choices, user, index)
    exchange = LocalBroker()
    clock = VirtualClock()
    onlooker = MemoryBus(exchange)
    bus = MemoryBus(exchange)
    entries: list[Entry] = []

    def on_message(row: Topic[Any], message: Message, name: str) -> None:
        entries.append(entry(clock.now_ns(), row, name, message))

    def on_presence(row: Presence, name: str, *, present: bool) -> None:
        entries.append(entry(clock.now_ns(), row, name, present))

    for presence in PRESENCES:
        onlooker.watch(presence, functools.partial(on_presence, presence))
    for topic in TOPICS:
        onlooker.subscribe(replace(topic, delivery=Delivery.EVENT), functools.partial(on_message, topic))
    life = asyncio.create_task(run_services(launches, bus, clock))
    await asyncio.wait([life], timeout=duration_s)
    kept = list(entries)  # the end of the services is not part of it
    life.cancel()
    await asyncio.gather(life, return_exceptions=True)
    await asyncio.sleep(1.0)
    await bus.close()
    await onlooker.close()
    return kept
