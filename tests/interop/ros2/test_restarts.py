"""Router, bridge and peer are killed and come back in any order; strangers send bytes; all others live."""

import itertools
import random
import signal
import struct
import time
from collections.abc import AsyncGenerator, Iterator
from pathlib import Path

import pytest
import pytest_asyncio
import zenoh

from pointit.schemas import ConveyorState, UserPose
from pointit.schemas import topics as ours
from tests.integration.ros2.nodes import Graphs, Process, graphs
from tests.interop.ros2.peers import TYPES, Site, site
from tests.support.bench import until
from tests.support.commands import Command, Onlooker, onlooker
from tests.support.pace import Patience

BACK_S = 30.0
RAY = "/user1/pointing_ray"
POSE = "geometry_msgs/msg/PoseStamped"
PARTS = ("router", "bridge", "peer")
GARBAGE_MB = 10
HARASSED = (
    ("/belt_cmd", "conveyor_msgs/msg/BeltCommand"),
    ("/user1/metawear_ros/rotation", "geometry_msgs/msg/QuaternionStamped"),
)
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


@pytest_asyncio.fixture
async def strangers(place: Site) -> AsyncGenerator[Graphs]:
    async with graphs() as made:
        made.endpoint = place.ros
        yield made


def key(topic: str, name: str) -> str:
    kind = TYPES.kind(name)
    return f"7{topic}/{kind.dds_name}/{kind.hash}"


def nonsense(chance: random.Random) -> Iterator[tuple[bytes, bytes | None]]:
    """Yield payloads and attachments, in each of which something is wrong."""
    good = struct.pack("<qqB16s", 1, 0, 16, b"g" * 16)
    belt = TYPES.encode(
        "conveyor_msgs/msg/BeltCommand",
        TYPES.make("conveyor_msgs/msg/BeltCommand", name=["*"], velocity=[float("1")]),
    )
    yield from ((belt, None), (belt, b""), (belt, good[:-1]), (belt, good + b"\0"), (belt, bytes(5000)))
    yield from ((b"", good), (b"\0\1\0\0", good), (belt[:-2], good), (belt[:8] + b"\xff" * 4, good))
    yield bytes(GARBAGE_MB * 1_000_000), good
    for _ in range(100):
        sequence = struct.pack("<q", chance.getrandbits(62))
        damaged = bytearray(belt)
        damaged[chance.randrange(len(belt))] ^= 1 << chance.randrange(8)
        yield bytes(damaged[: chance.randrange(len(belt))]), sequence + good[8:]
        yield b"\0\1\0\0" + chance.randbytes(chance.randrange(80)), sequence + good[8:]


async def test_bytes_of_strangers_harm_nobody_and_are_named(parts: Parts, strangers: Graphs) -> None:
    for part in ("router", "bridge", "peer"):
        await parts.start(part)
    await parts.flows()
    stranger = await strangers.stranger()
    chance = random.Random(7)
    tokens = [
        stranger.liveliness().declare_token(f"@ros2_lv/7/{text}")
        for text in ("x", "1/0/0/NN/%/%", "1/0/1/MP/%/%/node/%x/no_type/1/qos", "z" * 6000, "%/" * 50 + "%")
    ]
    patience = Patience(BACK_S)
    while not _is_named(parts.look):
        assert not patience.is_over(), "health names what was dropped"
        for payload, attachment in nonsense(chance):
            for topic, kind in HARASSED:
                # Zenoh drops 10 MB, and what follows, where a link is slow, and then nobody can name them
                stranger.put(
                    key(topic, kind),
                    payload,
                    attachment=attachment,
                    congestion_control=zenoh.CongestionControl.BLOCK,
                )
        await parts.look.sees_more(parts.states, "the site to go on")
    await _requests(stranger)

    await parts.flows()
    assert parts.bridge is not None
    assert parts.bridge.is_running
    assert parts.place.dora.is_alive

    for token in tokens:
        token.undeclare()


def _is_named(look: Onlooker) -> bool:
    """Return True if the bridge's health names each kind of damage."""
    health = look.health.get("ros2")
    text = "" if health is None else str(health.warnings)
    return all(what in text for what in ("/belt_cmd", "attachment", "longer than"))


async def _requests(stranger: zenoh.Session) -> None:
    """Ask services nonsense; every request is answered."""
    for payload in (b"", b"\0\1\0\0", bytes(1000)):
        replies = list(
            stranger.get(key("/add_pack", "conveyor_msgs/srv/AddPack"), payload=payload, timeout=10.0)
        )
        assert len(replies) == 1
