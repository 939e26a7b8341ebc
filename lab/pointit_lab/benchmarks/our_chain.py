"""Our pipeline: IMU sample to LED frame through pointing, pui and led-driver, in one process or four."""

import asyncio
import contextlib
import itertools
import time
from collections import defaultdict
from collections.abc import AsyncGenerator, Awaitable, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any, TypeAlias

import pointit
from pointit.launch.plan.launches import Choices
from pointit.launch.run.processes import Processes
from pointit.runtime.link.link import Link
from pointit.runtime.service.service import Launch
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Cursor, SelectionEvent, StripsFrame, UserPose
from pointit.schemas.topics import CURSOR, IMU, POSE, STRIPS_FRAME
from pointit_lab.benchmarks.statistics import Figures
from pointit_lab.loadtest.layout import load_launches
from pointit_lab.loadtest.rig import running
from pointit_lab.loadtest.slopes import LoadSlope, fit
from pointit_lab.loadtest.workers import Group, Worker
from pointit_lab.loadtest.wrist import LoadTestWrist, drive_wrists

Drive: TypeAlias = Callable[[float], Awaitable[int]]
"""Publishes samples of all wrists for that duration, s. Returns their number."""

HOPS = 4
"""Messages from wrist to reader: imu, ray, cursor, frame."""

SETTLE_S = 1.0
WARM_UP_S = 1.0

DELIVERED = 0.99
"""Share of the samples whose cursors a measurement must deliver to count in a fit."""

UNLIMITED = "led-driver.max_rate_hz=1000"
"""Raises the limit of the frame rate, which would determine the result."""

USER = "load0"

AT_SHELF = 3
"""People who point at a shelf: one at each of its places."""
QUICK = {"selector.estimate.dwell_s": 0.3}
"""Lets them fire things more often."""

RATE_HZ = 100.0

PEOPLE = (1, 10, 20, 40, 60)

USERS = {
    "users": "wrists in the services' process, their CPU measured alone and subtracted",
    "users_apart": "wrists in another process, CPU of the services' process",
}
"""Titles of the measurements of people, by their names in the result."""


def chain() -> list[Launch]:
    """Return the services from wrist to light of scenario_2, for one person."""
    choices = Choices(settings=(UNLIMITED,))
    site, people = load_launches(1, "scenario_2", choices)
    return [*site, *people[USER]]


@asynccontextmanager
async def running_bus(launches: Sequence[Launch], link: Link | None = None) -> AsyncGenerator[ZenohBus]:
    """Yield a bus on which services run."""
    bus = await ZenohBus.open(link or Link())
    try:
        async with running(launches, bus):
            yield bus
    finally:
        await bus.close()


async def one_process(rate_hz: float, duration_s: float) -> list[float]:
    """Return the times from capture to frame in one process, seconds."""
    async with running_bus(chain()) as bus:
        return await _drive(bus, rate_hz, duration_s)


async def processes(rate_hz: float, duration_s: float, endpoint: str) -> list[float]:
    """Return the times when each service is a process, all connected to this one, seconds."""
    bus = await ZenohBus.open(Link(listen=(endpoint,)))
    try:
        async with Processes(chain(), site="lab", connect=endpoint, clock="wall"):
            ready = asyncio.Event()
            poses: list[UserPose] = []

            def on_pose(pose: UserPose, _user: str) -> None:
                poses.append(pose)
                ready.set()

            bus.subscribe(POSE, on_pose)
            async with asyncio.timeout(20):
                await ready.wait()
            await asyncio.sleep(SETTLE_S)
            return await _drive(bus, rate_hz, duration_s)
    finally:
        await bus.close()


async def pointed(duration_s: float) -> list[float]:
    """Return the times from the sample by which a thing fires to the call of a function for it, seconds.

    All of scenario `shelf` is in this process, with simulated people who go from box to box.
    """
    times_s: list[float] = []

    async def on_event(event: SelectionEvent) -> None:
        age_ns = time.time_ns() - event.stamp_ns
        times_s.append(age_ns / 1e9)

    async with pointit.run("shelf", users=AT_SHELF, settings=QUICK) as site:
        site.on_pointed()(on_event)
        await site.sleep(duration_s)
    return times_s


async def _drive(bus: ZenohBus, rate_hz: float, duration_s: float) -> list[float]:
    times_s: list[float] = []
    wrist = LoadTestWrist(bus.publisher(IMU, USER))

    def on_frame(frame: StripsFrame, _name: str) -> None:
        # it shows the newest sample; other frames are drawn for other reasons
        if frame.stamp_ns == wrist.stamp_ns:
            age_ns = time.time_ns() - frame.stamp_ns
            times_s.append(age_ns / 1e9)

    bus.subscribe(STRIPS_FRAME, on_frame)
    await asyncio.sleep(SETTLE_S)
    await drive_wrists([wrist], rate_hz, duration_s)
    await asyncio.sleep(0.1)
    if not times_s:
        raise RuntimeError("no frame followed any sample")
    return times_s


def user_rows(duration_s: float, free_endpoint: Callable[[], str]) -> dict[str, list[dict[str, Any]]]:
    """Return the rows of `carried` by the names of `USERS`, measured in turns."""
    rows = defaultdict[str, list[dict[str, Any]]](list)
    for count in PEOPLE:
        for part, endpoint in zip(USERS, ("", free_endpoint()), strict=True):
            row = asyncio.run(carried(count, duration_s, endpoint))
            rows[part].append(row)
    return dict(rows)


async def carried(users: int, duration_s: float, endpoint: str = "") -> dict[str, Any]:
    """Return the CPU of the services of `users` people in scenario_3, delivered cursors and their age.

    Wrists are in this process, and their own CPU is measured before the services start. With an `endpoint`
    they are in another process, which joins there: the CPU is that of the services, decoding included.
    """
    site, people = load_launches(users)
    ages_s: list[float] = []

    def on_cursor(cursor: Cursor, _user: str) -> None:
        age_ns = time.time_ns() - cursor.stamp_ns
        ages_s.append(age_ns / 1e9)

    async with contextlib.AsyncExitStack() as stack:
        listen = (endpoint,) if endpoint else ()
        bus = await ZenohBus.open(Link(listen=listen))
        stack.push_async_callback(bus.close)
        if endpoint:
            group = Group(name="wrists", wrists=list(people))
            worker = await Worker.start(group, bus.site, endpoint)
            stack.push_async_callback(worker.end)
            drive = _in_worker(worker)
            driver = None
        else:
            wrists: list[LoadTestWrist] = []
            for index, user in enumerate(people):
                publisher = bus.publisher(IMU, user)
                wrists.append(LoadTestWrist(publisher, index))
            drive = _here(wrists)
            await drive(WARM_UP_S)
            driver = await _used(drive, duration_s)

        # The services start only now, so that the CPU time before is that of the wrists alone.
        launches = [*site, *itertools.chain(*people.values())]
        await stack.enter_async_context(running(launches, bus))
        bus.subscribe(CURSOR, on_cursor)
        await asyncio.sleep(SETTLE_S)
        await drive(WARM_UP_S)
        ages_s.clear()
        used = await _used(drive, duration_s)

    return _carried_row(users, duration_s, used, driver, ages_s)


def _carried_row(
    users: int, duration_s: float, used: "_Used", driver: "_Used | None", ages_s: list[float]
) -> dict[str, Any]:
    """Return the row of `users` people: what was `used`, without what the `driver` alone uses."""
    driver_us = driver.us_per_sample if driver else 0.0
    services_us = used.us_per_sample - driver_us
    services_share = used.share * services_us / used.us_per_sample
    planned = users * RATE_HZ * duration_s
    people_sent = used.sent / (RATE_HZ * duration_s)
    age_of_cursors = Figures.of(ages_s).as_dict() if ages_s else None
    return {
        "users": users,
        "people_sent": round(people_sent, 3),
        "cpu_share_of_a_core": round(used.share, 4),
        "cpu_us_per_sample": round(used.us_per_sample, 1),
        "driver_us_per_sample": round(driver_us, 1) if driver else None,
        "services_share_of_a_core": round(services_share, 4),
        "services_us_per_sample": round(services_us, 1),
        "delivered": round(len(ages_s) / planned, 4),
        "age_of_cursors": age_of_cursors,
    }


@dataclass(frozen=True)
class _Used:
    """CPU time of this process while wrists were driven."""

    cpu_s: float
    wall_s: float
    sent: int

    @property
    def share(self) -> float:
        return self.cpu_s / self.wall_s

    @property
    def us_per_sample(self) -> float:
        return self.cpu_s / self.sent * 1e6


async def _used(drive: Drive, duration_s: float) -> _Used:
    cpu_before_s = time.process_time()
    start_s = time.monotonic()
    sent = await drive(duration_s)
    cpu_s = time.process_time() - cpu_before_s
    wall_s = time.monotonic() - start_s
    return _Used(cpu_s, wall_s, sent)


def _here(wrists: Sequence[LoadTestWrist]) -> Drive:
    async def drive(duration_s: float) -> int:
        before = sum(wrist.sent for wrist in wrists)
        await drive_wrists(wrists, RATE_HZ, duration_s)
        return sum(wrist.sent for wrist in wrists) - before

    return drive


def _in_worker(worker: Worker) -> Drive:
    async def drive(duration_s: float) -> int:
        worker.send_line({"rate_hz": RATE_HZ, "duration_s": duration_s})
        answer = await worker.answer()
        return int(answer["sent"])

    return drive


def costs(rows: Sequence[Mapping[str, Any]], share: str) -> dict[str, LoadSlope]:
    """Return the costs of the site, % of a core, and of a sample, µs, with 95 % intervals.

    They are fitted to the column `share` of the rows that delivered what was to be sent. Empty if these are
    fewer than two.
    """
    rows = [row for row in rows if row["delivered"] >= DELIVERED]
    fixed = [1.0] * len(rows)
    people = [row.get("people_sent", row["users"]) for row in rows]
    shares = [row[share] for row in rows]
    slopes = fit({"fixed": fixed, "sample": people}, shares)
    scales = {"fixed": 100.0, "sample": 1e6 / RATE_HZ}
    costs: dict[str, LoadSlope] = {}
    for name, slope in slopes.items():
        scale = scales[name]
        error = None
        if slope.error is not None:
            error = slope.error * scale
        costs[name] = LoadSlope(value=slope.value * scale, error=error)
    return costs
