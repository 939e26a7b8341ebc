"""Shared bridges at a router with rules: under the identity `services`, and under one of their own."""

import asyncio
import contextlib
from pathlib import Path
from typing import Any

import pytest

from pointit.bridges.agv_tracker.config import AgvTrackerConfig
from pointit.bridges.agv_tracker.service import AgvTracker
from pointit.bridges.foxglove.config import FoxgloveConfig
from pointit.bridges.foxglove.service import Foxglove
from pointit.runtime.clock import WallClock
from pointit.runtime.service.service import Launch, run_service
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Health, topics
from tests.integration.access.secured import link_of, make_site, routed
from tests.support.bench import until
from tests.support.buses import free_port


@pytest.mark.parametrize(
    ("service", "identity"),
    [(service, name) for service in (Foxglove, AgvTracker) for name in ("services", service.NAME)],
)
async def test_bridge_reports_and_is_present_under_the_services_identity_and_under_its_own(
    service: Any, identity: str, tmp_path: Path
) -> None:
    configs = {
        "foxglove": FoxgloveConfig(port=0),
        "agv-tracker": AgvTrackerConfig(broker=f"127.0.0.1:{free_port()}"),
    }
    folder = make_site(
        tmp_path / "lab",
        names={
            "services": "services",
            service.NAME: "service",
            "operator": "operator",
            "supervisor": "supervisor",
        },
    )
    health: dict[str, Health] = {}
    present: set[str] = set()
    async with contextlib.AsyncExitStack() as stack:
        stack.enter_context(routed(folder))
        buses: dict[str, ZenohBus] = {}
        for name in (identity, "operator"):
            buses[name] = await ZenohBus.open(link_of(folder, name), patience_s=30)
            stack.push_async_callback(buses[name].close)
        operator = buses["operator"]
        operator.subscribe(topics.HEALTH, lambda message, name: health.__setitem__(name, message))
        operator.watch(
            topics.SERVICE_ALIVE, lambda name, there: (present.add if there else present.discard)(name)
        )
        launch = Launch(service=service, config=configs[service.NAME])
        running = asyncio.create_task(run_service(launch, buses[identity], WallClock()))
        refused = f"{identity} may not "
        try:
            await until(lambda: {service.NAME} <= health.keys() & present, what="its health and presence")
            await until(lambda: not any(refused in each for each in health[service.NAME].warnings))
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)
