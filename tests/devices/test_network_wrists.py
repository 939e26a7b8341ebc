"""SlimeVR trackers, played by the emulation of SlimeVR's makers, and apps that send datagrams."""

import asyncio
import json
import subprocess
from collections.abc import AsyncGenerator, Sequence
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from pointit.geometry.rotation import Quaternion
from pointit.plugins import Battery, FoundDevice, Press, Reading, Reconnected, Signal
from pointit.runtime.errors import ConfigError
from pointit.services.imu_bridge.network.slimevr import SLIMEVR, discover
from pointit.services.imu_bridge.network.slimevr_protocol import PORT
from tests.devices.red_segments import first_selected
from tests.support.bench import until
from tests.support.buses import free_udp_port
from tests.support.environments import fetched
from tests.support.pace import Patience
from tests.support.running_source import running

pytestmark = pytest.mark.index  # npm fetches the peer

TRACKER = Path(__file__).with_name("slimevr_tracker")
MAC = "A4:E5:7C:B6:01:02"
POSTURE: Quaternion = (0.5, -0.5, 0.5, -0.5)


@pytest.fixture(scope="module")
def node(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """Return the command of an emulated tracker."""
    folder = tmp_path_factory.mktemp("slimevr")
    return fetched(TRACKER, folder), f"{folder / 'tracker.mjs'}"


class EmulatedTracker:
    """A tracker in a process of its own."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process
        self.events: list[tuple[str, list[Any]]] = []

    def tell(self, **order: Any) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(order).encode() + b"\n")

    def turn(self, orientation_xyzw: Quaternion) -> None:
        self.tell(rotation=orientation_xyzw)

    def named(self, name: str) -> list[list[Any]]:
        return [values for event, values in self.events if event == name]

    async def listen(self) -> None:
        assert self._process.stdout is not None
        async for line in self._process.stdout:
            told = json.loads(line)
            self.events.append((told["event"], told["values"]))


@asynccontextmanager
async def tracker(
    node: tuple[str, str], port: int, *, mac: str = MAC, host: str = "127.0.0.1"
) -> AsyncGenerator[EmulatedTracker]:
    """Run an emulated tracker, which looks for a server at a port."""
    process = await asyncio.create_subprocess_exec(
        *node, host, f"{port}", mac, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    found = EmulatedTracker(process)
    listening = asyncio.create_task(found.listen())
    try:
        yield found
    finally:
        process.kill()
        await process.wait()
        await listening


async def test_tracker_connects_and_everything_it_sends_arrives(node: tuple[str, str]) -> None:
    port = free_udp_port()
    async with running(SLIMEVR, port=port, tracker=MAC) as wrist, tracker(node, port) as emulated:
        emulated.turn(POSTURE)
        await until(lambda: len(wrist.of(Reading)) >= 50)
        emulated.tell(battery=[3.875, 75], signal=-60)
        emulated.tell(action=2)
        emulated.tell(action=3)
        await until(lambda: len(wrist.of(Press)) == 2)
        assert [each.gesture for each in wrist.of(Press)] == ["double", "press"]
        assert wrist.of(Battery)[-1] == Battery(0.75, 3.875)
        await until(lambda: wrist.of(Signal) == [Signal(-60.0)])
        assert wrist.items[0] == Reconnected()
        assert {each.world_from_sensor for each in wrist.of(Reading)} == {POSTURE}  # none of the other sensor
        # heartbeat, ping, sensor info and feature flags are understood; no flag is advertised
        await until(lambda: {kind for (kind,) in emulated.named("packet")} >= {1, 10, 15, 22})
        assert emulated.named("server-feature-flags") == [[[]]]
        assert (
            not emulated.named("unknown")
            + emulated.named("error")
            + emulated.named("disconnected-from-server")
        )


async def test_second_sensor_of_a_tracker_is_chosen_by_its_number(node: tuple[str, str]) -> None:
    port = free_udp_port()
    async with running(SLIMEVR, port=port, sensor=1) as wrist, tracker(node, port) as emulated:
        emulated.turn(POSTURE)
        await until(lambda: len(wrist.of(Reading)) >= 5)
        assert {each.world_from_sensor for each in wrist.of(Reading)} == {(0.0, 0.0, 1.0, 0.0)}


async def test_trackers_that_call_are_found(node: tuple[str, str]) -> None:
    trackers: Sequence[FoundDevice] = ()
    patience = Patience(30.0)
    async with tracker(node, PORT, host="127.255.255.255"):
        while not trackers:
            assert not patience.is_over(), "no tracker was found"
            with suppress(ConfigError):  # the tests of the kit take this port for a moment
                trackers = await discover(1.5)  # it calls each second
            await asyncio.sleep(0.1)
    (found,) = trackers
    assert found.address == MAC
    assert found.label.startswith(f"{MAC} (emulated at 127.0.0.1)")
    assert found.details["firmware"] == "emulated"


async def test_person_with_a_tracker_selects_a_red_scenario_3_segment(node: tuple[str, str]) -> None:
    port = free_udp_port()
    async with tracker(node, port) as emulated:
        event = await first_selected(f"slimevr:{MAC}", {"imu-bridge.slimevr.port": port}, emulated.turn)
    assert event.user == "user1"
