"""Health of the IMU bridge states whether a device of the person moves their arm."""

from typing import Literal

import pytest

from pointit.runtime.clock import WallClock
from pointit.schemas.system import OWN_SOURCE
from pointit.schemas.topics import HEALTH
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.service import ImuBridge
from tests.support.bench import memory_bench, until


@pytest.mark.parametrize(("source", "value"), [("page", 0.0), ("simulated", 1.0)])
async def test_health_states_whether_the_arm_has_its_own_source(
    source: Literal["page", "simulated"], value: float
) -> None:
    async with memory_bench(WallClock()) as bench:
        reports = bench.collect(HEALTH)
        bench.start(ImuBridge, ImuBridgeConfig(source=source), user="anna")

        await until(lambda: bool(reports))

        figures = [figure.value for figure in reports[0].figures if figure.name == OWN_SOURCE]
        assert figures == [value]
