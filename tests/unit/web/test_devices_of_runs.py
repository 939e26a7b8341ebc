"""Devices that the pages of two runs of one site store in the same file."""

import asyncio
from typing import Any, cast

import pytest

from pointit.bridges.web.devices import devices as module
from pointit.bridges.web.devices.devices import Devices
from pointit.bridges.web.devices.search import FoundDevices
from pointit.bridges.web.devices.wire import ConnectDevice, ConnectedDevice
from pointit.bridges.web.model.map_editor import MapEditor
from pointit.runtime.bus.service_bus import ServiceBus
from tests.support.bench import Bench, memory_bench


def devices_of_a_run(bench: Bench) -> Devices:
    devices = Devices(
        bus=ServiceBus(bench.bus, bench.clock, "web", "web"),
        maps=cast("MapEditor", None),
        address="tcp/127.0.0.1:1",
        run_output="",
        present=set,
        changed=lambda: None,
    )
    devices._found = find_wrists()
    return devices


async def never_end(*_: Any) -> str:
    await asyncio.Event().wait()
    return ""


def find_wrists() -> FoundDevices:
    wrists = [
        ConnectedDevice(
            kind="wrist", plugin="udp", address=f"4711{number}", name="new", label=f"wrist {number}"
        )
        for number in range(3)
    ]
    return FoundDevices(devices=tuple(wrists), uses=("", "", ""), problems=())


def wrist(number: int, user: str) -> ConnectDevice:
    return ConnectDevice(kind="wrist", plugin="udp", address=f"4711{number}", name=user)


async def test_devices_of_another_run_of_the_site_stay_stored(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "run_command", never_end)
    async with memory_bench() as bench:
        first, second, later = (devices_of_a_run(bench) for _ in range(3))
        runs = [asyncio.create_task(each.run()) for each in (first, second)]
        await asyncio.sleep(0)  # both have begun
        await first.connect(wrist(0, "anna"))
        await second.connect(wrist(1, "ben"))
        await first.connect(wrist(2, "carla"))
        await first.forget("wrist anna")
        runs.append(asyncio.create_task(later.run()))
        await asyncio.sleep(0)

        assert [line.name for line in later.lines()] == ["ben", "carla"]
        for run in runs:
            run.cancel()
        await asyncio.gather(*runs, return_exceptions=True)
