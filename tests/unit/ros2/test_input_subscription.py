"""Input from ROS above its rate: the newest wins, and reading does not block the loop."""

import asyncio
from typing import Any

import pytest

from pointit.bridges.ros2.inbound.person import people_in
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.types.types import Types
from pointit.schemas.topics import POSE, WRIST
from tests.support.bench import until
from tests.unit.ros2.graph_of_one import Bench
from tests.unit.ros2.scenes import jazzy, quaternion, transform

ROTATION = "/anna/metawear_ros/rotation"
QUATERNION = "geometry_msgs/msg/QuaternionStamped"
TF = "tf2_msgs/msg/TFMessage"
MOST = 64 * 1024


def frames(bridge: Bench, *people: str, x: float, size: int = 0) -> bytes:
    """Return a message of /tf that puts `people` at x, and other frames until it is `size` bytes long."""
    make = bridge.types.make

    def frame(child: str) -> Any:
        return transform("world", child, (x, 0.0, 0.0))

    ours = [frame(f"{user}/human_footprint") for user in people]
    count = max(size - len(bridge.types.encode(TF, make(TF, transforms=ours))), 0) // 104
    others = [frame(f"{index:016}") for index in range(count)]
    return bridge.types.encode(TF, make(TF, transforms=ours + others))


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list that gets the length of all that is decoded from now on."""
    lengths: list[int] = []
    decode = Types.decode

    def counted(types: Types, name: str, cdr: bytes, **settings: Any) -> Any:
        lengths.append(len(cdr))
        return decode(types, name, cdr, **settings)

    monkeypatch.setattr(Types, "decode", counted)
    return lengths


def placed(bridge: Bench, *people: str) -> dict[str, list[float]]:
    """Let people join; return their places, which grow."""
    seen: dict[str, list[float]] = {user: [] for user in people}
    for user in people:
        bridge.scene.person(user)
        bridge.inbox.join(user)
    bridge.other.subscribe(POSE, lambda message, name: seen[name].append(message.position_m[0]))
    return seen


async def test_of_what_a_stall_has_piled_up_the_newest_is_taken(bridge: Bench) -> None:
    bridge.inbox.join("anna")
    seen: list[float] = []
    bridge.other.subscribe(WRIST, lambda message, _name: seen.append(message.orientation_xyzw[2]))
    for count in range(21):
        z = count / 20
        turned = quaternion((0.0, 0.0, z, (1.0 - z * z) ** 0.5))
        bridge.say(ROTATION, QUATERNION, quaternion=turned)
    await until(lambda: bool(seen) and seen[-1] == 1.0)
    assert len(seen) == 2


async def test_who_leaves_is_not_moved_by_what_waits(bridge: Bench) -> None:
    bridge.inbox.join("anna")
    seen: list[str] = []
    bridge.other.subscribe(WRIST, lambda _message, name: seen.append(name))
    turned = quaternion((0.0, 0.0, 0.0, 1.0))
    for _ in range(3):
        bridge.say(ROTATION, QUATERNION, quaternion=turned)
    bridge.inbox.leave("anna")
    bridge.inbox.join("ben")
    for _ in range(3):
        bridge.say("/ben/metawear_ros/rotation", QUATERNION, quaternion=turned)
    await until(lambda: seen.count("ben") == 2)
    assert seen.count("anna") == 1


async def test_a_flood_of_tf_is_not_read_but_everybodys_newest_place_is(
    bridge: Bench, read: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = placed(bridge, "anna", "ben")
    flood = [frames(bridge, "anna", x=float(count), size=MOST - 200) for count in range(20)]
    assert all(MOST - 1000 < len(cdr) <= MOST for cdr in flood)
    loop = asyncio.get_running_loop()
    now_s = loop.time()
    with monkeypatch.context() as stopped:
        stopped.setattr(loop, "time", lambda: now_s)  # all come at once, however busy the machine
        for count in range(1000):
            bridge.backend.readers["/tf"](flood[count % 20])
            if count == 500:
                bridge.backend.readers["/tf"](frames(bridge, "ben", x=7.0))
    assert sum(read) <= 3 * MOST, "20 ms of the loop; all would be 6 s"
    (warning,) = bridge.warnings()
    assert "/tf brings more of people than the 1 MB a second that are read" in warning
    bridge.clock.advance(1.0)  # so that places are taken again
    await until(lambda: seen["anna"][-1:] == [19.0] and seen["ben"] == [7.0])
    assert sum(read) <= 5 * MOST


async def test_whose_name_only_ends_as_anothers_displaces_nothing_of_theirs(bridge: Bench) -> None:
    seen = placed(bridge, "anna", "joanna")
    flood = frames(bridge, "joanna", x=1.0, size=MOST - 200)
    for cdr in (flood, flood, frames(bridge, "anna", x=7.0), flood):
        bridge.backend.readers["/tf"](cdr)
    await until(lambda: seen["anna"] == [7.0] and bool(seen["joanna"]))


def test_people_are_found_in_either_order_of_bytes() -> None:
    scene = ConversionState(jazzy())
    for user in ("anna", "joanna", "ann"):
        scene.person(user)
    frame = b"joanna/human_footprint"
    for first, order in ((b"\0\1\0\0", "little"), (b"\0\0\0\0", "big")):
        cdr = first + (len(frame) + 1).to_bytes(4, order) + frame + b"\0"
        assert people_in(cdr, scene) == ("joanna",)


async def test_tf_that_tells_of_nobody_is_not_read(bridge: Bench, read: list[int]) -> None:
    seen = placed(bridge, "anna")
    robot = frames(bridge, x=1.0, size=MOST - 200)
    for _ in range(1000):
        bridge.backend.readers["/tf"](robot)
    assert not read
    bridge.backend.readers["/tf"](frames(bridge, "anna", x=3.0))
    await until(lambda: seen["anna"] == [3.0])
    assert not bridge.warnings()
