"""An AGV that keeps VDA 5050 only partly, at a genuine broker (mosquitto): written as by a client of Go."""

import asyncio
import itertools
import json
from typing import Any

import aiomqtt

from pointit.bridges.agv_tracker.config import AgvTrackerConfig
from pointit.bridges.agv_tracker.service import AgvTracker
from pointit.runtime.clock import WallClock
from pointit.runtime.service.service import Launch, run_service
from pointit.schemas.topics import OBJECTS
from pointit.services.robot.drivers.vda5050 import find_agvs_on
from tests.devices.test_vda5050 import PATIENCE_S, steering
from tests.examples.running import running
from tests.support.bench import memory_bench, until
from tests.support.buses import is_listening

PREFIX = "/plant/uagv/2.0"


async def test_an_agv_with_other_topics_and_null_fields_is_shown_and_connected(port: int) -> None:
    nothing = ("nodeStates", "edgeStates", "actionStates", "errors", "information", "loads", "velocity")
    where = {"theta": 0.0, "mapId": "hall", "positionInitialized": True, "deviationRange": -1}
    state: dict[str, Any] = {
        **dict.fromkeys(nothing),
        "headerId": 0,
        "version": "2.0",
        "manufacturer": "acme",
        "serialNumber": "7",
        "orderId": "",
        "driving": True,
        "operatingMode": "automatic",
        "safetyState": {"eStop": "none"},
        "batteryState": {"batteryCharge": -1, "charging": False},
    }

    async def report(client: aiomqtt.Client) -> None:
        for step in itertools.count():
            position = {"x": 0.1 * step, "y": 1.0, **where}
            message = json.dumps({**state, "agvPosition": position})
            await client.publish(f"{PREFIX}/acme/7/state", message)
            await asyncio.sleep(0.1)

    await until(lambda: is_listening(port), what="the broker")
    launch = Launch(
        service=AgvTracker, config=AgvTrackerConfig(broker=f"127.0.0.1:{port}", topic_prefix=PREFIX)
    )
    async with (
        aiomqtt.Client("127.0.0.1", port) as client,
        memory_bench(WallClock()) as bench,
        running(report(client)),
        running(run_service(launch, bench.bus, bench.clock)),
        steering(port, topic_prefix=PREFIX) as steered,
    ):
        seen = bench.collect(OBJECTS, "agvs")
        assert not await find_agvs_on("127.0.0.1", port, 1.0), "its topics are not those of the standard"
        await until(lambda: bool(seen) and seen[-1].objects[0].position_m[0] > 1.5, PATIENCE_S, "its way")
        await until(lambda: steered.place is not None and steered.place[0] > 1.5, PATIENCE_S, "its reports")
