"""A site without PointIt services for a person, all of whose nodes are ROS nodes."""

import asyncio
import contextlib
import math
import signal
import time
from collections.abc import AsyncGenerator, AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backend import SENSOR, Backend, Qos
from pointit.bridges.ros2.graph.backends import opened
from pointit.bridges.ros2.types.types import Types
from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import SelectionEvent, StripsFrame, TrackedObjects, UserProfile
from pointit.schemas.topics import OBJECTS, PROFILE, SELECTION_EVENTS
from tests.integration.ros2.nodes import DOMAIN
from tests.support.bench import until
from tests.support.buses import free_port
from tests.support.commands import Command, Commands, Onlooker, onlooker
from tests.unit.ros2.graph_of_one import Shown
from tests.unit.ros2.scenes import pose_at, stamped, transform

TYPES = Types("jazzy")
EYES_M = (0.0, 0.0, 1.64)
RAY_HZ = 50.0
COLOR = (1.0, 0.0, 1.0)
WIDTH_M = 0.3
make = TYPES.make


class Nodes:
    """Driver, pointing node, localizer and supervisor of one person, as one node."""

    def __init__(self, backend: Backend, user: str, at_m: Vec3, yaw_rad: float) -> None:
        self._user = user
        self._at_m = at_m
        self._yaw_rad = yaw_rad
        self._azimuth_rad = 0.0
        self._elevation_rad = 1.0
        self._frame = f"{user}/human_footprint"
        self._backend = backend
        self._kinds: dict[str, str] = {}
        self._writers: dict[str, Any] = {}
        self.heard: dict[str, list[bytes]] = {}
        self.nodes: dict[str, set[str]] = {}
        """By name of a topic, who publishes it."""
        self._ray = f"/{user}/pointing_ray"
        self._button = f"/{user}/metawear_ros/button"
        for name, kind, qos in (
            (self._ray, "geometry_msgs/msg/PoseStamped", SENSOR),
            ("/tf", "tf2_msgs/msg/TFMessage", Qos(depth=100)),
            ("/PUI_subscription", "conveyor_msgs/msg/PUISubscription", Qos(depth=10)),
            (self._button, "std_msgs/msg/Bool", Qos(depth=1, latched=True)),
        ):
            self._kinds[name] = kind
            self._writers[name] = backend.advertise(name, TYPES.kind(kind), qos)
            backend.subscribe(name, TYPES.kind(kind), qos, self.heard.setdefault(name, []).append)
        backend.watch(self._look)

    def points_at(self, target_m: Vec3) -> None:
        """Point at a place in the room."""
        way = vector.rotate_z(vector.subtract(target_m, self._at_m), -self._yaw_rad)
        wanted = vector.subtract(way, EYES_M)
        self._azimuth_rad, self._elevation_rad = vector.azimuth(wanted), vector.elevation(wanted)

    def wants_cursor(self, *, wants: bool) -> None:
        """Say so once."""
        red, green, blue = COLOR
        self._say(
            "/PUI_subscription",
            user_name=self._user,
            subscribe=wants,
            pointer_color=make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=1.0),
            pointer_size=WIDTH_M,
        )

    def presses(self) -> None:
        """Press the button and let it go."""
        for is_down in (True, False):
            self._say(self._button, data=is_down)

    async def live(self) -> None:
        """Say the ray and the place until cancelled."""
        while True:
            turned = rotation.from_yaw(self._yaw_rad)
            frame = transform("world", self._frame, self._at_m, turned, time.time_ns())
            self._say("/tf", transforms=[frame])
            way = rotation.from_azimuth_elevation(self._azimuth_rad, self._elevation_rad)
            self._say(self._ray, header=stamped(time.time_ns(), self._frame), pose=pose_at(EYES_M, way))
            await asyncio.sleep(1.0 / RAY_HZ)

    def _say(self, name: str, **fields: Any) -> None:
        kind = self._kinds[name]
        self._writers[name].put(TYPES.encode(kind, make(kind, **fields)))

    def _look(self, graph: Any) -> None:
        self.nodes = {}
        for each in graph.endpoints:
            if each.kind == "publisher":
                self.nodes.setdefault(each.name, set()).add(each.node)


@asynccontextmanager
async def nodes(endpoint: str, user: str, *, at_m: Vec3, yaw_rad: float) -> AsyncGenerator[Nodes]:
    """Yield the nodes of `user`, who stands at a place, in the ROS graph at `endpoint`."""
    config = BackendConfig(endpoint=endpoint, node=f"/{user}/nodes", domain_id=DOMAIN, mode="client")
    backend = await opened(config, Shown())
    made = Nodes(backend, user, at_m, yaw_rad)
    living = asyncio.create_task(made.live())
    try:
        yield made
    finally:
        living.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await living
        await backend.close()


NOTICED_S = 20.0
ANNA = "anna"
RAYS = "/anna/pointing_ray"
SUBSCRIPTION = "/PUI_subscription"
RAYS_PER_S = round(RAY_HZ)
AT_M = (-1.3, -1.9, 0.0)
"""The scenario's first place."""
YAW_RAD = math.radians(20.0)
"""Its yaw."""


class Site:
    """Shared context, and the bridge as a process of its own, which can be ended."""

    def __init__(self, folder: Path) -> None:
        self.ours = f"tcp/127.0.0.1:{free_port()}"
        self.ros = f"tcp/127.0.0.1:{free_port()}"
        self._commands = Commands(folder)
        self._state = {"POINTIT_STATE": f"{folder / 'state'}"}
        settings = ("conveyor-sim.speed_mps=0", "selector.confirm=press")
        told = [word for setting in settings for word in ("--set", setting)]
        self._commands.start(
            *("run", "scenario_4", "--no-view", "--site-only", "--listen", self.ours, *told),
            environment=self._state,
        )
        self.bridge = self.start_bridge()

    def start_bridge(self) -> Command:
        backend = {"mode": "router", "endpoint": self.ros, "domain-id": f"{DOMAIN}"}
        words = [word for name, value in backend.items() for word in (f"--backend.{name}", value)]
        self.bridge = self._commands.start(
            *("service", "run", "ros2", "--connect", self.ours, "--people", "[anna]", *words),
            environment=self._state,
        )
        return self.bridge

    def end(self) -> None:
        self._commands.kill_all()


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    made = Site(tmp_path_factory.mktemp("site"))
    try:
        yield made
    finally:
        made.end()


@pytest_asyncio.fixture
async def look(site: Site) -> AsyncIterator[Onlooker]:
    async with onlooker(site.ours) as seen:
        await seen.hears("ros2")
        await until(lambda: ANNA not in seen.people, NOTICED_S, "the one before to leave")
        yield seen


@contextlib.asynccontextmanager
async def anna(site: Site) -> AsyncGenerator[Nodes]:
    async with nodes(site.ros, ANNA, at_m=AT_M, yaw_rad=YAW_RAD) as hers:
        yield hers


async def thing(look: Onlooker) -> tuple[str, Vec3]:
    """Return an object that has come onto a belt that stands, and where it is."""
    seen: list[TrackedObjects] = []
    look.bus.subscribe(OBJECTS, lambda message, _name: seen.append(message))
    await until(lambda: bool(seen and seen[-1].objects), NOTICED_S, "an object")
    (first, *_) = seen[-1].objects
    return first.id, first.position_m


async def state(look: Onlooker, wanted: str) -> None:
    states = look.interactions[ANNA]
    await until(lambda: bool(states) and states[-1].state == wanted, NOTICED_S, wanted)


def shown(look: Onlooker) -> bool:
    """Return True if the newest cursor is at this position."""
    cursors = look.cursors[ANNA]
    return bool(cursors) and cursors[-1].point_m is not None


def has_color(frame: StripsFrame) -> bool:
    """Return True if a pixel has her cursor's colour, at any brightness."""
    for strip in frame.strips:
        pixels = [strip.rgb[at : at + 3] for at in range(0, len(strip.rgb), 3)]
        if any(red == blue > 0 == green for red, green, blue in pixels):
            return True
    return False


@pytest.mark.slow
async def test_ros_user_points_and_selects_without_pointit_services(site: Site, look: Onlooker) -> None:
    events: list[SelectionEvent] = []
    profiles: list[UserProfile] = []
    look.bus.subscribe(SELECTION_EVENTS, lambda message, _name: events.append(message))
    look.bus.subscribe(PROFILE, lambda message, _name: profiles.append(message), ANNA)
    target, at_m = await thing(look)
    async with anna(site) as hers:
        hers.points_at(at_m)
        await until(lambda: ANNA in look.people, NOTICED_S, "her presence")
        await state(look, "idle")
        await look.sees_more(look.frames, "strips")
        assert not shown(look)
        assert not has_color(look.frames[-1])

        hers.wants_cursor(wants=True)
        await state(look, "pointing")
        await until(
            lambda: shown(look) and math.dist(look.cursors[ANNA][-1].point_m or (), at_m) < 0.2,
            NOTICED_S,
            "a cursor on the object",
        )
        await until(lambda: bool(profiles), NOTICED_S, "how she is to look")
        assert profiles[-1].cursor_color == tuple(round(255 * each) for each in COLOR)
        assert profiles[-1].cursor_width_m == pytest.approx(WIDTH_M)
        await until(lambda: has_color(look.frames[-1]), NOTICED_S, "strips with her cursor")

        pressed_at: list[int] = []

        def selected() -> bool:
            count = len(look.cursors[ANNA])
            if (
                count - (pressed_at or [-RAYS_PER_S])[-1] >= RAYS_PER_S
            ):  # a second for it to be heard, and done
                hers.presses()
                pressed_at.append(count)
            return any((each.event, each.object_id) == ("selected", target) for each in events)

        await until(selected, NOTICED_S, "the object to be hers")
        assert {each.user for each in events if each.event == "selected"} == {ANNA}

        assert hers.nodes[RAYS] == hers.nodes["/anna/metawear_ros/button"] == {"/anna/nodes"}
        assert "/anna/state_transition" not in hers.nodes
        assert hers.nodes["/anna/cursor"] == {"/pointit"}
        assert [hers.heard[each] for each in (RAYS, SUBSCRIPTION)] == [[], []], "nothing of hers comes back"

        hers.wants_cursor(wants=False)
        await state(look, "idle")
        await until(lambda: not shown(look), NOTICED_S, "her cursor to end")
        assert ANNA in look.people
        hers.wants_cursor(wants=True)
        await state(look, "pointing")
    await until(lambda: ANNA not in look.people, NOTICED_S, "her to have left with her nodes")
    await state(look, "idle")
    await until(lambda: not shown(look), NOTICED_S, "her cursor to end")


@pytest.mark.slow
@pytest.mark.parametrize("number", [pytest.param(signal.SIGINT, marks=pytest.mark.long), signal.SIGKILL])
async def test_ros_user_leaves_and_returns_with_the_bridge(site: Site, look: Onlooker, number: int) -> None:
    _, at_m = await thing(look)
    async with anna(site) as hers:
        hers.points_at(at_m)
        await until(lambda: ANNA in look.people, NOTICED_S, "her presence")
        hers.wants_cursor(wants=True)
        await until(lambda: shown(look), NOTICED_S, "her cursor")

        ended = await site.bridge.stop(number)
        assert "Traceback" not in ended.err
        await until(lambda: ANNA not in look.people, NOTICED_S, "her to have left")
        await until(lambda: not shown(look), NOTICED_S, "her cursor to end")

        if number == signal.SIGINT:
            await state(look, "idle")
        site.start_bridge()
        await until(lambda: ANNA in look.people, NOTICED_S, "her presence again")

        await state(look, "idle")
        assert not shown(look), "subscriptions are not latched: she asks again"

        def asks_again() -> bool:
            hers.wants_cursor(wants=True)
            return shown(look)

        await until(asks_again, NOTICED_S, "her cursor again")
