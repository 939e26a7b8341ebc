"""AGVs by VDA 5050: the virtual AGV of vda-5050-lib, on a genuine broker (mosquitto)."""

import asyncio
import contextlib
import dataclasses
import itertools
import json
import math
import subprocess
from collections.abc import AsyncGenerator
from pathlib import Path
from typing import Any

import aiomqtt
import pytest

from pointit.bridges.agv_tracker.config import AgvTrackerConfig
from pointit.bridges.agv_tracker.service import AgvTracker
from pointit.geometry.vector import Vec3
from pointit.runtime.clock import WallClock
from pointit.runtime.errors import RefusedError
from pointit.runtime.service.plugin_guard import Surroundings
from pointit.runtime.service.service import Launch, run_service
from pointit.schemas import RobotState, Steering, StopRobot
from pointit.schemas.environment import Frame
from pointit.schemas.topics import MAP, OBJECTS, STOP_ROBOT
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.drivers.vda5050 import VDA5050, find_agvs_on
from pointit.services.robot.robot_driver import (
    Follow,
    FollowPath,
    LinkLost,
    OrderStatus,
    ReportItem,
    RobotDriver,
    RobotReport,
)
from pointit.services.robot.service import Robot
from pointit.testing.trial import TrialHealth
from tests.examples.running import running
from tests.support.bench import memory_bench, until
from tests.support.buses import is_listening
from tests.support.environments import fetched
from tests.support.mqtt import overheard
from tests.unit.robot.flight import ROBOT, ROOM, Pilotage
from tests.unit.robot.vda5050 import agv_bench

pytestmark = pytest.mark.index  # npm fetches the peer

AGV = Path(__file__).with_name("vda5050_agv")
TOPICS = "uagv/v2/acme/7"
PATIENCE_S = 60.0
START = (1.0, 2.0)
SPEC = dataclasses.replace(agv_bench.SPEC, max_speed_mps=2.0)


@pytest.fixture(scope="module")
def node(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    folder = tmp_path_factory.mktemp("vda5050")
    return fetched(AGV, folder), folder / "agv.mjs"


class VirtualAgv:
    """An AGV of vda-5050-lib in a process of its own."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process

    def set(self, **state: object) -> None:
        """Change its state, by the names of the standard."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(state).encode() + b"\n")


@contextlib.asynccontextmanager
async def agv_on(
    port: int, node: tuple[str, Path], version: str = "2.0.0", speed: float = 2.0
) -> AsyncGenerator[VirtualAgv]:
    await until(lambda: is_listening(port), what="the broker")
    words = (node[0], str(node[1]), str(port), version, *map(str, START), str(speed))
    process = await asyncio.create_subprocess_exec(*words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    try:
        assert process.stdout is not None
        assert await process.stdout.readline() == b"ready\n"
        yield VirtualAgv(process)
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()


class Steered:
    """A driver, and what it has reported."""

    def __init__(self, driver: RobotDriver) -> None:
        self.driver = driver
        self.items: list[ReportItem] = []
        self._orders = 0

    def tell(self, kind: type[Any], *values: Any) -> int:
        self._orders += 1
        self.driver.command(kind(self._orders, *values))
        return self._orders

    @property
    def place(self) -> Vec3 | None:
        item = next((each for each in reversed(self.items) if not isinstance(each, OrderStatus)), None)
        return item.position_m if isinstance(item, RobotReport) else None

    def away_m(self, point: tuple[float, float]) -> float:
        return math.dist(self.place[:2], point) if self.place else math.inf

    def outcomes(self, order: int) -> list[tuple[str, str]]:
        return [(each.state, each.reason) for each in self.of(OrderStatus) if each.order == order]

    def of(self, kind: type[Any]) -> list[Any]:
        return [each for each in self.items if isinstance(each, kind)]

    @property
    def lost(self) -> list[str]:
        return [each.reason for each in self.of(LinkLost)]


@contextlib.asynccontextmanager
async def steering(port: int, **parameters: object) -> AsyncGenerator[Steered]:
    values = {"broker": f"127.0.0.1:{port}", "manufacturer": "acme", "serial_number": "7", **parameters}
    around = Surroundings(clock=WallClock(), health=TrialHealth(), folder=Surroundings.detached().folder)
    steered = Steered(VDA5050.make(VDA5050.config.model_validate(values), SPEC, around))
    async with running(steered.driver.run(steered.items.append)):
        yield steered


@pytest.mark.parametrize("version", ["1.1.0", "2.0.0"])
async def test_an_agv_drives_along_a_path_and_reports_it(
    port: int, node: tuple[str, Path], version: str
) -> None:
    async with agv_on(port, node, version), steering(port, version=version) as steered:
        await until(lambda: steered.away_m(START) < 0.01, PATIENCE_S, "a report")
        order = steered.tell(FollowPath, ((1.5, 2.0, 0.0), (1.5, 2.8, 0.0)))
        await until(lambda: ("done", "") in steered.outcomes(order), PATIENCE_S, "the end of the path")
        assert steered.outcomes(order) == [("accepted", ""), ("done", "")]
        assert steered.away_m((1.5, 2.8)) < 0.01
        places = [each.position_m for each in steered.of(RobotReport)]
        assert min(math.dist(place[:2], (1.5, 2.0)) for place in places) < 0.3, "it drove round the corner"


async def test_agv_comes_to_the_pointed_place_and_follows_a_path(port: int, node: tuple[str, Path]) -> None:
    agv = {"broker": f"127.0.0.1:{port}", "manufacturer": "acme", "serial_number": "7"}
    config = RobotConfig.model_validate(
        {"driver": "vda5050", "frame": "agvs", "vda5050": agv, "max_cursor_sigma_m": 1.0}
    )
    turned = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))  # x of its map is y of the room
    room = ROOM.model_copy(
        update={"frames": (Frame(id="agvs", position_m=(2.0, 0.0, 0.0), orientation_xyzw=turned),)}
    )
    async with agv_on(port, node, speed=1.0), memory_bench(WallClock()) as bench:
        pilotage = Pilotage(bench)
        bench.put(MAP, room)
        launch = Launch(service=Robot, config=config, name=ROBOT)
        async with running(run_service(launch, bench.bus, bench.clock)), running(pilotage.send_cursors()):
            await pilotage.until(lambda state: state.phase == "idle")
            assert pilotage.state.position_m == pytest.approx((0.0, 1.0, 0.0))
            pilotage.arrive("anna")
            pilotage.point("anna", (0.5, 2.0, 0.0))
            pilotage.steer("anna", Steering(stamp_ns=0, robot=ROBOT, mode="follow"))

            def is_there(state: RobotState) -> bool:
                return state.user == "anna" and math.dist(state.position_m, (0.5, 2.0, 0.0)) < 0.11

            await pilotage.until(is_there, PATIENCE_S)
            pilotage.steer("anna", Steering(stamp_ns=0, robot=ROBOT, mode="goals"))
            await pilotage.until(lambda state: state.phase == "idle", PATIENCE_S)
            pilotage.send("anna", (0.0, 2.5, 0.0), (0.5, 2.5, 0.0))

            def has_arrived(state: RobotState) -> bool:
                return state.phase == "idle" and math.dist(state.position_m, (0.0, 2.5, 0.0)) < 0.01

            await pilotage.until(has_arrived, PATIENCE_S)

            def is_shown_there() -> bool:  # the object has its own pace, which may be behind the state's
                return math.dist(pilotage.objects[-1].objects[0].position_m, (0.0, 2.5, 0.0)) < 0.01

            await until(is_shown_there, PATIENCE_S, "the object where the state is")


def message_of_another(number: int, **body: object) -> str:
    """Return a message of another master control."""
    header = {"headerId": number, "timestamp": "2026-01-01T00:00:00.00Z", "version": "2.0.0"}
    return json.dumps({**header, "manufacturer": "acme", "serialNumber": "7", **body})


def order_of_another(*points: tuple[float, float], released: int, update: int = 0) -> str:
    """Return an order of another master control along `points`, of which the first few are `released`."""
    nodes: list[dict[str, Any]] = [
        {
            "nodeId": f"theirs.{number}",
            "sequenceId": 2 * number,
            "released": number < released,
            "nodePosition": {"x": x, "y": y, "theta": 0.0, "mapId": "hall"},
            "actions": [],
        }
        for number, (x, y) in enumerate(points)
    ]
    edges: list[dict[str, Any]] = [
        {
            "edgeId": f"theirs.{end['nodeId']}",
            "sequenceId": 2 * number + 1,
            "released": end["released"],
            "startNodeId": start["nodeId"],
            "endNodeId": end["nodeId"],
            "actions": [],
        }
        for number, (start, end) in enumerate(itertools.pairwise(nodes))
    ]
    return message_of_another(1, orderId="theirs", orderUpdateId=update, nodes=nodes, edges=edges)


async def test_order_of_another_master_is_shown_and_left_alone(port: int, node: tuple[str, Path]) -> None:
    agv = {"broker": f"127.0.0.1:{port}", "manufacturer": "acme", "serial_number": "7"}
    config = RobotConfig.model_validate({"driver": "vda5050", "vda5050": agv})
    launch = Launch(service=Robot, config=config, name=ROBOT)
    end = (6.0, START[1])
    async with (
        overheard(port, f"{TOPICS}/instantActions", json.loads) as actions,
        overheard(port, f"{TOPICS}/state", json.loads) as states,
        agv_on(port, node, speed=0.5),
        aiomqtt.Client("127.0.0.1", port) as other,
        memory_bench(WallClock()) as bench,
    ):
        await until(lambda: bool(states), PATIENCE_S, "its first report, before which it may refuse orders")
        # it waits at the start until the rest is released, however long that takes here
        await other.publish(f"{TOPICS}/order", order_of_another(START, end, released=1), qos=1)
        await until(lambda: bool(states[-1][1]["nodeStates"]), PATIENCE_S, lambda: f"their order: {states}")

        pilotage = Pilotage(bench)
        async with running(run_service(launch, bench.bus, bench.clock)):
            shown = await pilotage.until(lambda state: "another master control" in state.reason)
            assert shown.user == ""
            with pytest.raises(RefusedError, match="another master control"):
                await bench.bus.call(STOP_ROBOT, StopRobot(), ROBOT)

            await other.publish(f"{TOPICS}/order", order_of_another(START, end, released=2, update=1), qos=1)
            shown = await pilotage.until(lambda state: state.phase == "moving", PATIENCE_S)
            assert shown.user == ""
            # the monitor of standstill, and the end of PointIt, have cancelled it before
            await pilotage.until(lambda state: state.position_m[0] > START[0] + 3.5, PATIENCE_S)
        async with running(run_service(launch, bench.bus, bench.clock)):
            await pilotage.until(lambda state: state.phase == "idle" and not state.reason, PATIENCE_S)

        assert states[-1][1]["orderId"] == "theirs"
        assert states[-1][1]["lastNodeId"] == "theirs.1", "it has arrived"
        kinds = {each["actionType"] for _, heard in actions for each in heard["actions"]}
        assert kinds == {"stateRequest"}


async def test_agv_refuses_with_a_reason_when_off_or_manual(port: int, node: tuple[str, Path]) -> None:
    async with steering(port) as steered:
        await until(
            lambda: "no AGV reports at uagv/v2/acme/7/state" in str(steered.lost), PATIENCE_S, "nobody"
        )
        async with agv_on(port, node) as agv:
            await until(lambda: steered.place is not None, PATIENCE_S, "a report")
            assert [each.label for each in await find_agvs_on("127.0.0.1", port, 2.0)] == [
                "acme 7: AGV of VDA 5050 2, ONLINE"
            ]
            agv.set(operatingMode="MANUAL")

            def refused() -> bool:
                steered.tell(Follow, (9.0, 2.0, 0.0))
                return any("is in mode MANUAL" in each.reason for each in steered.of(OrderStatus))

            await until(refused, PATIENCE_S, "a refusal")
        await until(lambda: "(CONNECTIONBROKEN)" in str(steered.lost), PATIENCE_S, "the last will")


async def test_an_agv_that_others_steer_is_a_tracked_object(port: int, node: tuple[str, Path]) -> None:
    config = AgvTrackerConfig.model_validate({"broker": f"127.0.0.1:{port}", "frame": "agvs"})
    frame = Frame(id="agvs", position_m=(2.0, 0.0, 0.0))
    async with agv_on(port, node, speed=0.5), memory_bench(WallClock()) as bench:
        seen = bench.collect(OBJECTS, "agvs")
        bench.put(MAP, ROOM.model_copy(update={"frames": (frame,)}))
        launch = Launch(service=AgvTracker, config=config)
        async with running(run_service(launch, bench.bus, bench.clock)), steering(port) as steered:
            await until(lambda: bool(seen) and bool(seen[-1].objects), PATIENCE_S, "the AGV")
            assert seen[-1].objects[0].id == "acme-7"
            assert seen[-1].objects[0].position_m == pytest.approx((3.0, 2.0, 0.0))
            await until(lambda: steered.place is not None, PATIENCE_S, "a report")
            steered.tell(FollowPath, ((9.0, 2.0, 0.0),))
            await until(lambda: seen[-1].objects[0].velocity_mps[0] > 0.4, PATIENCE_S, "its motion")
            await until(lambda: seen[-1].objects[0].position_m[0] > 3.3, PATIENCE_S, "its way")


PREFIX = "/plant/uagv/2.0"
"""Topics of an AGV that keeps VDA 5050 only partly, as a client of Go writes them."""
