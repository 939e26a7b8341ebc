"""Our pipeline: IMU sample to LED frame through pointing, pui and led-driver, in one process or four."""

import asyncio
import time
from collections.abc import AsyncGenerator, Sequence
from contextlib import asynccontextmanager

from pointit.launch.plan.launches import Choices
from pointit.launch.run.subprocesses import Processes
from pointit.runtime.link.link import Link
from pointit.runtime.service.service import Launch
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import StripsFrame, UserPose
from pointit.schemas.topics import IMU, POSE, STRIPS_FRAME
from pointit_lab.loadtest.layout import load_launches
from pointit_lab.loadtest.rig import running
from pointit_lab.loadtest.wrist import Wrist, drive_wrists

HOPS = 4
"""Messages from wrist to reader: imu, ray, cursor, frame."""
SETTLE_S = 1.0
UNLIMITED = "led-driver.max_rate_hz=1000"
"""Raises the limit of the frame rate, which would determine the result."""
USER = "load0"


def chain() -> list[Launch]:
    """Return the services from wrist to light of scenario_2, for one person."""
    site, people = load_launches(1, "scenario_2", Choices(settings=(UNLIMITED,)))
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


async def _drive(bus: ZenohBus, rate_hz: float, duration_s: float) -> list[float]:
    times_s: list[float] = []
    wrist = Wrist(bus.publisher(IMU, USER))

    def on_frame(frame: StripsFrame, _name: str) -> None:
        if frame.stamp_ns == wrist.stamp_ns:  # it shows the newest sample; others are drawn for other reasons
            times_s.append((time.time_ns() - frame.stamp_ns) / 1e9)

    bus.subscribe(STRIPS_FRAME, on_frame)
    await asyncio.sleep(SETTLE_S)
    await drive_wrists([wrist], rate_hz, duration_s)
    await asyncio.sleep(0.1)
    if not times_s:
        raise RuntimeError("no frame followed any sample")
    return times_s
