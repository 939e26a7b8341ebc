"""Nodes of ours in one ROS graph, strangers beside them, and processes that can be killed.

As a program: `python -m tests.integration.ros2.nodes router|talker ENDPOINT`.
"""

import asyncio
import contextlib
import json
import os
import signal
import struct
import subprocess
import sys
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from typing import Any

import zenoh

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backend import LATCHED, Backend, Graph, Qos, RosType
from pointit.bridges.ros2.graph.backends import opened
from pointit.bridges.ros2.over_zenoh.backend import ZenohBackend
from pointit.runtime.foreign_zenoh import RawLink, open_raw_session
from tests.architecture.sources import ROOT
from tests.support.bench import until
from tests.support.buses import free_port
from tests.unit.ros2.graph_of_one import Shown

POSE = RosType(name="geometry_msgs/msg/PoseStamped", hash="RIHS01_" + "1" * 64)
BOOL = RosType(name="std_msgs/msg/Bool", hash="RIHS01_" + "2" * 64)
ADD = RosType(name="conveyor_msgs/srv/AddPack", hash="RIHS01_" + "3" * 64)
GID = b"g" * 16
RELIABLE = Qos(depth=10)
DOMAIN = 7


class Node:
    """One node of ours, and what it says."""

    def __init__(self, backend: Backend, shown: Shown) -> None:
        assert isinstance(backend, ZenohBackend)
        self.backend = backend
        self.shown = shown
        self.graphs: list[Graph] = []
        backend.watch(self.graphs.append)

    @property
    def graph(self) -> Graph:
        return self.graphs[-1]

    def hears(self, topic: str, kind: RosType, qos: Qos = RELIABLE) -> list[int]:
        """Return a list that grows with the numbers that arrive."""
        seen: list[int] = []
        self.backend.subscribe(topic, kind, qos, lambda cdr: seen.append(number_of(cdr)))
        return seen


def cdr_of(number: int, size: int = 8) -> bytes:
    return b"\0\1\0\0" + number.to_bytes(8, "little") + bytes(size - 8)


def number_of(cdr: bytes) -> int:
    return int.from_bytes(cdr[4:12], "little")


def attachment(sequence: int = 1, length: int = 16) -> bytes:
    """Return the bytes that rmw_zenoh attaches to the message of this number, of a stranger's endpoint."""
    return struct.pack("<qqB16s", sequence, 0, length, GID)


def key_of(topic: str, kind: RosType = POSE) -> str:
    return f"{DOMAIN}{topic}/{kind.dds_name}/{kind.hash}"


class Graphs:
    """Opens nodes at one endpoint, and closes them."""

    def __init__(self, endpoint: str, stack: contextlib.AsyncExitStack) -> None:
        self.endpoint = endpoint
        self._stack = stack

    async def node(self, name: str, mode: str = "peer", *, is_bridge: bool = False, **settings: Any) -> Node:
        shown = Shown()
        values: dict[str, Any] = {
            "endpoint": self.endpoint,
            "mode": mode,
            "node": name,
            "domain_id": DOMAIN,
        } | settings
        backend = await opened(BackendConfig.model_validate(values), shown, is_bridge=is_bridge)
        self._stack.push_async_callback(backend.close)
        return Node(backend, shown)

    async def stranger(self) -> zenoh.Session:
        """Return a bare client of no node."""
        config = zenoh.Config()
        settings = {
            "mode": "client",
            "connect/endpoints": [self.endpoint],
            "scouting/multicast/enabled": False,
            "timestamping/enabled": True,
        }
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
        session = await asyncio.to_thread(zenoh.open, config)
        self._stack.push_async_callback(asyncio.to_thread, session.close)
        return session


@asynccontextmanager
async def graphs() -> AsyncGenerator[Graphs]:
    async with contextlib.AsyncExitStack() as stack:
        yield Graphs(f"tcp/127.0.0.1:{free_port()}", stack)


async def met(*nodes: Node) -> None:
    """Return when every node knows every endpoint of the others."""

    def all_know_the_same() -> bool:
        names = {node.backend.node for node in nodes}
        known = [frozenset((e.kind, e.node, e.name) for e in node.graph.endpoints) for node in nodes]
        return all(names <= node.graph.nodes for node in nodes) and len(set(known)) == 1

    await until(all_know_the_same, 10, "the nodes to know each other")


async def arrives(
    put: Callable[[], object], seen: list[Any], count: int = 1, *, number: int | None = None
) -> None:
    """Put again and again until `count` have arrived: writers do not wait for readers to be known.

    Further copies may still be on their way: who puts something else next awaits its `number`.
    """

    def tried() -> bool:
        put()
        return len(seen) >= count and (number is None or number in seen)

    await until(tried, 10, "anything to arrive")


class Process:
    """A router or a talker of its own, at one endpoint, that can be killed."""

    def __init__(self, what: str, endpoint: str) -> None:
        self.what = what
        self.endpoint = endpoint
        self._process: subprocess.Popen[str] | None = None

    async def start(self) -> None:
        await asyncio.to_thread(self._start)

    def _start(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.integration.ros2.nodes", self.what, self.endpoint],
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        assert line.strip() == "ready", line

    def send(self, number: int) -> None:
        if self._process is not None:
            self._process.send_signal(number)

    def kill(self) -> None:
        process = self._process
        self._process = None
        if process is not None:
            os.kill(process.pid, signal.SIGKILL)
            process.wait(10)
            if process.stdout is not None:
                process.stdout.close()


@asynccontextmanager
async def process(what: str, endpoint: str) -> AsyncGenerator[Process]:
    running = Process(what, endpoint)
    await running.start()
    try:
        yield running
    finally:
        running.kill()


async def _main(what: str, endpoint: str) -> None:
    if what == "router":
        await open_raw_session(RawLink(endpoint=endpoint, mode="router"))
    else:
        config = BackendConfig(endpoint=endpoint, node="/talker", domain_id=DOMAIN)
        node = await opened(config, Shown())
        node.advertise("/kept", BOOL, LATCHED).put(cdr_of(1))
        node.subscribe("/flood", POSE, RELIABLE, lambda _cdr: None)
        node.serve("/slow", ADD, never)
    print("ready", flush=True)  # noqa: T201 - the parent process waits for it
    await asyncio.Event().wait()


async def never(_request: bytes) -> bytes:
    await asyncio.Event().wait()
    return b""


if __name__ == "__main__":
    asyncio.run(_main(*sys.argv[1:]))
