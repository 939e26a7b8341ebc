"""Our pipeline: IMU sample to LED frame through pointing, pui and led-driver, in one process or four."""

import asyncio
import math
import time
from collections.abc import Sequence

from pointit.geometry import rotation
from pointit.launch.plan.launches import Choices, site_launches, user_launches
from pointit.launch.plan.scenario import read_scenario
from pointit.launch.run.subprocesses import Processes
from pointit.runtime.bus.contract import Publisher
from pointit.runtime.clock import WallClock
from pointit.runtime.link.link import Link
from pointit.runtime.service.service import Launch, run_services
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import ImuSample, StripsFrame, UserPose
from pointit.schemas.topics import IMU, POSE, STRIPS_FRAME

HOPS = 4
"""Messages from wrist to reader: imu, ray, cursor, frame."""
SETTLE_S = 1.0
UNLIMITED = "led-driver.max_rate_hz=1000"
"""Raises the limit of the frame rate, which would determine the result."""


def chain(users: int = 1) -> list[Launch]:
    """Return the services from wrist to light of scenario_2, without a simulated person."""
    scenario = read_scenario("scenario_2")
    choices = Choices(settings=(UNLIMITED,))
    launches = site_launches(scenario, choices)
    for index in range(users):
        launches += [
            launch
            for launch in user_launches(scenario, choices, f"user{index}", index)
            if launch.service.NAME in ("pointing", "localizer")
        ]
    return launches


class Wrist:
    """Publishes samples of an arm that sweeps over the strips."""

    def __init__(self, publisher: Publisher[ImuSample], phase_rad: float = 0.0) -> None:
        self._publisher = publisher
        self._phase_rad = phase_rad
        self._seq = 0
        self.stamp_ns = 0
        """Stamp of the newest sample."""

    def put(self) -> None:
        """Publish one sample, captured now."""
        self._seq += 1
        azimuth_rad = 0.3 * math.sin(self._seq / 50 + self._phase_rad)
        orientation_xyzw = rotation.from_azimuth_elevation(azimuth_rad, -0.02)
        self.stamp_ns = time.time_ns()
        self._publisher.put(
            ImuSample(stamp_ns=self.stamp_ns, seq=self._seq, orientation_xyzw=orientation_xyzw)
        )


async def one_process(rate_hz: float, duration_s: float) -> list[float]:
    """Return the times from capture to frame in one process, seconds."""
    bus = await ZenohBus.open(Link())
    services = asyncio.create_task(run_services(chain(), bus, WallClock()))
    try:
        return await _drive(bus, rate_hz, duration_s)
    finally:
        services.cancel()
        await asyncio.wait({services})
        await bus.close()


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
            await asyncio.wait_for(ready.wait(), 20)
            await asyncio.sleep(SETTLE_S)
            return await _drive(bus, rate_hz, duration_s)
    finally:
        await bus.close()


async def _drive(bus: ZenohBus, rate_hz: float, duration_s: float) -> list[float]:
    times_s: list[float] = []
    wrist = Wrist(bus.publisher(IMU, "user0"))

    def on_frame(frame: StripsFrame, _name: str) -> None:
        if frame.stamp_ns == wrist.stamp_ns:  # it shows the newest sample; others are drawn for other reasons
            times_s.append((time.time_ns() - frame.stamp_ns) / 1e9)

    bus.subscribe(STRIPS_FRAME, on_frame)
    await asyncio.sleep(SETTLE_S)
    await beat([wrist], rate_hz, duration_s)
    await asyncio.sleep(0.1)
    if not times_s:
        raise RuntimeError("no frame followed any sample")
    return times_s


async def beat(wrists: Sequence[Wrist], rate_hz: float, duration_s: float) -> None:
    """Publish `rate_hz` samples per second from every wrist, spread evenly over the period."""
    loop = asyncio.get_running_loop()
    due_s = loop.time()
    end_s = due_s + duration_s
    turn = 0
    while due_s < end_s:
        wrists[turn % len(wrists)].put()
        turn += 1
        due_s += 1.0 / (rate_hz * len(wrists))
        wait_s = due_s - loop.time()
        if wait_s > 0 or turn % len(wrists) == 0:
            await asyncio.sleep(max(0.0, wait_s))
