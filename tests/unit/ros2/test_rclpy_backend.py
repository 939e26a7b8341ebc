"""The backend on rclpy, against a stand-in for it: topics, services, the graph, bounds and warnings."""

import asyncio
import re
import sys
import threading
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any

import pytest

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backend import LATCHED, ROSOUT, RosType
from pointit.bridges.ros2.graph.backends import opened
from pointit.bridges.ros2.graph.node_backend import NodeContext
from pointit.runtime.errors import BusClosedError, ConfigError
from pointit.schemas import NS_PER_S
from tests.support.bench import until
from tests.unit.ros2 import fake_rclpy
from tests.unit.ros2.fake_rclpy import BOOL, QOS, SET, TRUE, Ours, Wire, node_of_ours, on_a_wire, profile

pytestmark = pytest.mark.wall_time


@pytest.fixture
def wire(monkeypatch: pytest.MonkeyPatch) -> Wire:
    return on_a_wire(monkeypatch)


@pytest.fixture
async def ours(wire: Wire) -> AsyncIterator[Ours]:
    assert not wire.nodes
    async with node_of_ours() as made:
        yield made


class Rebuilt(fake_rclpy.Bool):
    HASH = "RIHS01_" + "0" * 64


async def test_messages_of_another_definition_arrive_and_are_reported(wire: Wire, ours: Ours) -> None:
    heard: list[bytes] = []
    ours.backend.subscribe("/in", BOOL, QOS, heard.append)
    wire.node("robot").create_publisher(Rebuilt, "/in", profile()).publish(TRUE)
    await until(lambda: bool(heard) and "definition of /in" in ours.now)
    assert "what arrives is dropped or misread" in ours.now["definition of /in"]


async def test_missing_rclpy_is_reported_with_the_setup_to_source() -> None:
    assert "rclpy" not in sys.modules
    with pytest.raises(
        ConfigError,
        match=r"^backend\.kind dds: there is no rclpy for this Python 3\.\d+; run `source /opt/ros/jazzy",
    ):
        await opened(BackendConfig(kind="dds"), Ours())


async def test_an_rclpy_that_does_not_load_is_named(wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rclpy.node", None)
    with pytest.raises(ConfigError, match=r"rclpy does not load in this Python .*rclpy\.node.*source"):
        await opened(BackendConfig(kind="dds"), Ours())
    monkeypatch.undo()
    fake_rclpy.on_a_wire(monkeypatch)
    monkeypatch.delattr(sys.modules["rclpy.subscription"].Subscription, "CallbackType")  # before Iron
    with pytest.raises(ConfigError, match=r"rclpy does not load in this Python .*CallbackType.*source"):
        await opened(BackendConfig(kind="dds"), Ours())
    assert not wire.nodes


async def test_a_graph_that_cannot_be_joined_is_one_sentence(wire: Wire) -> None:
    with pytest.raises(ConfigError, match=r"as /refused, domain 7 \(no middleware\); check that RMW_"):
        await opened(BackendConfig(kind="dds", node="/refused", domain_id=7), Ours())
    assert not wire.nodes


async def test_messages_go_both_ways_and_ours_never_come_back(wire: Wire, ours: Ours) -> None:
    heard: list[bytes] = []
    threads: set[int] = set()

    def take(cdr: bytes) -> None:
        threads.add(threading.get_ident())
        heard.append(cdr)

    def they_take(cdr: bytes, _info: Any) -> None:
        they_heard.append(cdr)

    theirs = wire.node("robot")
    they_heard: list[bytes] = []
    theirs.create_subscription(fake_rclpy.Bool, "/both", they_take, profile(), raw=True)
    publisher = theirs.create_publisher(fake_rclpy.Bool, "/both", profile())
    reader = ours.backend.subscribe("/both", BOOL, QOS, take)
    writer = ours.backend.advertise("/both", BOOL, QOS)
    for _ in range(20):
        writer.put(TRUE)

    publisher.publish(TRUE)
    await until(lambda: bool(heard))
    writer.put(TRUE)
    publisher.publish(b"\0\1\0\0\0")
    await until(lambda: len(heard) == 2)
    assert heard == [fake_rclpy.PADDED, b"\0\1\0\0\0\0\0\0"]
    assert len(they_heard) == 23
    assert threads == {threading.get_ident()}

    reader.close()
    reader.close()
    publisher.publish(TRUE)
    writer.close()
    writer.close()
    assert {end.node for ends in wire.ends.values() for end in ends} == {theirs}
    with pytest.raises(BusClosedError):
        writer.put(TRUE)
    assert len(heard) == 2


async def test_unsendable_message_is_reported(wire: Wire, ours: Ours) -> None:
    writer = ours.backend.advertise("/out", BOOL, QOS)
    writer.put(b"\0\1\0\0refuse")
    assert ours.now["sending /out"] == "/out could not be sent to ROS: it was refused"
    writer.put(TRUE)
    assert len(wire.ends["publisher"]) == 1


async def test_reader_is_bounded_and_survives_a_failing_handler(
    wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(NodeContext, "max_bytes", 1000)
    async with node_of_ours() as ours:
        heard: list[bytes] = []

        def take(cdr: bytes) -> None:
            heard.append(cdr)
            raise ZeroDivisionError

        ours.backend.subscribe("/in", BOOL, QOS, take)
        publisher = wire.node("robot").create_publisher(fake_rclpy.Bool, "/in", profile())
        publisher.publish(bytes(1001))
        for index in range(200):
            publisher.publish(b"\0\1\0\0" + bytes([index]))
        executor = wire.nodes[0].executor
        assert executor is not None
        taken = threading.Event()
        executor.create_task(taken.set)

        assert taken.wait(60)  # the loop stands still meanwhile
        await until(lambda: bool(heard))
        assert [cdr[4] for cdr in heard] == list(range(136, 200))
        assert ours.now["losses of /in"] == (
            "dropped messages on /in: 1 were longer than 1000 bytes and 136 came faster than they could be "
            "handled"
        )


async def answers(request: bytes) -> bytes:
    await asyncio.sleep(0)
    return request


@pytest.mark.usefixtures("wire")
@pytest.mark.parametrize(
    ("package", "remedy"),
    [
        ("conveyor_msgs", r"colcon build --base-paths \S+interfaces`, source install/setup\.bash and start"),
        ("tf2_msgs", r"install ros-jazzy-tf2-msgs and start again"),
    ],
)
async def test_routes_whose_types_this_ros_lacks_are_named(package: str, remedy: str, ours: Ours) -> None:
    lacking = RosType(name=f"{package}/msg/Some", hash=BOOL.hash)
    served = RosType(name=f"{package}/srv/Some", hash=BOOL.hash)
    writer = ours.backend.advertise("/a", lacking, QOS)
    writer.put(TRUE)
    writer.close()
    ours.backend.subscribe("/b", lacking, QOS, lambda _cdr: None).close()
    ours.backend.serve("/c", served, answers).close()
    with pytest.raises(TimeoutError, match=f"lacks {package}"):
        await ours.backend.call("/d", served, TRUE, timeout_s=1)
    ours.backend.advertise("/out", BOOL, QOS)
    await until(lambda: len(ours.graphs[-1].endpoints) == 1)
    assert re.search(remedy, ours.now[f"package {package}"])
    assert set(ours.now) == {f"package {package}"}


async def test_type_that_rclpy_refuses_disables_its_topics(
    wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **_named: object) -> None:
        raise RuntimeError("Caught an unknown exception!\nat all")

    async with node_of_ours() as ours:
        for method in ("create_publisher", "create_subscription", "create_service"):
            monkeypatch.setattr(fake_rclpy.Node, method, refuse)
        ours.backend.advertise("/a", BOOL, QOS).put(TRUE)
        ours.backend.subscribe("/b", BOOL, QOS, lambda _cdr: None).close()
        ours.backend.serve("/c", SET, answers).close()
        monkeypatch.undo()
        assert ours.now[f"refusal of {BOOL.name}"].startswith(
            "rclpy refuses std_msgs/msg/Bool, so /b is left out"
        )
        assert "Caught an unknown exception!" in ours.now[f"refusal of {SET.name}"]
        assert "at all" not in ours.now[f"refusal of {SET.name}"]
    assert not wire.ends["publisher"]


async def test_topic_is_left_out_when_its_type_has_another_definition(wire: Wire, ours: Ours) -> None:
    other = RosType(name=BOOL.name, hash="RIHS01_" + "0" * 64)
    ours.backend.advertise("/a", other, QOS).put(TRUE)
    ours.backend.subscribe("/b", other, QOS, lambda _cdr: None)
    assert not wire.ends["publisher"]
    assert not wire.ends["subscription"]
    assert "another definition of std_msgs/msg/Bool" in ours.now[f"definition of {BOOL.name}"]
    hashless = RosType(name=BOOL.name, hash="TypeHashNotSupported")
    ours.backend.advertise("/c", hashless, QOS)
    assert len(wire.ends["publisher"]) == 1


async def test_graph_is_reported_with_its_problems(wire: Wire, ours: Ours) -> None:
    ours.backend.subscribe("/in", BOOL, LATCHED, lambda _cdr: None)
    robot = wire.node("robot", "/a")
    publisher = robot.create_publisher(fake_rclpy.Bool, "/in", profile())
    robot.create_service(fake_rclpy.SetBool, "/stop", answers)
    await until(lambda: ours.sees("publisher", "/in"))
    assert ours.sees("server", "/stop")
    assert ours.graphs[-1].nodes == {"/site1/pointit", "/a/robot"}
    assert "node /a/robot on /in does not match" in ours.now["QoS of /in"]

    # the same names, but another quality: seen a few looks later
    wire.ends["publisher"].remove(publisher)
    robot.create_publisher(fake_rclpy.Bool, "/in", profile(latched=True))
    await until(lambda: "QoS of /in" not in ours.now, 10)

    wire.node("pointit", "/site1")
    await until(lambda: "another ROS node is called /site1/pointit" in ours.now.get("node", ""))
    robot.destroy_node()
    await until(lambda: not ours.sees("publisher", "/in"))


async def test_a_node_that_leaves_meanwhile_does_no_harm(
    wire: Wire, monkeypatch: pytest.MonkeyPatch, ours: Ours
) -> None:
    names = fake_rclpy.Node.get_node_names_and_namespaces

    def haunted(node: fake_rclpy.Node) -> list[tuple[str, str]]:
        return [*names(node), ("ghost", "/")]

    monkeypatch.setattr(fake_rclpy.Node, "get_node_names_and_namespaces", haunted)
    wire.node("robot").create_publisher(fake_rclpy.Bool, "/in", profile())
    await until(lambda: ours.sees("publisher", "/in"))
    assert not ours.ever


async def test_environment_that_contradicts_the_configuration_is_reported(
    wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "5")
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    async with node_of_ours(domain_id=3) as ours:
        assert "ROS_DOMAIN_ID is 5 in this terminal, but backend.domain_id is 3" in ours.now["ROS_DOMAIN_ID"]
        assert "ROS_DISTRO" not in ours.now
        assert wire.nodes[0].options["use_global_arguments"] is False


async def test_closed_endpoints_do_nothing(wire: Wire, ours: Ours) -> None:
    heard: list[bytes] = []
    reader = ours.backend.subscribe("/in", BOOL, QOS, heard.append)
    writer = ours.backend.advertise("/out", BOOL, QOS)
    (subscription,) = wire.ends["subscription"]
    subscription.callback(TRUE, {"source_timestamp": 0})
    await ours.backend.close()
    await ours.backend.close()

    assert not wire.nodes
    assert not ours.now
    subscription.callback(TRUE, {"source_timestamp": 0})
    await asyncio.sleep(0)
    assert not heard
    for use in (
        lambda: writer.put(TRUE),
        lambda: ours.backend.advertise("/x", BOOL, QOS),
        lambda: ours.backend.subscribe("/x", BOOL, QOS, heard.append),
        lambda: ours.backend.serve("/x", SET, answers),
    ):
        with pytest.raises(BusClosedError):
            use()

    reader.close()
    writer.close()
    with pytest.raises(BusClosedError):
        await ours.backend.call("/stop", SET, TRUE, timeout_s=1)


async def test_log_topic_has_a_lifespan_and_replaces_rclpys_own(wire: Wire, ours: Ours) -> None:
    (node,) = [each for each in wire.nodes if each.name == "pointit"]
    assert node.options["enable_rosout"] is False, "or there would be two"
    ours.backend.advertise("/rosout", BOOL, ROSOUT)
    ours.backend.advertise("/state", BOOL, LATCHED)
    log, state = wire.ends["publisher"]
    assert log.profile == fake_rclpy.Profile(
        1000,
        fake_rclpy.Reliability.RELIABLE,
        fake_rclpy.Durability.TRANSIENT_LOCAL,
        fake_rclpy.Duration(10 * NS_PER_S),
    )
    assert state.profile is not None
    assert state.profile.lifespan is None


def server_of(wire: Wire) -> fake_rclpy.Service:
    (service,) = wire.ends["service"]
    assert isinstance(service, fake_rclpy.Service)
    return service


def into(answered: list[bytes]) -> Callable[[fake_rclpy.Value], None]:
    def take(response: fake_rclpy.Value) -> None:
        answered.append(response.cdr)

    return take


def behind(gate: asyncio.Event) -> Callable[[bytes], Awaitable[bytes]]:
    async def slow(request: bytes) -> bytes:
        await gate.wait()
        return request

    return slow


def more(request: fake_rclpy.Value, _response: fake_rclpy.Value) -> fake_rclpy.Value:
    return fake_rclpy.SetBool.Response(request.cdr + b"\2")


async def test_requests_are_answered_without_blocking_the_executor(wire: Wire, ours: Ours) -> None:
    gate = asyncio.Event()
    answered = list[bytes]()
    heard = list[bytes]()
    desk = ours.backend.serve("/stop", SET, behind(gate))
    server_of(wire).ask(b"\0\1\0\0\7", into(answered))
    ours.backend.subscribe("/in", BOOL, QOS, heard.append)
    wire.node("robot").create_publisher(fake_rclpy.Bool, "/in", profile()).publish(TRUE)
    await until(lambda: bool(heard))
    assert not answered
    gate.set()
    await until(lambda: bool(answered))
    assert answered == [b"\0\1\0\0\7"]
    desk.close()
    assert not wire.ends["service"]


@pytest.mark.parametrize("response", [b"\0\1\0\0bad", None], ids=["other", "raises"])
async def test_every_request_is_answered(wire: Wire, ours: Ours, response: bytes | None) -> None:
    async def wrong(_request: bytes) -> bytes:
        if response is None:
            raise ZeroDivisionError
        return response

    ours.backend.serve("/stop", SET, wrong)
    answered: list[bytes] = []
    server_of(wire).ask(b"\0\1\0\0bad", into(answered))  # ends `spin`
    server_of(wire).ask(b"\0\1\0\0\7", into(answered))
    await until(lambda: bool(answered))
    assert answered == [fake_rclpy.SetBool.Response().cdr]
    assert ours.now["rclpy"] == "something from ROS was dropped by rclpy: cannot be read"


async def test_excess_requests_get_empty_responses(wire: Wire, ours: Ours) -> None:
    gate = asyncio.Event()
    answered = list[bytes]()
    ours.backend.serve("/stop", SET, behind(gate))
    for _ in range(66):
        server_of(wire).ask(b"\0\1\0\0\7", into(answered))
    await until(lambda: len(answered) == 2)
    assert answered == [fake_rclpy.SetBool.Response().cdr] * 2
    assert "too many requests are open" in ours.now["requests to /stop"]
    gate.set()
    await until(lambda: len(answered) == 66)
    assert answered[2:] == [b"\0\1\0\0\7"] * 64


async def test_call_returns_the_answer_or_names_the_missing_condition(wire: Wire) -> None:
    async with node_of_ours() as ours:
        with pytest.raises(TimeoutError, match=r"/stop: no node serves it within 0\.01 s"):
            await ours.backend.call("/stop", SET, TRUE, timeout_s=0.01)
        call = asyncio.create_task(ours.backend.call("/stop", SET, TRUE, timeout_s=5))
        server = wire.node("robot").create_service(fake_rclpy.SetBool, "/stop", more)
        assert await call == TRUE + b"\2"
        assert len(wire.ends["client"]) == 1
        server.is_mute = True
        with pytest.raises(TimeoutError, match=r"its server did not answer within 0\.05 s"):
            await ours.backend.call("/stop", SET, TRUE, timeout_s=0.05)
        assert len(wire.removed) == 2
