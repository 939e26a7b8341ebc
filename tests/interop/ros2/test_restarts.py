# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# (the stubs of zenoh leave return types out)
"""Router, bridge and peer are killed and come back in any order; all others live."""

import itertools
import signal
import time
from collections.abc import AsyncGenerator, Iterator
from pathlib import Path

import pytest
import pytest_asyncio

from pointit.schemas import ConveyorState, UserPose
from pointit.schemas import topics as ours
from tests.integration.ros2.nodes import Process
from tests.interop.ros2.peers import Site, site
from tests.support.bench import until
from tests.support.commands import Command, Onlooker, onlooker
from tests.support.pace import Patience

pytestmark = pytest.mark.timeout(600)  # .venv-peers may have to be made

BACK_S = 30.0
RAY = "/user1/pointing_ray"
POSE = "geometry_msgs/msg/PoseStamped"
PARTS = ("router", "bridge", "peer")
PLACE_M = (0.5, -0.25, 0.0)
STANDS = {
    "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "world"},
    "child_frame_id": "user2/human_footprint",
    "transform": {
        "translation": dict(zip("xyz", PLACE_M, strict=True)),
        "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
    },
}
speeds = itertools.count(1)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory, peers_python: Path) -> Iterator[Site]:
    """Run a site without its bridge."""
    with site(tmp_path_factory.mktemp("site"), peers_python) as made:
        made.run()
        yield made


class Parts:
    """The three that come and go."""

    def __init__(self, place: Site, look: Onlooker) -> None:
        self.place = place
        self.look = look
        self.states: list[ConveyorState] = []
        look.bus.subscribe(ours.CONVEYOR_STATE, lambda message, _: self.states.append(message))
        self._router = Process("router", place.ros)
        self.bridge: Command | None = None

    async def start(self, part: str) -> None:
        if part == "router":
            await self._router.start()
        elif part == "bridge":
            self.bridge = self.place.bridge("peer")
        else:
            self.place.dora.start()
            await self.place.dora.do("listen", topic=RAY, type=POSE, depth=100)
            await self.place.dora.advertises("/belt_cmd", "conveyor_msgs/msg/BeltCommand")
            await self.place.dora.advertises("/tf_static", "tf2_msgs/msg/TFMessage", latched=True, depth=1)

    def kill(self, part: str) -> None:
        if part == "router":
            self._router.kill()
        elif part == "peer":
            self.place.dora.kill()
        elif self.bridge is not None:
            self.bridge.process.send_signal(signal.SIGKILL)
            self.bridge.process.wait(10)

    def end(self) -> None:
        for part in PARTS:
            self.kill(part)

    async def knows_place(self) -> None:
        """Wait until user2 stands where the peer has said."""
        poses: list[UserPose] = []
        self.look.bus.subscribe(ours.POSE, lambda pose, _: poses.append(pose), "user2")
        await until(lambda: any(each.position_m == PLACE_M for each in poses), BACK_S, "user2 at the place")

    async def flows(self) -> None:
        """Wait until both hear each other from now on: rays out, belts' speeds in."""
        dora = self.place.dora
        now = time.time()
        await dora.hears(RAY, lambda value: value["header"]["stamp"]["sec"] > now)
        speed_mps = next(speeds) / 128.0
        patience = Patience(BACK_S)
        while not any(each.speed_mps == speed_mps for each in self.states):
            assert not patience.is_over(), "what the peer says arrives"
            await dora.says("/belt_cmd", {"name": ["*"], "velocity": [speed_mps]})
            await self.look.sees_more(self.states, "the conveyor's state")


@pytest_asyncio.fixture
async def parts(place: Site) -> AsyncGenerator[Parts]:
    async with onlooker(place.ours) as look:
        await look.hears("conveyor-sim")
        made = Parts(place, look)
        try:
            yield made
        finally:
            made.end()


async def test_each_part_may_be_killed_and_come_back(parts: Parts) -> None:
    for part in ("bridge", "router", "peer"):  # the bridge does not wait for a router
        await parts.start(part)
    await parts.flows()
    for part in PARTS:
        parts.kill(part)
        if part == "bridge":
            await parts.place.dora.sees("/NN/", "/pointit", gone=True)
            await parts.look.sees_more(parts.states, "the site to go on")
            assert parts.place.dora.is_alive
            await parts.place.dora.says("/tf_static", {"transforms": [STANDS]})
        await parts.start(part)
        await parts.flows()
        if part == "bridge":  # which was not there when that was said, once
            await parts.knows_place()


@pytest.mark.long
@pytest.mark.parametrize("order", list(itertools.permutations(PARTS)), ids="-".join)
async def test_parts_may_start_and_end_in_any_order(parts: Parts, order: tuple[str, ...]) -> None:
    starting = [part for part in order if part != "peer"]  # a client of Zenoh's waits for its router
    for part in starting:
        await parts.start(part)
    await parts.start("peer")
    await parts.flows()
    for part in order:
        parts.kill(part)
    for part in (*(each for each in order if each != "peer"), "peer"):
        await parts.start(part)
    await parts.flows()
