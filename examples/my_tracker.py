"""My tracker: a red train, seen by a camera of mine, shuttles along a strip. People can select it."""

import asyncio
import contextlib
import math

import numpy as np

import pointit
from pointit.schemas import Strip, TrackedObject
from pointit.schemas.topics import MAP

LAP_S = 20.0
PERIOD_S = 0.04
LATENCY_S = 0.02
"""Delay from the camera's picture to the train's position, s: the age of that position."""


def train(strip: Strip, now_s: float) -> TrackedObject:
    """Return the train at the time `now_s`; a real tracker would ask its camera."""
    start = np.array(strip.line_m[0])
    way = np.array(strip.line_m[-1]) - start
    length_m = float(np.linalg.norm(way))

    # to and fro: a cosine of the time, and its derivative
    direction = way / length_m
    phase = math.tau * now_s / LAP_S
    share = 0.5 - 0.4 * math.cos(phase)  # of the way from the strip's start to its end
    speed_mps = 0.4 * length_m * math.tau / LAP_S * math.sin(phase)
    x_m, y_m, z_m = (start + share * way).tolist()
    x_mps, y_mps, z_mps = (direction * speed_mps).tolist()
    return TrackedObject(
        id="train",
        kind="red",
        position_m=(x_m, y_m, z_m),
        velocity_mps=(x_mps, y_mps, z_mps),
        length_m=0.4,
        surface="strip",  # without a surface it is selected in space, and no strip shows it
        surface_id=strip.id,
        surface_position_m=share * length_m,
        surface_speed_mps=speed_mps,
        position_sigma_m=0.01,
    )


async def track(site: pointit.Site) -> None:
    """Report the train 25 times a second, until cancelled: then it has left."""
    room = await anext(site.messages(MAP))
    with contextlib.closing(site.tracker("railway", latency_s=LATENCY_S, latency_sigma_s=0.005)) as tracker:
        while True:
            seen_s = site.now_ns() / 1e9 - LATENCY_S
            tracker.update([train(room.strips[0], seen_s)])
            await site.sleep(PERIOD_S)


async def main() -> None:
    """Join the site on this machine, such as that of `pointit run scenario_3`."""
    async with pointit.connect() as site:
        await track(site)


if __name__ == "__main__":
    asyncio.run(main())
