"""Messages of ours as dora-rs and MCAP's decoder read them."""

import asyncio
import base64
import contextlib
import itertools
import math
import time
from collections.abc import AsyncGenerator, Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import pytest_asyncio
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pointit.bridges.ros2.graph.backend import LATCHED, ROSOUT, SENSOR, Qos
from pointit.bridges.ros2.routing.route_types import InboundRoute, OutboundRoute, ServiceRoute
from pointit.bridges.ros2.routing.routes import routes
from pointit.geometry import rotation
from pointit.maps.file import map_path
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import (
    ButtonEvent,
    ConveyorState,
    Goal,
    Health,
    Interaction,
    LampColor,
    Message,
    SelectionEvent,
)
from pointit.schemas import topics as ours
from pointit.schemas.topics import Topic
from tests.interop.ros2.ament import definition, hash_of
from tests.interop.ros2.peers import EMPTY, HERE, TYPES, Dora, Site, site
from tests.support.bench import until
from tests.support.commands import onlooker
from tests.support.environments import fetched
from tests.support.told import Told
from tests.unit.ros2.values import any_value

QOS = {
    Qos(depth=1): "::,1:,:,:,,",
    Qos(depth=1, reliable=False): "2::,1:,:,:,,",
    Qos(depth=10): "::,10:,:,:,,",
    Qos(depth=100): "::,100:,:,:,,",
    Qos(depth=100, latched=True): ":1:,100:,:,:,,",
    LATCHED: ":1:,1:,:,:,,",
    SENSOR: "2::,5:,:,:,,",
    ROSOUT: ":1:,1000:,:10,0:,,",
}
"""As genuine rmw_zenoh writes them: nothing of ours has made these texts."""
CODES = {OutboundRoute: "MP", InboundRoute: "MS", ServiceRoute: "SS"}
ROWS = [row for row in routes(ros4hri=True).all if row.enabled]
LOOKED_AT: tuple[Topic[Any], ...] = (
    *(ours.POSE, ours.RAY, ours.IMU, ours.CURSOR, ours.OBJECTS, ours.STRIPS_FRAME, ours.MAP),
)
THINGS = "things: {lever: {center: [9, 9, 1], size: [1, 1, 1], mode: switch}}"
COLD = "the oven is cold: light it"
INFO = 20
WARN = 30
GOAL = Goal(
    stamp_ns=1, position_m=(1.0, 2.0, 0.5), yaw_rad=0.0, age_s=0.0, position_sigma_m=0.1, clearance_m=1.0,
    proposed_ns=1, confirmed_by="press",
)  # fmt: skip


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory, peers_python: Path) -> Iterator[Site]:
    with site(tmp_path_factory.mktemp("site"), peers_python) as made:
        room = tmp_path_factory.mktemp("map") / "room.yaml"
        with map_path("conveyor") as path:
            room.write_text(path.read_text("utf-8") + THINGS, encoding="utf-8")
        made.run_with_bridge(
            *("--set", "ros2.ros4hri=true", "--set", "ros2.people=[anna]", "--set", f"pui.map={room}")
        )
        made.dora.start()
        yield made


class Seen(NamedTuple):
    """The same, seen on our bus."""

    bus: ZenohBus
    by_stamp: dict[str, dict[int, Any]]
    """By topic."""

    def at(self, topic: Topic[Any], stamp: Any) -> Any:
        """Return our message with the stamp of a ROS header, once it has come."""
        return self.by_stamp[topic.key].get(stamp["sec"] * 1_000_000_000 + stamp["nanosec"])


@pytest_asyncio.fixture
async def seen(place: Site) -> AsyncGenerator[Seen]:
    async with onlooker(place.ours) as look:
        made = Seen(look.bus, {})
        for topic in LOOKED_AT:
            look.bus.subscribe(topic, partial(_keep, made.by_stamp.setdefault(topic.key, {})))
        yield made


def _keep(by_stamp: dict[int, Any], message: Message, _name: str) -> None:
    by_stamp[message.stamp_ns] = message


def name_of(row: Any, user: str = "user1") -> str:
    return str(row.ros).replace("{user}", user).replace("{led}", "led_0")


async def test_graph_has_every_route_with_its_type_hash_and_quality(place: Site, seen: Seen) -> None:
    lamp = seen.bus.publisher(ours.LAMP_COLOR, "led_0")
    await place.dora.sees("user1%metawear_ros")
    lamp.put(LampColor(stamp_ns=1, color=(0, 0, 0)))
    await place.dora.sees("%led_0%color")
    expected: set[tuple[str, ...]] = set()
    for row in ROWS:
        package, kind, short = row.type.split("/")
        dds = f"{package}::{kind}::dds_::{short}_"
        user = "anna" if isinstance(row, InboundRoute) and row.of_ros_users else "user1"
        name = name_of(row, user).replace("/", "%")
        expected.add((CODES[type(row)], name, dds, hash_of(TYPES, row.type), QOS[row.qos]))

    def found() -> set[tuple[str, ...]]:
        chunks = [token.split("/") for token in place.dora.tokens()]
        mine = [each for each in chunks if each[1] == "7" and each[7:9] == ["%", "pointit"]]
        return {(each[5], *each[9:]) for each in mine if len(each) == 13}

    def of_user1(graph: set[tuple[str, ...]]) -> set[tuple[str, ...]]:
        return {
            each
            for each in graph
            if "%user2" not in each[1] and not each[1].startswith(("%led_", "%visitor"))
        }

    await until(lambda: of_user1(found()) >= of_user1(expected), 20, "every route in the graph")
    assert of_user1(found()) == of_user1(expected)
    assert {each for each in found() if each[1] == "%led_0%color"} <= expected


def _near(point: Any, at: Any, tolerance: float = 1e-9) -> bool:
    return math.dist((point["x"], point["y"], point["z"]), at) <= tolerance


def _quaternion(value: Any) -> tuple[float, float, float, float]:
    return value["x"], value["y"], value["z"], value["w"]


def _is_pose(value: Any, seen: Seen, pose: Any) -> bool:
    place = seen.at(ours.POSE, value["header"]["stamp"])
    half_rad = place.yaw_rad / 2.0
    return (
        value["header"]["frame_id"] == "world"
        and _near(pose["position"], place.position_m)
        and _quaternion(pose["orientation"])
        == pytest.approx((0.0, 0.0, math.sin(half_rad), math.cos(half_rad)))
    )


def _is_ray(value: Any, seen: Seen) -> bool:
    ray = seen.at(ours.RAY, value["header"]["stamp"])
    if ray is None:
        return False
    ahead = rotation.rotate(_quaternion(value["pose"]["orientation"]), (1.0, 0.0, 0.0))
    return math.dist(ahead, ray.direction) < 1e-9 and _near(value["pose"]["position"], ray.origin_m)


def _is_arm(value: Any, quaternion: Any, seen: Seen) -> bool:
    sample = seen.at(ours.IMU, value["header"]["stamp"])
    return sample is not None and _quaternion(quaternion) == sample.orientation_xyzw


def _are_packages(value: Any, seen: Seen) -> bool:
    objects = seen.at(ours.OBJECTS, value["header"]["stamp"])
    if objects is None or not objects.objects:
        return False
    (room,) = seen.by_stamp[ours.MAP.key].values()
    length_m = {
        belt.id: sum(itertools.starmap(math.dist, itertools.pairwise(belt.line_m))) for belt in room.belts
    }
    placed = [each["position"] for each in value["packages"]]
    return {(each["name"], round(each["position"] * length_m[each["name"]], 4)) for each in placed} == {
        (each.surface_id, round(each.surface_position_m, 4)) for each in objects.objects
    }


def _are_strips(value: Any, seen: Seen) -> bool:
    data = [bytes(strip["data"]) for strip in value["strips"]]
    frames = seen.by_stamp[ours.STRIPS_FRAME.key].values()
    drawn: list[list[bytes]] = [[strip.rgb for strip in frame.strips] for frame in frames]
    return any(any(each) for each in data) and data in drawn


def _is_frame(value: Any, frame: str, child: str) -> bool:
    (transform,) = value["transforms"]
    return (transform["header"]["frame_id"], transform["child_frame_id"]) == (frame, child)


def _is_now(stamp: Any) -> bool:
    return bool(abs(stamp["sec"] - time.time()) < 60)


CHECKS: dict[str, Callable[[Any, Seen], bool]] = {
    "pose": lambda value, seen: _is_pose(value, seen, value["pose"]),
    "pose_with_covariance": lambda value, seen: (
        _is_pose(value, seen, value["pose"]["pose"]) and len(value["pose"]["covariance"]) == 36
    ),
    "tf": lambda value, seen: any(
        each["child_frame_id"] == "user1/human_footprint"
        and any(
            _near(each["transform"]["translation"], place.position_m)
            for place in seen.by_stamp[ours.POSE.key].values()
        )
        for each in value["transforms"]
    ),
    "tf_static": lambda value, _: "lamp/led_0" in {each["child_frame_id"] for each in value["transforms"]},
    "imu": lambda value, seen: _is_arm(value, value["orientation"], seen),
    "cursor": lambda value, seen: (
        (cursor := seen.at(ours.CURSOR, value["header"]["stamp"])) is not None
        and _near(value["point"], cursor.point_m)
    ),
    "goal_pose": lambda value, _: _near(value["pose"]["position"], GOAL.position_m),
    "thing_on": lambda value, _: _is_pull(value),
    "thing_off": lambda value, _: _is_pull(value),
    "is_pointing": lambda value, _: value == {"data": True},
    "diagnostics": lambda value, _: value["status"][0]["name"].startswith("pointit: "),
    "rosout": lambda value, _: (value["level"], value["msg"]) == (INFO, f"over: {COLD}"),
    "markers": lambda value, _: "user1/ray" in {each["ns"] for each in value["markers"]},
    "map_markers": lambda value, _: value["markers"][0]["action"] == 3 and len(value["markers"]) > 10,
    "pointing_ray": _is_ray,
    "rotation": lambda value, seen: _is_arm(value, value["quaternion"], seen),
    "button": lambda value, _: value == {"data": False},
    "state_transition": lambda value, _: value == {"node_name": "supervisor", "state": "pointing"},
    "subscription": lambda value, _: value["user_name"] == "visitor" and value["subscribe"],
    "packages": _are_packages,
    "selected_packages": lambda value, _: len(value["uids"]) > 0,
    "pointers": lambda value, _: any(
        each["user_name"] == "user1" and each["position"]["name"] for each in value["pointers"]
    ),
    "led_strips": _are_strips,
    "lamp_color": lambda value, _: tuple(value.values()) == pytest.approx((0.2, 0.4, 1.0, 1.0)),
    "step_number": lambda value, _: value == {"data": 3},
    "tracked_people": lambda value, _: "user1" in value["ids"],
    "known_people": lambda value, _: "user1" in value["ids"],
    "tracked_bodies": lambda value, _: "user1_body" in value["ids"],
    "anonymous": lambda value, _: value == {"data": False},
    "body_id": lambda value, _: value == {"data": "user1_body"},
    "location_confidence": lambda value, _: 0.0 < value["data"] <= 1.0,
    "joint_states": lambda value, _: (
        dict(zip(value["name"], value["position"], strict=True))["r_p_shoulder_user1_body"] > 0.0
    ),
    "candidate_matches": lambda value, _: (
        (value["id1"], value["id2"], value["confidence"]) == ("user1_body", "user1", 1.0)
    ),
    "person_tf": lambda value, _: _is_frame(value, "world", "person_user1"),
    "body_tf": lambda value, _: _is_frame(value, "world", "body_user1_body"),
    "head_tf": lambda value, _: _is_frame(value, "body_user1_body", "head_user1_body"),
}


def _is_pull(value: Any) -> bool:
    told = value["results"][0]["hypothesis"]
    return (value["id"], told["class_id"], told["score"]) == ("visitor", "lever", 0.75)


@contextlib.asynccontextmanager
async def _reports(bus: ZenohBus, *warnings: str) -> AsyncGenerator[None]:
    """Be a service that says this of itself."""
    writer = bus.publisher(ours.HEALTH, "oven")

    async def report() -> None:
        for seq in itertools.count(1):
            stamp_ns = time.time_ns()
            writer.put(
                Health(stamp_ns=stamp_ns, seq=seq, service="oven", instance="oven", pid=1, warnings=warnings)
            )
            await asyncio.sleep(0.5)

    reporting = asyncio.create_task(report())
    try:
        yield
    finally:
        reporting.cancel()
        writer.close()


async def _provoke(dora: Dora, seen: Seen) -> None:
    """Say what nobody says in scenario_4 by itself, as soon as the bridge knows who listens."""
    await dora.sees("/MS/", "/robot/%step_number/")
    seen.bus.publisher(ours.LAMP_COLOR, "led_0").put(LampColor(stamp_ns=1, color=(51, 102, 255)))
    seen.bus.publisher(ours.CONVEYOR_STATE).put(ConveyorState(stamp_ns=1, speed_mps=0.2, step="3"))
    seen.bus.publisher(ours.INTERACTION, "visitor").put(Interaction(stamp_ns=1, state="pointing"))
    seen.bus.publisher(ours.BUTTON, "visitor").put(ButtonEvent(stamp_ns=1))
    seen.bus.publisher(ours.GOAL, "user1").put(GOAL)
    for event in ("selected", "deselected"):
        seen.bus.publisher(ours.SELECTION_EVENTS).put(
            SelectionEvent(stamp_ns=1, event=event, object_id="lever", user="visitor", confidence=0.75)
        )


SIMULATED = "clock"
"""The route that is published in simulated time only, which this site does not have; see test_outward."""


async def test_every_route_brings_the_values_that_are_on_our_bus(place: Site, seen: Seen) -> None:
    rows = [row for row in ROWS if isinstance(row, OutboundRoute) and row.name != SIMULATED]
    assert {row.name for row in rows} == set(CHECKS), "every route is looked at"
    for row in {row.ros: row for row in rows}.values():
        latched = row.qos.latched
        depth = row.qos.depth
        await place.dora.do("listen", topic=_heard_at(row), type=row.type, latched=latched, depth=depth)
    await until(lambda: len(seen.by_stamp[ours.RAY.key]) > 10, 20, "rays of user1")

    await _provoke(place.dora, seen)
    async with _reports(seen.bus, COLD):
        line = await place.dora.hears("/rosout", lambda line: line["name"] == "pointit.oven")
    assert (line["level"], line["msg"], line["file"], line["line"]) == (WARN, COLD, "", 0)
    assert _is_now(line["stamp"])

    async with _reports(seen.bus):
        for row in rows:
            await place.dora.hears(_heard_at(row), partial(_fits, row.name, seen))


def _heard_at(row: OutboundRoute) -> str:
    """Return the name of what is heard: user1 presses once, perhaps before anybody listens."""
    return name_of(row, "visitor" if row.name == "button" else "user1")


def _fits(route: str, seen: Seen, value: Any) -> bool:
    return CHECKS[route](value, seen)


# (of JSON nothing is known)


EMITTED = sorted(
    {row.type for row in routes(ros4hri=True).all if not isinstance(row, InboundRoute | ServiceRoute)}
    | {TYPES.response_of(row.type) for row in routes().served}
)
EXAMPLES = settings(max_examples=12, suppress_health_check=[HealthCheck.data_too_large])


def asked(decoder: Told, name: str, cdr: bytes) -> Any:
    """Return the value that `decoder` decodes from `cdr`."""
    return decoder.ask(type=name, definition=definition(TYPES, name), cdr=base64.b64encode(cdr).decode())


@pytest.fixture(scope="module")
def mcap(peers_python: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Told]:
    said = tmp_path_factory.mktemp("mcap") / "stderr"
    decoder = Told("mcap", (f"{peers_python}", f"{HERE / 'mcap_decoder.py'}"), said)
    yield decoder
    decoder.end()


@pytest.fixture(scope="module")
def foxglove(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Told]:
    folder = tmp_path_factory.mktemp("decoder")
    node = fetched(HERE / "decoder", folder)
    decoder = Told("foxglove", (node, f"{folder / 'decode.mjs'}"), folder / "stderr")
    yield decoder
    decoder.end()


def meant(value: Any) -> Any:
    """Return a ROS value as the decoders of others write it in JSON."""
    if isinstance(value, np.ndarray):
        return [meant(each) for each in value.tolist()]
    if isinstance(value, list):
        return [meant(each) for each in value]
    names = getattr(type(value), "__dataclass_fields__", None)
    if names is None:
        return value
    return {
        name: meant(getattr(value, name))
        for name in names
        if name == name.lower() and not name.startswith("__") and name not in EMPTY
    }


def read(value: Any, expected: Any) -> Any:
    """Return a decoded value with the field names of ROS times and with numbers of the expected type."""
    match value, expected:
        case list(), list():
            return [read(each, other) for each, other in itertools.zip_longest(value, expected)]
        case {"big": big}, _:
            return int(big)
        case dict(), dict():
            named = {"nanosec" if name == "nsec" else name: each for name, each in value.items()}
            return {name: read(each, expected.get(name)) for name, each in named.items()}
        case int(), float():
            return float(value)
        case int(), int() if 128 <= value < 256 and expected < 0:
            return value - 256  # a `byte`, which rosbags takes for one with a sign; there is no int8
        case _:
            return value


@pytest.mark.parametrize("name", EMITTED)
@given(data=st.data())
@EXAMPLES
def test_decoders_of_others_read_what_we_meant(
    name: str, mcap: Told, foxglove: Told, data: st.DataObject
) -> None:
    value = data.draw(any_value(name))
    cdr = TYPES.encode(name, value)
    expected = meant(TYPES.decode(name, cdr))  # 32-bit floats are rounded there
    for decoder in (mcap, foxglove):
        assert read(asked(decoder, name, cdr), expected) == expected
