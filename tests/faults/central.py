"""A site with people who point, whose cursors one process computes, and insiders who flood it."""

import asyncio
import contextlib
import itertools
import math
import sys
import time
from collections import Counter, defaultdict
from collections.abc import AsyncGenerator, Generator, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pointit.access.rights import Role
from pointit.access.site_folder import SiteFolder
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Cursor, PointingRay, UserPose
from pointit.schemas.topics import CURSOR, POSE, RAY, USER_ALIVE
from tests.integration.access.secured import link_of, make_site
from tests.support.bench import until
from tests.support.commands import Command, Commands

PEOPLE = ("anna", "ben")
INSIDERS = ("insider1", "insider2", "insider3", "insider4", "insider5", "insider6")
"""They take turns: who has flooded for long is cut off, which would end the next flood."""
RATES_HZ = (1000, 3000, 4900)
RAY_HZ = 50.0
LONGEST_S = 0.5
FLOOD_S = 3.0
BUSY = 4
"""Processes that only compute: two for each of two cores."""
TRIES = 3


@dataclass
class Central:
    """A site that computes everybody's cursors in one process, and people who point."""

    commands: Commands
    folder: SiteFolder
    router: Command
    sent: Counter[str] = field(default_factory=Counter[str])
    """Number of rays by person so far."""
    came_s: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    """Arrivals of cursors by person, monotonic."""
    insiders: Iterator[str] = field(default_factory=lambda: itertools.cycle(INSIDERS))

    async def longest_gap_s(self) -> float:
        """Return the longest time from now on that a person is without a cursor."""
        began_s = time.monotonic()
        await asyncio.sleep(FLOOD_S)
        ends_s = time.monotonic()
        gaps = (
            after - before
            for person in PEOPLE
            for before, after in itertools.pairwise(
                [began_s, *(each for each in self.came_s[person] if each > began_s), ends_s]
            )
        )
        return max(gaps)

    @contextlib.contextmanager
    def flooded(self, insider: str, key: str, rate_hz: float) -> Generator[Command]:
        program = [sys.executable, "-m", "tests.faults.attackers", str(self.folder.path), insider]
        command = self.commands.run([*program, str(rate_hz), key])
        try:
            yield command
        finally:
            command.kill()

    @contextlib.contextmanager
    def busy(self) -> Generator[None]:
        """Keep the machine busy."""
        computing = [self.commands.run([sys.executable, "-c", "while True: pass"]) for _ in range(BUSY)]
        try:
            yield
        finally:
            for each in computing:
                each.kill()

    async def fresh(self) -> None:
        self.came_s.clear()
        await until(lambda: all(len(self.came_s[person]) > RAY_HZ / 2 for person in PEOPLE), what="cursors")

    async def gap_of_three(self, what: str) -> tuple[float, float]:
        """Return the longest gap under three insiders that are blocked, and the longest that there may be.

        They write the key `what`, or do what it says.

        They write until killed. Their own work takes as much of the machine as processes that only compute.
        """
        with self.busy():
            alone_s = await self.longest_gap_s()
        with contextlib.ExitStack() as stack:
            for insider in INSIDERS[:3]:
                stack.enter_context(self.flooded(insider, what.format(insider), RATES_HZ[-1]))
            for insider in INSIDERS[:3]:
                await self.router.says(f"lab/{insider} has written or asked 10000 messages more")
            await self.fresh()
            return await self.longest_gap_s(), max(LONGEST_S, 2.0 * alone_s)

    async def gap_of(self, key: str, rate_hz: float) -> tuple[float, float]:
        """Return the longest gap of cursors with an insider flooding, and the longest that there may be.

        Repeated if the gap is long: a blackout by floods repeats, one by other jobs of the machine may not.
        Only then is it measured what gap there is with nobody flooding.
        """
        flooded_s = math.inf
        most_s = LONGEST_S
        for _ in range(TRIES):
            await self.fresh()
            if flooded_s < math.inf:
                with self.busy():
                    most_s = max(LONGEST_S, 2.0 * await self.longest_gap_s())
            insider = next(self.insiders)
            with self.flooded(insider, key.format(insider), rate_hz) as flood:
                await flood.says("begins")
                with self.busy():
                    flooded_s = await self.longest_gap_s()
            if flooded_s <= LONGEST_S:
                break
        return flooded_s, most_s


async def point(bus: ZenohBus, name: str, sent: Counter[str]) -> None:
    """Point until cancelled, and count the rays in `sent`."""
    bus.announce(USER_ALIVE, name)
    bus.publisher(POSE, name).put(UserPose(stamp_ns=time.time_ns(), position_m=(1.5, 1.0, 0.0), yaw_rad=0.0))
    rays = bus.publisher(RAY, name)
    for seq in itertools.count(1):
        azimuth_rad = 0.8 * math.sin(seq / RAY_HZ)
        direction = (0.8 * math.cos(azimuth_rad), 0.8 * math.sin(azimuth_rad), -0.6)
        rays.put(PointingRay(stamp_ns=time.time_ns(), seq=seq, origin_m=(0.0, 0.0, 1.4), direction=direction))
        sent[name] += 1
        await asyncio.sleep(1.0 / RAY_HZ)


@contextlib.asynccontextmanager
async def central_site(path: Path, insiders: Sequence[str] = INSIDERS) -> AsyncGenerator[Central]:
    """Yield a site on which all is well."""
    names: dict[str, Role] = {"supervisor": "supervisor", "dashboard1": "dashboard"}
    for name in (*PEOPLE, *insiders):
        names[name] = "user"
    folder = make_site(path / "site", names=names)
    commands = Commands(path)
    try:
        async with contextlib.AsyncExitStack() as stack:
            environment = {"POINTIT_STATE": str(path / "state")}
            router = commands.start_program(
                "router", "--site-folder", str(folder.path), environment=environment
            )
            await router.says("router listens")
            environment["POINTIT_CREDENTIALS"] = str(folder.identity_folder("supervisor"))
            options = ("--site-only", "--duration", "3600", "--no-view")
            commands.start_program("run", "scenario_4", *options, environment=environment)
            site = Central(commands, folder, router)

            async def join(name: str) -> ZenohBus:
                bus = await ZenohBus.open(link_of(folder, name), patience_s=60)
                stack.push_async_callback(bus.close)
                return bus

            onlooker = await join("dashboard1")

            def on_cursor(_cursor: Cursor, user: str) -> None:
                site.came_s[user].append(time.monotonic())

            onlooker.subscribe(CURSOR, on_cursor)
            buses = {person: await join(person) for person in PEOPLE}
            async with asyncio.TaskGroup() as group:  # ends before the buses close
                pointing = [group.create_task(point(bus, person, site.sent)) for person, bus in buses.items()]
                try:
                    await site.fresh()
                    yield site
                finally:
                    for task in pointing:
                        task.cancel()
    finally:
        commands.kill_all()
