"""A site in memory whose services are played, and the genuine client of the protocol on it."""

import asyncio
import contextlib
import json
from collections.abc import AsyncGenerator, AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import pytest_asyncio
from mcp import Client
from mcp.types import CallToolResult, TextContent

from pointit.api.site import Site
from pointit.assistants.audit_file import FOLDER, AuditFile, read_audit
from pointit.assistants.server import make_server
from pointit.assistants.site_connection import SiteConnection
from pointit.assistants.tools import Role, Tools
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.errors import RefusedError
from pointit.runtime.host.state_file import site_folder
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import (
    Cursor,
    Done,
    Environment,
    FindReferents,
    Lamp,
    Referent,
    Referents,
    RobotState,
    Say,
    SendRobot,
    SetLamp,
    StopRobot,
    Thing,
    topics,
)

SITE = "shop"
ROOM = Environment(
    stamp_ns=1,
    name="shop",
    lamps=(Lamp(id="desk", position_m=(1.0, 0.0, 1.0)), Lamp(id="door", position_m=(4.0, 0.0, 1.0))),
    things=(
        Thing(id="kettle", label="the kettle", center_m=(1.2, 0.0, 1.0), size_m=(0.2, 0.2, 0.2)),
        Thing(id="radio", lamp="door", center_m=(4.0, 0.0, 1.0), size_m=(0.2, 0.2, 0.2)),
        Thing(id="shelf", center_m=(9.0, 9.0, 1.0), size_m=(0.2, 0.2, 0.2)),
    ),
)
ROVER = RobotState(
    stamp_ns=1, kind="ground", phase="idle", position_m=(2.0, 2.0, 0.0), yaw_rad=0.0,
    velocity_mps=(0.0, 0.0, 0.0), radius_m=0.2,
)  # fmt: skip


@dataclass
class Played:
    """Requests to the services of the site, and their answers."""

    bus: MemoryBus
    asked: list[tuple[str, Any]] = field(default_factory=list[tuple[str, Any]])
    """Names and queries, in order, lamps excepted."""
    lamps: list[tuple[str, Any]] = field(default_factory=list[tuple[str, Any]])
    """Lamps and their colours, in order."""
    meant: Referents = field(default_factory=Referents)
    refusal: str = ""
    rover: RobotState | None = None
    """State of the rover after it was sent. None: it drives."""

    def point(self, name: str, probability: float = 0.9) -> None:
        referent = Referent(kind="thing", name=name, probability=probability, place_m=(1.0, 2.0, 3.0))
        self.meant = Referents(candidates=(referent,), none=1.0 - probability)

    def cursor(self, stamp_ns: int) -> None:
        self.bus.publisher(topics.CURSOR, "anna").put(Cursor(stamp_ns=stamp_ns))

    async def lamp(self, query: SetLamp, name: str) -> Done:
        self.lamps.append((name, query.color))
        return Done(message=f"lamp {name} shows {query.color}")

    async def find(self, query: FindReferents, name: str) -> Referents:
        self.asked.append((name, query))
        return self.meant

    async def done(self, query: SendRobot | StopRobot | Say, name: str) -> Done:
        self.asked.append((name, query))
        if self.refusal:
            raise RefusedError(self.refusal)
        if isinstance(query, SendRobot):
            state = ROVER.model_copy(update={"user": "anna", "phase": "moving", "target_m": query.position_m})
            self.bus.publisher(topics.ROBOT_STATE, "rover").put(self.rover or state)
        return Done(message="done")


@dataclass
class Assistant:
    """The client, and the audit of what it calls."""

    client: Client
    played: Played

    async def call(self, tool: str, **arguments: Any) -> dict[str, Any]:
        """Return the result of a tool, or fail with what it says."""
        result = await self.client.call_tool(tool, arguments)
        assert not result.is_error, text_of(result)
        return cast("dict[str, Any]", result.structured_content)

    async def refused(self, tool: str, **arguments: Any) -> str:
        """Return the sentence by which a tool refuses."""
        result = await self.client.call_tool(tool, arguments)
        assert result.is_error, text_of(result)
        reason: str = json.loads(text_of(result).partition(": ")[2])["refused"]
        return reason

    @property
    def audit(self) -> list[tuple[str, str]]:
        """Tools that were called, and their outcomes."""
        records = list(read_audit(SITE))
        outcomes = {each["call"]: each["outcome"] for each in records if "outcome" in each}
        return [(each["tool"], outcomes[each["call"]]) for each in records if "tool" in each]


def text_of(result: CallToolResult) -> str:
    (content,) = result.content
    assert isinstance(content, TextContent)
    return content.text


@contextlib.asynccontextmanager
async def assistant_of(
    played: Played, role: Role = "operator", folder: Path | None = None, *, is_remote: bool = False
) -> AsyncGenerator[Assistant]:
    """Yield a client of a server on the site."""

    door = SiteConnection(lambda: Site.on(played.bus, VirtualClock()), "site shop")
    audit = AuditFile(site_folder(SITE, FOLDER) if folder is None else folder)
    tools = Tools(door, audit, role, is_remote=is_remote)
    async with door.opened(), Client(make_server(tools)) as client:
        await settled(door, played)
        yield Assistant(client, played)


async def settled(door: SiteConnection, played: Played) -> None:
    """Return when the site is joined, and the rover has reported."""
    await asyncio.sleep(0.01)
    played.bus.publisher(topics.ROBOT_STATE, "rover").put(ROVER)
    await door.site.latest.robot.wait("rover")


@pytest_asyncio.fixture
async def played() -> AsyncIterator[Played]:
    bus = MemoryBus()
    played = Played(bus)
    bus.announce(topics.USER_ALIVE, "anna")
    bus.publisher(topics.MAP).put(ROOM)
    bus.serve(topics.SET_LAMP, played.lamp)
    bus.serve(topics.FIND_REFERENTS, played.find, "anna")
    bus.serve(topics.SEND_ROBOT, played.done, "anna")
    bus.serve(topics.STOP_ROBOT, played.done, "rover")
    bus.serve(topics.SAY, played.done, "anna")
    yield played
    await bus.close()


@pytest_asyncio.fixture
async def assistant(played: Played) -> AsyncIterator[Assistant]:
    """Yield an assistant whose client is opened and closed by one task, as it demands."""
    opened: asyncio.Future[Assistant] = asyncio.get_running_loop().create_future()
    over = asyncio.Event()

    async def keep() -> None:
        async with assistant_of(played) as assistant:
            opened.set_result(assistant)
            await over.wait()

    keeping = asyncio.create_task(keep())
    keeping.add_done_callback(lambda _: opened.cancel())  # it could not be opened: the error is its own
    yield await opened
    over.set()
    await keeping
