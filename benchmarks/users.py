"""People per core: CPU time of the whole pipeline at 100 Hz each, in one process."""

import asyncio
import time
from typing import Any

from benchmarks.our_chain import Wrist, beat
from benchmarks.statistics import Figures
from pointit.launch.plan.launches import Choices, site_launches, user_launches
from pointit.launch.plan.scenario import read_scenario
from pointit.runtime.clock import WallClock
from pointit.runtime.link.link import Link
from pointit.runtime.service.service import run_services
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Cursor
from pointit.schemas.topics import CURSOR, IMU

RATE_HZ = 100.0
WITHOUT = ("user-sim", "supervisor")
"""Services left out: the benchmark drives the wrists, and no button is needed."""


async def carried(users: int, duration_s: float) -> dict[str, Any]:
    """Return CPU share, delivered cursors and their age for `users` people in scenario_3."""
    scenario = read_scenario("scenario_3")
    choices = Choices()
    launches = site_launches(scenario, choices)
    for index in range(users):
        launches += [
            launch
            for launch in user_launches(scenario, choices, f"user{index}", index)
            if launch.service.NAME not in WITHOUT
        ]
    bus = await ZenohBus.open(Link())
    services = asyncio.create_task(run_services(launches, bus, WallClock()))
    ages_s: list[float] = []

    def on_cursor(cursor: Cursor, _user: str) -> None:
        ages_s.append((time.time_ns() - cursor.stamp_ns) / 1e9)

    try:
        bus.subscribe(CURSOR, on_cursor)
        wrists = [Wrist(bus.publisher(IMU, f"user{index}"), index) for index in range(users)]
        await asyncio.sleep(1.0)
        await beat(wrists, RATE_HZ, 1.0)
        ages_s.clear()
        cpu_s, wall_s = time.process_time(), time.monotonic()
        await beat(wrists, RATE_HZ, duration_s)
        cpu_s, wall_s = time.process_time() - cpu_s, time.monotonic() - wall_s
    finally:
        services.cancel()
        await asyncio.wait({services})
        await bus.close()
    share = cpu_s / wall_s
    return {
        "users": users,
        "cpu_share_of_a_core": round(share, 3),
        "cpu_us_per_sample": round(cpu_s / (users * RATE_HZ * duration_s) * 1e6, 1),
        "users_per_core": round(users / share, 1),
        "delivered": round(len(ages_s) / (users * RATE_HZ * duration_s), 4),
        "age_of_cursors": Figures.of(ages_s).as_dict() if ages_s else None,
    }
