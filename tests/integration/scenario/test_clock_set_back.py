"""Wrist and ray when the machine's clock is set back: services of one machine agree on the time."""

import asyncio

import pytest

from pointit.schemas.topics import HEALTH, RAY
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.service import ImuBridge
from pointit.services.pointing.service import Pointing
from tests.support.bench import ManualClock, memory_bench, until

STEP_S = 0.02


@pytest.mark.parametrize("back_s", [5.0, 3600.0])
async def test_rays_continue_within_three_seconds_of_a_clock_set_back(back_s: float) -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        rays = bench.collect(RAY, "anna")
        health = bench.collect(HEALTH)
        config = ImuBridgeConfig.model_validate({"simulated": {"rate_hz": 500}})
        bench.start(ImuBridge, config, user="anna")
        bench.start(Pointing, user="anna")

        async def go_on(most_s: float) -> None:
            """Let time pass until there are 20 more rays."""
            wanted = len(rays) + 20
            passed_s = 0.0
            while len(rays) < wanted:
                assert passed_s < most_s, [report.warnings for report in health[-2:]]
                clock.advance(STEP_S)
                passed_s += STEP_S
                await asyncio.sleep(0.003)

        await until(lambda: len(health) >= 2, what="both services")
        await go_on(30.0)  # the wait for a profile included
        before_ns = clock.now_ns()
        clock.advance(-back_s)
        if back_s > 10.0:  # the restart waits for the next report, in wall time
            count = len(health)
            await until(lambda: len(health) >= count + 4, what="the restart")
        await go_on(3.0)
        assert clock.now_ns() < before_ns
