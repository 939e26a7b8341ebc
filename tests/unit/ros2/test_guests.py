"""People who have ROS nodes only: when they are present, what is said of them, when services of ours lead."""

from collections.abc import AsyncIterator
from dataclasses import replace
from typing import Any

import pytest

from pointit.bridges.ros2.config import Ros2Config
from pointit.bridges.ros2.inbound.person import interaction
from pointit.bridges.ros2.routing import ros_users
from pointit.bridges.ros2.service import Ros2
from pointit.runtime.config.config import Layers
from pointit.runtime.errors import ConfigError
from pointit.schemas import Health, Interaction, UserPose, UserProfile, topics
from tests.support.bench import START_NS, Bench, memory_bench, until
from tests.unit.ros2.graph_of_one import FakeBackend, graph
from tests.unit.ros2.scenes import jazzy
from tests.unit.ros2.test_inbound import frame_of, place, tf
from tests.unit.ros2.test_inbound_services import wish

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

    def _on_person(self, name: str, here: bool) -> None:  # noqa: FBT001 - the bus's signature
        (self.people.add if here else self.people.discard)(name)

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


async def test_it_is_known_that_she_wants_no_cursor_before_a_ray_of_hers_comes(site: Site) -> None:
    order: list[str] = []
    site.bench.bus.subscribe(topics.INTERACTION, lambda message, _name: order.append(message.state))
    site.bench.bus.subscribe(topics.RAY, lambda _message, _name: order.append("ray"))
    await site.here()
    await until(lambda: "ray" in order)
    assert order[0] == "idle"


async def test_who_is_silent_has_left_and_may_return(site: Site) -> None:
    await site.here()
    await until(lambda: "anna" not in site.people)
    assert RAYS in site.backend.readers
    assert not {name for name in site.backend.writers if name.startswith("/anna/")}
    site.rays.clear()
    await site.here()
    await until(lambda: site.states == ["idle", "idle"])


async def test_who_wants_a_cursor_stays_with_their_ray(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
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


async def test_a_fault_on_her_way_in_is_tried_again(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
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
async def test_services_of_ours_win_over_her_nodes_until_they_end(site: Site, leader: str) -> None:
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


async def test_where_she_stood_as_a_guest_is_no_longer_said_when_services_of_ours_lead(site: Site) -> None:
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


async def test_a_guest_again_while_other_services_of_ours_stay(site: Site) -> None:
    site.bench.bus.announce(topics.USER_ALIVE, "anna")
    leader = site.bench.bus.announce(topics.SERVICE_ALIVE, "pointing.anna")
    await until(lambda: site.backend.writers.keys() >= THEIRS)
    leader.close()
    await until(lambda: RAYS in site.backend.readers and not THEIRS & site.backend.writers.keys())
    assert "/anna/cursor" in site.backend.writers


async def test_the_bridge_takes_its_guests_along(site: Site) -> None:
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
def test_people_are_named_as_a_list_or_as_one_and_each_once(text: str, people: tuple[str, ...] | str) -> None:
    layers = Layers()
    layers.add_text(["people"], text, "--set")
    if isinstance(people, str):
        with pytest.raises(ConfigError, match=people):
            layers.build(Ros2Config)
    else:
        assert layers.build(Ros2Config).people == people
