"""A running service reads, writes and answers what its row of the process table says."""

import asyncio
import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.config.config import Config
from pointit.runtime.service.service import Context
from pointit.schemas.system import SHARDED
from pointit.schemas.topics import USER_ALIVE
from pointit.services.registry import PROCESSES, Process
from tests.support.bench import ManualClock, until

RECORDING = """\
t,qw,qx,qy,qz,robot_x,robot_y,robot_z
0.00,1.0,0.0,0.0,0.0,1.0,2.0,1.5
0.02,1.0,0.0,0.0,0.0,1.1,2.0,1.5
"""


def with_a_recording(kind: type[Config], folder: Path) -> Config:
    path = folder / "recording.csv"
    path.write_text(RECORDING, encoding="utf-8")
    return kind.model_validate({"recording": str(path)})


def to_a_file_of_its_own(kind: type[Config], folder: Path) -> Config:
    return kind.model_validate({"file": str(folder / "session.mcap")})


def at_any_port(kind: type[Config], _folder: Path) -> Config:
    return kind.model_validate({"port": 0})


def in_a_graph_of_its_own(kind: type[Config], _folder: Path) -> Config:
    return kind.model_validate({"backend": {"mode": "router", "endpoint": "tcp/127.0.0.1:0"}})


def without_a_broker(kind: type[Config], _folder: Path) -> Config:
    return kind.model_validate({"broker": "127.0.0.1:1"})


def with_a_server(kind: type[Config], _folder: Path) -> Config:
    bodies = {"cap": {"person": "anna"}, "cuff": {"person": "anna", "part": "forearm"}}
    return kind.model_validate({"server": "127.0.0.1", "port": 1, "bodies": bodies})


def at_a_home(kind: type[Config], folder: Path) -> Config:
    (folder / "token").write_text("token", encoding="utf-8")
    (folder / "token").chmod(0o600)
    return kind.model_validate({"url": "http://127.0.0.1:1", "token_file": str(folder / "token")})


CONFIGURATIONS: dict[str, Callable[[type[Config], Path], Config]] = {
    "agv-tracker": without_a_broker,
    "home-assistant": at_a_home,
    "mocap": with_a_server,
    "recorder": to_a_file_of_its_own,
    "robot-replay": with_a_recording,
    "ros2": in_a_graph_of_its_own,
    "web": at_any_port,
}
"""For services that do not start without parameters, or that would disturb others."""


def configuration(row: Process, folder: Path) -> Config:
    kind: type[Config] = row.load().CONFIG
    return CONFIGURATIONS[row.name](kind, folder) if row.name in CONFIGURATIONS else kind()


@pytest.mark.parametrize("row", [pytest.param(row, id=row.name) for row in PROCESSES])
async def test_a_service_declares_what_its_row_says(row: Process, tmp_path: Path) -> None:
    bus = MemoryBus(LocalBroker())
    clock = ManualClock()
    user = "anna" if row.scope == "user" else ""
    view = ServiceBus(bus, clock, row.name, row.name, user)
    bus.announce(USER_ALIVE, "anna")  # some write for any person present
    service = row.load()(configuration(row, tmp_path), Context(bus=view, clock=clock, user=user))
    life = asyncio.create_task(service.run())
    try:
        for _ in range(20):
            await asyncio.sleep(0)
        await until(lambda: bool(view.writes) or not row.writes or life.done(), 10, "a writer")
        if life.done():
            life.result()
        assert_within(row.name, "reads", view.reads, row.reads)
        assert_within(row.name, "writes", view.writes, row.writes)
        assert view.served == {request.key for request in row.serves}, f"{row.name} answers something else"
        assert view.writes or not row.writes, (
            f"{row.name} declares no writer in its constructor or at the start of run()"
        )
    finally:
        life.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await life
        await view.close()
        await bus.close()


def assert_within(name: str, verb: str, declared: set[str], row: tuple[Any, ...]) -> None:
    """A row may list more than is declared at the start (what is read or written later), never less."""
    undeclared = declared - {topic.key for topic in row}
    assert not undeclared, f"{name} {verb} {sorted(undeclared)}, but its row in the registry does not say so"


def test_services_that_have_shards_are_those_that_schemas_name() -> None:
    assert {row.name for row in PROCESSES if row.shard_serves is not None} == SHARDED
