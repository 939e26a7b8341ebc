"""The bridge as a whole, in a graph in which there is only the test."""

from collections.abc import AsyncIterator

import pytest
from pydantic import ValidationError

from pointit.bridges.ros2.config import BackendConfig, Ros2Config
from pointit.bridges.ros2.graph.backend import check_apart, place_of
from pointit.bridges.ros2.service import Ros2
from pointit.bridges.ros2.types.types import Types
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch, check_launches
from pointit.schemas import Cursor, Figure, Health, ImuSample, UserPose
from pointit.schemas.topics import CURSOR, HEALTH, POSE, SERVICE_ALIVE, USER_ALIVE
from tests.support.bench import START_NS, Bench, memory_bench, until
from tests.unit.ros2.graph_of_one import FakeBackend, graph

PLACE = UserPose(stamp_ns=START_NS, seq=1, position_m=(1.0, 2.0, 0.0), yaw_rad=0.5)
NOWHERE = Cursor(stamp_ns=START_NS, seq=1)
HELD = ImuSample(stamp_ns=START_NS, seq=1, orientation_xyzw=(0.0, 0.0, 0.0, 1.0))


@pytest.fixture
async def bench(backend: FakeBackend) -> AsyncIterator[Bench]:
    async with memory_bench() as made:
        made.start(Ros2)
        await until(lambda: bool(backend.watchers))
        yield made


def of(backend: FakeBackend, user: str) -> set[str]:
    return {name for name in backend.writers if name.startswith(f"/{user}/")}


async def test_who_returns_has_their_place(bench: Bench, backend: FakeBackend) -> None:
    backend.watchers[0](graph(("subscriber", "/tf")))
    here = bench.bus.announce(USER_ALIVE, "anna")
    bench.put(POSE, PLACE, "anna")
    await until(lambda: len(backend.sent.get("/tf", [])) >= 2)
    here.close()
    await until(lambda: not of(backend, "anna"))
    bench.put(CURSOR, NOWHERE, "anna")  # as pui does for who is gone
    bench.put(CURSOR, NOWHERE, "ben")
    await until(lambda: bool(of(backend, "ben")))
    assert not of(backend, "anna")
    count = len(backend.sent["/tf"])
    here = bench.bus.announce(USER_ALIVE, "anna")
    await until(lambda: len(backend.sent["/tf"]) > count + 1 and len(backend.sent["/anna/pose"]) == 2)
    here.close()


@pytest.mark.parametrize("error", [KeyError("no such type"), SyntaxError()])
async def test_a_type_that_cannot_be_used_costs_its_routes_only(
    backend: FakeBackend, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    prepare = Types.prepare

    def prepare_but_one(self: Types, *names: str) -> None:
        if "sensor_msgs/msg/Imu" in names:
            raise error
        prepare(self, *names)

    monkeypatch.setattr(Types, "prepare", prepare_but_one)
    async with memory_bench() as bench:
        reports = bench.collect(HEALTH)
        bench.start(Ros2)
        here = bench.bus.announce(USER_ALIVE, "anna")
        await until(lambda: "/anna/pose" in backend.writers)
        assert "/anna/imu" not in backend.writers
        assert "/anna/imu_in" not in backend.readers
        await until(lambda: bool(reports))
        (warning,) = reports[-1].warnings
        assert warning.startswith("without imu, imu_in: type sensor_msgs/msg/Imu cannot be used: ")
        here.close()


async def test_other_domains_are_others(bench: Bench, backend: FakeBackend) -> None:
    there = graph(("publisher", "/packages"), ("server", "/add_pack"), domain=5)
    backend.watchers[0](there)
    assert "/packages" in backend.writers
    assert "/add_pack" in backend.servers
    backend.watchers[0](graph(("publisher", "/packages"), ("server", "/add_pack")))
    assert "/packages" not in backend.writers
    assert "/add_pack" not in backend.servers
    assert bench.bus.site


async def test_who_is_missing_is_said(backend: FakeBackend, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")  # before it starts: it says that once
    async with memory_bench() as bench:
        bench.start(Ros2)
        await until(lambda: "no other ROS node is seen" in caplog.messages)
        reports = bench.collect(HEALTH)
        backend.watchers[0](graph(("subscriber", "/tf"), ("publisher", "/clock")))
        await until(lambda: any(each.name == "ROS nodes" and each.value == 1 for each in figures(reports)))


async def test_nothing_is_said_while_the_graph_is_left(
    backend: FakeBackend, monkeypatch: pytest.MonkeyPatch
) -> None:
    left: list[set[str]] = []
    async with memory_bench() as bench:

        async def close() -> None:
            bench.put(POSE, PLACE, "ben")
            bench.bus.announce(USER_ALIVE, "carl")
            await bench.settle(20)
            left.append({*backend.writers, *backend.readers})

        monkeypatch.setattr(backend, "close", close)
        bench.start(Ros2)
        await until(lambda: bool(backend.watchers))
        here = bench.bus.announce(USER_ALIVE, "anna")
        await until(lambda: bool(of(backend, "anna")))
        here.close()
    assert left == [set()]


def figures(reports: list[Health]) -> tuple[Figure, ...]:
    return reports[-1].figures if reports else ()


async def test_what_goes_wrong_is_logged_in_ros(bench: Bench, backend: FakeBackend) -> None:
    backend.watchers[0](graph(("subscriber", "/rosout")))
    ill = Health(stamp_ns=START_NS, service="pui", instance="pui", pid=1, warnings=("no map",))
    sent = backend.sent["/rosout"]

    def told(count: int) -> bool:
        bench.put(HEALTH, ill, "pui")
        return len(sent) == count

    gone: list[str] = []
    here = bench.bus.announce(SERVICE_ALIVE, "pui")
    bench.bus.watch(SERVICE_ALIVE, lambda name, present: None if present else gone.append(name))
    await until(lambda: told(1))
    here.close()
    await until(lambda: gone == ["pui"])
    bench.put(HEALTH, ill, "pui")  # its last one, held up on its way
    bench.put(HEALTH, ill, "selector")
    await until(lambda: len(sent) > 1)
    assert len(sent) == 2
    assert b"pointit.selector" in sent[1]
    bench.bus.announce(SERVICE_ALIVE, "pui")
    await until(lambda: told(3), what="it to be said of the next one of the name")


ROS = "tcp/127.0.0.1:7447"


def launch(**backend: object) -> Launch:
    config = Ros2Config(backend=BackendConfig.model_validate(backend))
    return Launch(service=Ros2, config=config)


@pytest.mark.parametrize(
    "own", [ROS, "tls/localhost:7447", "tcp/[::]:7447", "tcp/0.0.0.0:7447", "tls/127.0.0.1:7447#root=/a.pem"]
)
def test_one_port_is_not_both(own: str) -> None:
    with pytest.raises(ConfigError) as caught:
        check_launches([launch()], ["tcp/other:7447", own])
    assert str(caught.value) == (
        f"ros2: backend.endpoint {ROS} is where this command has PointIt itself ({own}), and one port is "
        "either ROS's router or PointIt's: say with --connect where PointIt is (a run with --ros2 is at "
        "tcp/127.0.0.1:7448), or with backend.endpoint where ROS's router is"
    )
    check_launches([launch(kind="dds")], [own])  # which has no router


@pytest.mark.parametrize(
    "own", ["tcp/127.0.0.1:7448", "tcp/hall:7447", "quic/127.0.0.1:7447", "serial//dev/x"]
)
def test_other_ports_machines_and_protocols_are_apart(own: str) -> None:
    check_launches([launch()], [own])
    check_apart("serial//dev/x", [own])
    assert place_of("tcp/Robot.local:7447") == place_of("tls/robot.local:7447?x=1")
    assert place_of("udp/robot.local:7447") != place_of("tcp/robot.local:7447")


@pytest.mark.parametrize("endpoint", ["foo", "7447", "tcp/127.0.0.1:70000"])
def test_an_address_that_is_none_is_refused_before_anything_is_opened(endpoint: str) -> None:
    with pytest.raises(
        ConfigError, match=rf"^ros2: backend\.endpoint: '{endpoint}' is no address; write one"
    ):
        check_launches([launch(endpoint=endpoint)])


@pytest.mark.parametrize("node", ["pointit", "", "/", "/a b", "/pointit\n"])
def test_a_node_that_has_no_full_name(node: str) -> None:
    with pytest.raises(ValidationError, match="begin with / and write letters"):
        BackendConfig(node=node)
