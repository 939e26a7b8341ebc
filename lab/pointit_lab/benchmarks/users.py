"""People per core: CPU time of the whole pipeline at 100 Hz each, in one process."""

import asyncio
import time
from typing import Any

from pointit.schemas import Cursor
from pointit.schemas.topics import CURSOR, IMU
from pointit_lab.benchmarks.our_chain import running_bus
from pointit_lab.benchmarks.statistics import Figures
from pointit_lab.loadtest.layout import load_launches
from pointit_lab.loadtest.wrist import Wrist, drive_wrists

RATE_HZ = 100.0


async def carried(users: int, duration_s: float) -> dict[str, Any]:
    """Return CPU share, delivered cursors and their age for `users` people in scenario_3."""
    site, people = load_launches(users)
    ages_s: list[float] = []

    def on_cursor(cursor: Cursor, _user: str) -> None:
        ages_s.append((time.time_ns() - cursor.stamp_ns) / 1e9)

    async with running_bus([*site, *(launch for person in people.values() for launch in person)]) as bus:
        bus.subscribe(CURSOR, on_cursor)
        wrists = [Wrist(bus.publisher(IMU, user), index) for index, user in enumerate(people)]
        await asyncio.sleep(1.0)
        await drive_wrists(wrists, RATE_HZ, 1.0)
        ages_s.clear()
        sent = -sum(wrist.sent for wrist in wrists)
        cpu_s, wall_s = time.process_time(), time.monotonic()
        await drive_wrists(wrists, RATE_HZ, duration_s)
        cpu_s, wall_s = time.process_time() - cpu_s, time.monotonic() - wall_s
        sent += sum(wrist.sent for wrist in wrists)
    return {
        "users": users,
        "cpu_share_of_a_core": round(cpu_s / wall_s, 3),
        "cpu_us_per_sample": round(cpu_s / sent * 1e6, 1),
        "users_per_core": round(sent / cpu_s / RATE_HZ, 1),
        "delivered": round(len(ages_s) / (users * RATE_HZ * duration_s), 4),
        "age_of_cursors": Figures.of(ages_s).as_dict() if ages_s else None,
    }
