"""Input from ROS by a table like the real one, and above its rate."""

import asyncio
import math
import struct
from typing import Any

import pytest

from pointit.bridges.ros2.inbound.person import people_in
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.inbox import MAX_ASKED
from pointit.bridges.ros2.routing.routes import routes
from pointit.bridges.ros2.types.types import Types
from pointit.runtime.errors import RefusedError
from pointit.schemas import AddPackage, AddPackageReply, Done, Environment, SetFeeding, SetSpeed, topics
from pointit.schemas.environment import Belt
from pointit.schemas.topics import POSE, WRIST
from tests.support.bench import START_NS, until
from tests.unit.ros2.graph_of_one import Bench
from tests.unit.ros2.scenes import jazzy, quaternion, transform

ROTATION = "/anna/metawear_ros/rotation"
QUATERNION = "geometry_msgs/msg/QuaternionStamped"
ADD_PACK = "conveyor_msgs/srv/AddPack"
BELT_COMMAND = "conveyor_msgs/msg/BeltCommand"


def room(*belts: str) -> Environment:
    line_m = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    lanes = tuple(Belt(id=each, line_m=line_m) for each in belts or ("a",))
    return Environment(stamp_ns=START_NS, seq=1, name="room", belts=lanes)


class Belts:
    """Our conveyor: keeps the commands it got, refuses those that `refused` names, waits for `go_on`."""

    def __init__(self, bridge: Bench, *belts: str) -> None:
        bridge.scene.take("", room(*belts), bridge.clock.now_ns())
        self._bridge = bridge
        self.got: list[SetSpeed] = []
        self.refused: tuple[str, ...] | float = ()
        self.go_on = asyncio.Event()

    def serve(self) -> None:
        self._bridge.other.serve(topics.SET_SPEED, self._serve)

    def told(self, *names: str, mps: tuple[float, ...] = (0.5,)) -> None:
        self._bridge.say("/belt_cmd", BELT_COMMAND, name=[*names], velocity=[*mps])

    async def _serve(self, query: SetSpeed, _name: str) -> Done:
        self.got.append(query)
        if self.refused in (query.belts or None, query.speed_mps):
            raise RefusedError("it is locked")
        await self.go_on.wait()
        return Done()


def turned(bridge: Bench, w: float = 1.0) -> dict[str, Any]:
    return {"quaternion": bridge.types.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=w)}


async def ask(bridge: Bench, service: str, kind: str, /, **fields: Any) -> Any:
    request = bridge.types.request_of(kind)
    cdr = await bridge.backend.servers[service](
        bridge.types.encode(request, bridge.types.make(request, **fields))
    )
    return bridge.types.decode(bridge.types.response_of(kind), cdr)


async def test_bad_values_are_reported_until_good_ones_or_departure(bridge: Bench) -> None:
    def takes(w: float) -> bool:
        bridge.say(ROTATION, QUATERNION, **turned(bridge, w))
        return True

    bridge.inbox.join("anna")
    bridge.backend.readers[ROTATION](b"\x00\x01\x00\x00short")
    assert any(ROTATION in warning for warning in bridge.warnings())
    bridge.clock.advance(1.0)
    await until(lambda: takes(0.0) and any("norm" in each for each in bridge.warnings()))
    await until(lambda: takes(1.0) and not bridge.warnings())
    await until(lambda: takes(0.0) and bool(bridge.warnings()))
    bridge.inbox.leave("anna")
    assert not bridge.warnings()


TOO_LONG = [("/tf", 64 * 1024), ("/tf_static", 64 * 1024), (ROTATION, 16 * 1024)]


@pytest.mark.parametrize(("ros", "most"), TOO_LONG)
async def test_too_long_message_is_dropped_and_reported(bridge: Bench, ros: str, most: int) -> None:
    bridge.inbox.join("anna")
    kind = QUATERNION if ros == ROTATION else "tf2_msgs/msg/TFMessage"
    fields = turned(bridge) if ros == ROTATION else {}
    cdr = bridge.types.encode(kind, bridge.types.make(kind, **fields))  # what follows it is padding
    bridge.backend.readers[ros](cdr.ljust(most, b"\0"))
    assert not bridge.warnings()

    def longer() -> bool:
        bridge.backend.readers[ros](cdr.ljust(most + 1, b"\0"))
        return bool(bridge.warnings())

    await until(longer)
    [warning] = bridge.warnings()
    assert f"{most + 1} bytes, at most {most} are read" in warning


async def test_refusal_is_reported_until_a_later_command_succeeds(bridge: Bench) -> None:
    belts = Belts(bridge)
    belts.told("*")
    await until(lambda: bool(bridge.warnings()), what="to be told that no node serves it")
    for _ in range(5):
        belts.told("*")
        assert bridge.warnings(), "it is not answered yet"
        await asyncio.sleep(0)
    belts.serve()
    belts.told("*")
    await until(lambda: bool(belts.got))
    assert bridge.warnings()
    belts.go_on.set()
    await until(lambda: not bridge.warnings())


@pytest.mark.parametrize("bad", ["b", "none"])
async def test_success_of_one_belt_keeps_the_refusal_of_another(bridge: Bench, bad: str) -> None:
    """In one command: belt b refuses, or there is no such belt, and belt a does it later."""
    belts = Belts(bridge, "a", "b")
    belts.serve()
    belts.refused = ("b",)
    belts.told("a", bad, mps=(0.25, 0.5))
    await until(lambda: bool(bridge.warnings()) and any(each.belts == ("a",) for each in belts.got))
    belts.go_on.set()
    await until(lambda: not bridge.inbox._asked)
    assert any(("it is locked" if bad == "b" else "no belt 'none'") in each for each in bridge.warnings())


async def test_excess_commands_are_dropped_and_reported(bridge: Bench) -> None:
    names = [f"b{number}" for number in range(MAX_ASKED + 6)]
    belts = Belts(bridge, *names)
    belts.serve()
    belts.told(*names, mps=tuple(0.01 * (number + 1) for number in range(len(names))))
    belts.told("*")
    await until(lambda: len(belts.got) == MAX_ASKED)
    belts.go_on.set()
    await until(lambda: not bridge.inbox._asked)
    assert len(belts.got) == MAX_ASKED
    assert any(f"{MAX_ASKED} wishes are open already" in each for each in bridge.warnings())
    belts.told("*")
    await until(lambda: not bridge.warnings(), what="there to be room again")


async def test_newest_feed_command_wins_when_they_flood(bridge: Bench) -> None:
    asked: list[bool] = []

    async def serve(query: SetFeeding, _name: str) -> Done:
        asked.append(query.feeding)
        return Done()

    bridge.other.serve(topics.SET_FEEDING, serve)
    for count in range(2 * MAX_ASKED):
        bridge.say("/feed", "std_msgs/msg/Bool", data=count % 2 == 1)
    bridge.say("/feed", "std_msgs/msg/Bool", data=False)
    bridge.say("/feed", "std_msgs/msg/Bool", data=True)
    await until(lambda: len(asked) > 1 and asked[-1] and not bridge.inbox._asked)
    assert len(asked) == 2
    assert not bridge.warnings()


async def test_a_service_is_answered_by_ours(bridge: Bench) -> None:
    bridge.scene.take("", room(), bridge.clock.now_ns())

    async def serve(query: AddPackage, _name: str) -> AddPackageReply:
        assert query.lane == "a"
        return AddPackageReply(object_id="package9")

    assert (await ask(bridge, "/add_pack", ADD_PACK, uid=4, kind=1)).result is False, "no node serves it"
    served = bridge.other.serve(topics.ADD_PACKAGE, serve)
    assert (await ask(bridge, "/add_pack", ADD_PACK, uid=4, kind=1)).result is True
    assert (await ask(bridge, "/add_pack", ADD_PACK, uid=5, kind=1, belt=3)).result is False
    assert any("there is no belt 3" in each for each in bridge.warnings())
    served.close()


@pytest.mark.parametrize("speed_mps", [math.nan, math.inf, 6.0])
async def test_an_invalid_request_gets_a_sentence(bridge: Bench, speed_mps: float) -> None:
    with pytest.raises(RefusedError, match=r"set_belt_speed: a speed of \w+ m/s was asked for: send one"):
        await bridge.backend.servers["/set_belt_speed"](b"\0\1\0\0" + struct.pack("<f", speed_mps))
    assert any("a speed of" in each for each in bridge.warnings())


WITHOUT_RESULT: dict[str, tuple[str, topics.Request[Any, Any]]] = {
    "/set_belt_speed": ("conveyor_msgs/srv/SetBeltSpeed", topics.SET_SPEED),
    "/reset_pack_sim": ("std_srvs/srv/Empty", topics.RESET_CONVEYOR),
    "/anna/metawear_ros/set_yaw_origin": ("std_srvs/srv/Empty", topics.SET_YAW_ORIGIN),
    "/set_brightness": ("led_strip_msgs/srv/SetBrightness", topics.SET_BRIGHTNESS),
}


def test_these_are_all_services_whose_response_cannot_refuse() -> None:
    rows = [route.ros.replace("{user}", "anna") for route in routes().served if not route.has_result]
    assert rows == list(WITHOUT_RESULT)


@pytest.mark.parametrize("service", WITHOUT_RESULT)
async def test_request_that_was_not_done_is_an_error(bridge: Bench, service: str) -> None:
    kind, ours = WITHOUT_RESULT[service]
    is_locked = True

    async def serve(_query: Any, _name: str) -> Done:
        if is_locked:
            raise RefusedError("it is locked")
        return Done()

    bridge.inbox.join("anna")
    with pytest.raises(RefusedError, match=f"from {service} was refused: "):
        await bridge.backend.servers[service](b"\x00\x01")
    with pytest.raises(RefusedError, match=f"from {service} was not done: "):
        await ask(bridge, service, kind)  # no node serves it
    bridge.other.serve(ours, serve)
    with pytest.raises(RefusedError, match=f"from {service} was not done: .*it is locked"):
        await ask(bridge, service, kind)
    assert any("it is locked" in each for each in bridge.warnings())
    is_locked = False
    await ask(bridge, service, kind)
    assert not bridge.warnings()


async def test_invalid_and_too_long_requests_are_answered(bridge: Bench) -> None:
    name = bridge.types.request_of(ADD_PACK)
    long = bridge.types.encode(name, bridge.types.make(name)).ljust(16 * 1024 + 1, b"\0")
    for cdr, told in ((b"\x00\x01\x00\x00", "/add_pack"), (long, "at most 16384 are read")):
        answer = await bridge.backend.servers["/add_pack"](cdr)
        assert bridge.types.decode(bridge.types.response_of(ADD_PACK), answer).result is False
        assert any(told in each for each in bridge.warnings())


async def test_services_of_others_are_left_to_them(bridge: Bench) -> None:
    bridge.look(("server", "/add_pack"))
    assert "/add_pack" not in bridge.backend.servers
    assert "/set_belt_speed" in bridge.backend.servers
    bridge.look()
    assert "/add_pack" not in bridge.backend.servers, "they may be back at once"
    bridge.look(("server", "/add_pack"))
    bridge.look()
    await until(lambda: "/add_pack" in bridge.backend.servers)


async def test_a_request_that_is_dropped_holds_no_number(bridge: Bench) -> None:
    bridge.scene.take("", room(), bridge.clock.now_ns())
    asked = asyncio.Event()

    async def serve(_query: AddPackage, _name: str) -> AddPackageReply:
        asked.set()
        await asyncio.Event().wait()
        raise AssertionError

    bridge.other.serve(topics.ADD_PACKAGE, serve)
    asking = asyncio.create_task(ask(bridge, "/add_pack", ADD_PACK, uid=4, kind=1))
    await asked.wait()
    assert not bridge.scene.uids.is_settled("package1"), "it may be the one that was asked for"
    asking.cancel()
    await asyncio.wait([asking])
    assert bridge.scene.uids.is_settled("package1")


async def test_button_is_reset_when_its_user_leaves(bridge: Bench) -> None:
    button = "/anna/metawear_ros/button"
    down = "std_msgs/msg/Bool"
    seen: list[int] = []
    bridge.other.subscribe(topics.BUTTON, lambda message, _name: seen.append(message.seq))
    for presses in (1, 2):
        bridge.inbox.join("anna")
        bridge.say(button, down, data=True)
        bridge.say(button, down, data=True)
        await until(lambda count=presses: len(seen) == count)
        bridge.inbox.leave("anna")
    assert seen == [1, 2]


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


async def test_newest_message_is_processed_after_a_stall(bridge: Bench) -> None:
    bridge.inbox.join("anna")
    seen: list[float] = []
    bridge.other.subscribe(WRIST, lambda message, _name: seen.append(message.orientation_xyzw[2]))
    for count in range(21):
        z = count / 20
        turned = quaternion((0.0, 0.0, z, (1.0 - z * z) ** 0.5))
        bridge.say(ROTATION, QUATERNION, quaternion=turned)
    await until(lambda: bool(seen) and seen[-1] == 1.0)
    assert len(seen) == 2


async def test_waiting_pose_is_dropped_when_its_person_leaves(bridge: Bench) -> None:
    assert ROTATION not in bridge.backend.readers, "nobody has joined"
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


async def test_newest_pose_of_each_person_is_read_when_tf_floods(
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


def test_people_are_found_in_either_order_of_bytes() -> None:
    scene = ConversionState(jazzy())
    for user in ("anna", "joanna", "ann"):
        scene.person(user)
    frame = b"joanna/human_footprint"
    for first, order in ((b"\0\1\0\0", "little"), (b"\0\0\0\0", "big")):
        cdr = first + (len(frame) + 1).to_bytes(4, order) + frame + b"\0"
        assert people_in(cdr, scene) == ("joanna",)


async def test_tf_without_people_is_not_decoded(bridge: Bench, read: list[int]) -> None:
    seen = placed(bridge, "anna")
    robot = frames(bridge, x=1.0, size=MOST - 200)
    for _ in range(1000):
        bridge.backend.readers["/tf"](robot)
    assert not read
    bridge.backend.readers["/tf"](frames(bridge, "anna", x=3.0))
    await until(lambda: seen["anna"] == [3.0])
    assert not bridge.warnings()
