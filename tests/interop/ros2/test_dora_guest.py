"""An independent ROS node is all the nodes of a person: she has a cursor here, and no service of ours."""

import contextlib
import math
import time
from collections.abc import AsyncGenerator, Iterator
from pathlib import Path

import pytest

from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import Environment
from pointit.schemas.topics import MAP
from tests.interop.ros2.peers import Site, site
from tests.support.bench import repeated, until
from tests.support.commands import onlooker

NOTICED_S = 20.0
RAY_HZ = 50.0
ANNA = "anna"
AT_M = (-1.3, -1.9, 0.0)
YAW_RAD = math.radians(20.0)
EYES_M = (0.0, 0.0, 1.64)
RAYS = "/anna/pointing_ray"
SUBSCRIPTION = "/PUI_subscription"


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory, peers_python: Path) -> Iterator[Site]:
    with site(tmp_path_factory.mktemp("site"), peers_python) as made:
        made.run_with_bridge("--set", "ros2.people=[anna]")
        made.dora.start()
        yield made


def named(values: tuple[float, ...]) -> dict[str, float]:
    return dict(zip("xyzw", values, strict=False))


@contextlib.asynccontextmanager
async def points_at(place: Site, target_m: Vec3) -> AsyncGenerator[None]:
    """Have the peer say all the time where she stands, and her ray to a place in the room."""
    wanted = vector.subtract(vector.rotate_z(vector.subtract(target_m, AT_M), -YAW_RAD), EYES_M)
    way = rotation.from_azimuth_elevation(vector.azimuth(wanted), vector.elevation(wanted))
    pose = {"position": named(EYES_M), "orientation": named(way)}
    moved = {"translation": named(AT_M), "rotation": named(rotation.from_yaw(YAW_RAD))}

    async def say() -> None:
        sec, nanosec = divmod(time.time_ns(), 1_000_000_000)
        stamp = {"sec": sec, "nanosec": nanosec}
        frame = f"{ANNA}/human_footprint"
        header = {"stamp": stamp, "frame_id": "world"}
        transform = {"header": header, "child_frame_id": frame, "transform": moved}
        await place.dora.says("/tf", {"transforms": [transform]})
        await place.dora.says(RAYS, {"header": {"stamp": stamp, "frame_id": frame}, "pose": pose})

    async with repeated(1.0 / RAY_HZ, say):
        yield


async def test_person_of_the_peer_has_a_cursor_while_subscribed(place: Site) -> None:
    dora = place.dora
    wish = {
        "user_name": ANNA,
        "pointer_size": 0.2,
        "pointer_cmap": "",
        "pointer_color": {"r": 1.0, "g": 0.0, "b": 1.0, "a": 1.0},
    }
    async with onlooker(place.ours) as look:
        rooms: list[Environment] = []
        look.bus.subscribe(MAP, lambda message, _name: rooms.append(message))
        await until(lambda: bool(rooms), NOTICED_S, "the map")

        await dora.sees("/MS/", "/pointit/%anna%pointing_ray/")
        await dora.advertises(RAYS, "geometry_msgs/msg/PoseStamped")
        await dora.advertises("/tf", "tf2_msgs/msg/TFMessage")
        await dora.advertises(SUBSCRIPTION, "conveyor_msgs/msg/PUISubscription")
        (belt, *_) = (each for each in rooms[-1].belts if each.id == "part_a")
        target_m = vector.scale(vector.add(*belt.line_m[:2]), 0.5)
        cursors = look.cursors[ANNA]
        states = look.interactions[ANNA]
        async with points_at(place, target_m):
            await until(lambda: ANNA in look.people, NOTICED_S, "her presence")
            assert not any(each.point_m for each in cursors)
            await dora.says(SUBSCRIPTION, wish | {"subscribe": True})
            await until(
                lambda: bool(cursors) and math.dist(cursors[-1].point_m or AT_M, target_m) < 0.1,
                NOTICED_S,
                "her cursor",
            )

            await dora.do("listen", topic="/anna/cursor", type="geometry_msgs/msg/PointStamped")
            at = await dora.hears("/anna/cursor")
            assert math.dist((at["point"]["x"], at["point"]["y"], at["point"]["z"]), target_m) < 0.1

            await dora.sees("/MP/", "/pointit/%anna%pointing_ray/", gone=True)
            await dora.says(SUBSCRIPTION, wish | {"subscribe": False})
            await until(lambda: states[-1].state == "idle", NOTICED_S, "no cursor any more")
            await until(lambda: cursors[-1].point_m is None, NOTICED_S, "its end")

        await until(lambda: ANNA not in look.people, NOTICED_S, "her to have left")
