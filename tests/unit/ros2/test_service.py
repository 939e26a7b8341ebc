"""The bridge as a whole, in a graph in which there is only the test; people who have ROS nodes only."""

from collections.abc import AsyncIterator
from dataclasses import replace
from typing import Any

import pytest
from pydantic import ValidationError

from pointit.bridges.ros2.config import BackendConfig, Ros2Config
from pointit.bridges.ros2.graph.router_address import check_apart, place_of
from pointit.bridges.ros2.inbound.rays import interaction
from pointit.bridges.ros2.routing import ros_users
from pointit.bridges.ros2.service import Ros2
from pointit.bridges.ros2.types.types import Types
from pointit.runtime.config.config import Layers
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch, check_launches
from pointit.schemas import Cursor, Figure, Health, ImuSample, Interaction, UserPose, UserProfile, topics
from pointit.schemas.topics import CURSOR, HEALTH, POSE, SERVICE_ALIVE, USER_ALIVE
from tests.support.bench import START_NS, Bench, memory_bench, until
from tests.unit.ros2.graph_of_one import FakeBackend, graph
from tests.unit.ros2.scenes import jazzy
from tests.unit.ros2.test_inbound import frame_of, place, tf
from tests.unit.ros2.test_inbound_services import wish

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


async def test_returning_person_keeps_their_position(bench: Bench, backend: FakeBackend) -> None:
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
async def test_unusable_type_disables_its_routes_only(
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


async def test_missing_ros_nodes_are_noted(backend: FakeBackend, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")  # before it starts: it says that once
    async with memory_bench() as bench:
        bench.start(Ros2)
        await until(lambda: "no other ROS node is seen" in caplog.messages)
        reports = bench.collect(HEALTH)
        backend.watchers[0](graph(("subscriber", "/tf"), ("publisher", "/clock")))
        await until(lambda: any(each.name == "ROS nodes" and each.value == 1 for each in figures(reports)))


async def test_nothing_is_declared_while_the_bridge_leaves_the_graph(
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


async def test_service_warnings_are_logged_in_ros(bench: Bench, backend: FakeBackend) -> None:
    backend.watchers[0](graph(("subscriber", "/rosout")))
    ill = Health(stamp_ns=START_NS, service="pui", instance="pui", pid=1, warnings=("no map",))
    sent = backend.sent["/rosout"]

    def told(count: int) -> bool:
        bench.put(HEALTH, ill, "pui")
        return len(sent) == count

    gone: list[str] = []
    here = bench.bus.announce(SERVICE_ALIVE, "pui")
    bench.bus.watch(SERVICE_ALIVE, lambda name, *, present: None if present else gone.append(name))
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
def test_ros_router_at_the_address_of_pointit_is_refused(own: str) -> None:
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
def test_invalid_endpoint_is_refused_before_anything_is_opened(endpoint: str) -> None:
    with pytest.raises(
        ConfigError, match=rf"^ros2: backend\.endpoint: '{endpoint}' is no address; write one"
    ):
        check_launches([launch(endpoint=endpoint)])


@pytest.mark.parametrize("node", ["pointit", "", "/", "/a b", "/pointit\n"])
def test_node_without_a_full_name_is_refused(node: str) -> None:
    with pytest.raises(ValidationError, match="begin with / and write letters"):
        BackendConfig(node=node)


RAYS = "/anna/pointing_ray"
FRAME = "anna/human_footprint"
SUBSCRIPTION = "/PUI_subscription"
THEIRS = {RAYS, "/anna/metawear_ros/rotation", "/anna/metawear_ros/button", "/anna/state_transition"}
WARNED = "anna is named in `people`"


class Site:
    """The bridge, the nodes of anna, and what our side sees of her."""

    def __init__(self, bench: Bench, backend: FakeBackend) -> None:
        self.bench = bench
        self.backend = backend
        self.people: set[str] = set()
        self.rays = bench.collect(topics.RAY)
        self.interactions: list[Interaction] = bench.collect(topics.INTERACTION, "anna")
        self.profiles: list[UserProfile] = bench.collect(topics.PROFILE, "anna")
        self.reports: list[Health] = bench.collect(topics.HEALTH)
        bench.bus.watch(topics.USER_ALIVE, self._on_person)

    def _on_person(self, name: str, *, present: bool) -> None:
        (self.people.add if present else self.people.discard)(name)

    def says(self, ros: str, kind: str, value: Any) -> None:
        self.backend.readers[ros](jazzy().encode(kind, value))

    def ray(self) -> bool:
        """Say one, whatever comes of it; true, for conditions."""
        value = place(frame=FRAME)
        value.header.stamp.sec = 0
        value.header.stamp.nanosec = 0
        self.says(RAYS, "geometry_msgs/msg/PoseStamped", value)
        return True

    def wishes(self, **how: Any) -> None:
        self.says(SUBSCRIPTION, "conveyor_msgs/msg/PUISubscription", wish("anna", **how))

    @property
    def warnings(self) -> tuple[str, ...]:
        return self.reports[-1].warnings if self.reports else ()

    @property
    def states(self) -> list[str]:
        return [each.state for each in self.interactions]

    async def here(self) -> None:
        """Rays come until some are taken."""
        await until(lambda: self.ray() and "anna" in self.people and bool(self.rays), what="her rays")


@pytest.fixture
async def site(backend: FakeBackend, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Site]:
    monkeypatch.setattr(ros_users, "LOOK_S", 0.01)
    monkeypatch.setattr(ros_users, "SILENT_S", 0.3)
    async with memory_bench() as made:
        made.start(Ros2, Ros2Config(people=("anna",)))
        await until(lambda: bool(backend.watchers))
        yield Site(made, backend)


async def test_idle_state_is_published_before_the_first_ray(site: Site) -> None:
    order: list[str] = []
    site.bench.bus.subscribe(topics.INTERACTION, lambda message, _name: order.append(message.state))
    site.bench.bus.subscribe(topics.RAY, lambda _message, _name: order.append("ray"))
    await site.here()
    await until(lambda: "ray" in order)
    assert order[0] == "idle"


async def test_ros_user_leaves_when_silent_and_may_return(site: Site) -> None:
    await site.here()
    await until(lambda: "anna" not in site.people)
    assert RAYS in site.backend.readers
    assert not {name for name in site.backend.writers if name.startswith("/anna/")}
    site.rays.clear()
    await site.here()
    await until(lambda: site.states == ["idle", "idle"])


async def test_ros_user_with_a_cursor_stays_while_their_ray_comes(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ros_users, "SILENT_S", 0.02)  # so that it has passed many times below
    seen = graph(("publisher", RAYS))
    site.backend.watchers[0](seen)
    site.wishes()
    await until(lambda: "anna" in site.people and site.states == ["pointing"])

    reports = site.bench.collect(topics.HEALTH)
    await until(lambda: len(reports) >= 1)
    assert site.people == {"anna"}

    site.backend.watchers[0](graph(("publisher", "/ben/pointing_ray")))
    await until(lambda: "anna" not in site.people and site.states == ["pointing", "idle"])
    assert "nothing of theirs comes any more" in site.interactions[-1].reason

    of_bridge = frozenset(replace(each, is_bridge=True) for each in seen.endpoints)
    site.backend.watchers[0](replace(seen, endpoints=of_bridge))  # of another PointIt: it keeps nobody
    site.wishes()
    await until(lambda: "anna" in site.people)
    await until(lambda: "anna" not in site.people and site.states[-2:] == ["pointing", "idle"])


async def test_presence_is_announced_again_after_an_error(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    faults: list[str] = []

    def failing_once(*arguments: Any) -> Any:
        if not faults:
            faults.append("a fault of ours")
            raise RuntimeError(faults[0])
        return interaction(*arguments)

    monkeypatch.setattr(ros_users, "interaction", failing_once)
    await site.here()
    await until(lambda: site.states == ["idle"])
    assert faults


@pytest.mark.parametrize("leader", ["supervisor.anna", "pointing.anna", "user-sim.anna"])
async def test_pointit_services_replace_ros_nodes_until_they_end(site: Site, leader: str) -> None:
    await site.here()
    site.wishes()
    await until(lambda: site.states[-1:] == ["pointing"])

    ours = [
        site.bench.bus.announce(topics.SERVICE_ALIVE, leader),
        site.bench.bus.announce(topics.USER_ALIVE, "anna"),
    ]
    if leader == "user-sim.anna":  # it moves an arm, and says neither a ray nor where she is
        await site.bench.settle(20)
        site.rays.clear()
        await site.here()
        assert not site.warnings
        return
    await until(lambda: any(each.startswith(WARNED) and leader in each for each in site.warnings))
    assert RAYS not in site.backend.readers
    await until(lambda: site.backend.writers.keys() >= THEIRS)
    assert site.states[-1] == "pointing", "what comes next is our supervisor's to say"

    site.wishes(subscribe=False)
    for end in ours:
        end.close()
    await until(lambda: not site.people and RAYS in site.backend.readers)

    site.rays.clear()
    await site.here()
    await until(lambda: site.states[-1] == "idle" and not site.warnings)
    assert not THEIRS & site.backend.writers.keys()


async def test_pose_of_a_ros_user_ends_when_pointit_services_start(site: Site) -> None:
    places = site.bench.collect(topics.POSE, "anna")
    site.bench.bus.announce(topics.USER_ALIVE, "anna")
    site.says("/tf_static", "tf2_msgs/msg/TFMessage", tf(frame_of(FRAME, x=3.0)))
    await site.here()
    await until(lambda: [place.position_m[0] for place in places] == [3.0])
    site.bench.bus.announce(topics.SERVICE_ALIVE, "pointing.anna")
    await until(lambda: site.backend.writers.keys() >= THEIRS)
    late: list[str] = []
    site.bench.bus.subscribe(topics.POSE, lambda _message, name: late.append(name))
    site.bench.put(topics.POSE, UserPose(stamp_ns=START_NS, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0), "ben")
    await until(lambda: "ben" in late)
    assert late == ["ben"]


async def test_ros_user_returns_while_other_pointit_services_stay(site: Site) -> None:
    site.bench.bus.announce(topics.USER_ALIVE, "anna")
    leader = site.bench.bus.announce(topics.SERVICE_ALIVE, "pointing.anna")
    await until(lambda: site.backend.writers.keys() >= THEIRS)
    leader.close()
    await until(lambda: RAYS in site.backend.readers and not THEIRS & site.backend.writers.keys())
    assert "/anna/cursor" in site.backend.writers


async def test_ros_users_leave_when_the_bridge_ends(site: Site) -> None:
    await site.here()
    site.wishes()
    await until(lambda: site.states[-1] == "pointing")
    await site.bench.stop()
    await until(lambda: site.states[-1] == "idle" and not site.people)
    assert not site.backend.readers


@pytest.mark.parametrize(
    ("text", "people"),
    [
        *(("anna", ("anna",)), ("[anna, b.c-2]", ("anna", "b.c-2"))),
        *(("[a/b]", "letters, digits"), ("[anna, anna]", "name each person once")),
    ],
)
def test_people_are_a_list_or_one_name_without_repetition(text: str, people: tuple[str, ...] | str) -> None:
    layers = Layers()
    layers.add_text(["people"], text, "--set")
    if isinstance(people, str):
        with pytest.raises(ConfigError, match=people):
            layers.build(Ros2Config)
    else:
        assert layers.build(Ros2Config).people == people
