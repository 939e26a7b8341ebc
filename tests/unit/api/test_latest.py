"""The newest messages of a site, and a tracker's latency and frame, on a bus in memory."""

import asyncio
import contextlib
from collections.abc import Generator

import pytest

from pointit.api.inputs import Tracker
from pointit.api.site import Site
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.errors import AccessDeniedError, NoMessageError, VersionError
from pointit.schemas import Environment, PointingRay, Selection, TrackedObject, TrackedObjects, UserPose
from pointit.schemas.environment import Frame
from pointit.schemas.topics import ANY, MAP, OBJECTS, POSE, RAY, SELECTION, USER_ALIVE
from tests.support.bench import until


async def test_the_latest_is_kept_from_the_first_use_on(bus: MemoryBus, site: Site) -> None:
    poses = bus.publisher(POSE, "anna")
    poses.put(UserPose(stamp_ns=1, position_m=(1.0, 2.0, 0.0), yaw_rad=0.0))
    with pytest.raises(NoMessageError) as raised:
        _ = site.latest.pose["anna"]
    assert str(raised.value).startswith("nothing has come on users/anna/pose yet")
    assert (await site.latest.pose.wait("anna")).stamp_ns == 1

    poses.put(UserPose(stamp_ns=2, position_m=(1.0, 2.0, 0.0), yaw_rad=0.0))
    await until(lambda: site.latest.pose["anna"].stamp_ns == 2, what="the newer pose")
    assert dict(site.latest.pose).keys() == {"anna"}
    assert site.latest.pose.get("ben") is None
    with pytest.raises(NoMessageError, match=r"nothing came on users/ben/pose within 0\.01 s"):
        await site.latest.pose.wait("ben", timeout_s=0.01)
    with pytest.raises(NoMessageError, match="nothing has come on selection yet"):
        _ = site.latest.selection.value

    bus.publisher(SELECTION).put(Selection(stamp_ns=1))
    assert (await site.latest.selection.wait()).stamp_ns == 1 == site.latest.selection.value.stamp_ns


async def test_latest_ends_with_its_person_and_the_pose_returns(bus: MemoryBus, site: Site) -> None:
    anna = bus.announce(USER_ALIVE, "anna")
    bus.publisher(POSE, "anna").put(UserPose(stamp_ns=1, position_m=(1.0, 2.0, 0.0), yaw_rad=0.0))
    assert (await site.latest.pose.wait("anna")).stamp_ns == 1
    anna.close()
    await until(lambda: "anna" not in site.latest.pose, what="no pose of who has left")
    with pytest.raises(NoMessageError, match="or it ended with its writer"):
        _ = site.latest.pose["anna"]
    bus.announce(USER_ALIVE, "anna")
    assert (await site.latest.pose.wait("anna")).stamp_ns == 1


async def test_the_latest_ends_with_the_site(bus: MemoryBus, site: Site) -> None:
    bus.publisher(POSE, "anna").put(UserPose(stamp_ns=1, position_m=(1.0, 2.0, 0.0), yaw_rad=0.0))
    poses = site.latest.pose
    assert (await poses.wait("anna")).stamp_ns == 1

    pending = [asyncio.create_task(wait) for wait in (site.sleep(3600.0), site.wait())]
    await asyncio.sleep(0)
    site.fail(ValueError("broken"))
    for use in (
        lambda: poses["anna"],
        lambda: poses.get("ben"),
        lambda: dict(poses),
        lambda: site.latest.map.value,
    ):
        with pytest.raises(ValueError, match="broken"):
            use()
    with pytest.raises(ValueError, match="broken"):
        await poses.wait("anna")
    for each in pending:
        with pytest.raises(ValueError, match="broken"):
            await each


async def test_the_latest_says_that_nothing_can_be_read(bus: MemoryBus, site: Site) -> None:
    rays = site.latest.ray
    assert len(rays) == 0
    rays._subscriptions[ANY].traffic.invalid = 3
    with pytest.raises(VersionError, match="3 messages came and none could be read"):
        await rays.wait("anna", timeout_s=0.01)
    ray = PointingRay(stamp_ns=1, origin_m=(0.0, 0.0, 0.0), direction=(1.0, 0.0, 0.0))
    bus.publisher(RAY, "ben").put(ray)
    assert await rays.wait("ben") == ray
    with pytest.raises(NoMessageError):
        await rays.wait("anna", timeout_s=0.01)


@pytest.mark.usefixtures("denied")
async def test_the_latest_says_that_nothing_may_be_read(site: Site) -> None:
    with pytest.raises(AccessDeniedError, match="reads users/anna/ray"):
        await site.latest.ray.wait("anna", timeout_s=0.01)


ROOM = Environment(stamp_ns=1, name="room", frames=(Frame(id="optitrack", position_m=(1.0, 2.0, 0.0)),))
CUP = TrackedObject(id="cup", kind="red", position_m=(0.5, 0.0, 1.0), position_sigma_m=0.02)


@pytest.fixture
def heard(bus: MemoryBus) -> list[TrackedObjects]:
    heard: list[TrackedObjects] = []
    bus.subscribe(OBJECTS, lambda message, _name: heard.append(message))
    return heard


@contextlib.contextmanager
def tracked(site: Site, **how: float | str | None) -> Generator[Tracker]:
    with contextlib.closing(site.tracker("camera", **how)) as tracker:  # pyrefly: ignore[bad-argument-type]
        yield tracker


async def test_known_latency_corrects_the_stamp_and_its_sigma_is_sent(
    site: Site, heard: list[TrackedObjects]
) -> None:
    with tracked(site, latency_s=10.0, latency_sigma_s=0.02) as tracker:
        tracker.update([CUP])
        await until(lambda: len(heard) == 1, what="the first message")
        tracker.update([CUP], stamp_ns=5)
        await until(lambda: len(heard) == 2, what="the second message")
    assert heard[0].latency_sigma_s == 0.02
    assert 9.9e9 < site.now_ns() - heard[0].stamp_ns < 20e9
    assert heard[1].stamp_ns == 5
    assert heard[1].objects == (CUP,)


async def test_places_in_a_frame_are_sent_in_the_room(
    bus: MemoryBus, site: Site, heard: list[TrackedObjects]
) -> None:
    with tracked(site, frame="optitrack") as tracker:
        with pytest.raises(NoMessageError, match="nothing has come on map yet"):
            tracker.update([CUP])
        bus.publisher(MAP).put(ROOM)
        await site.latest.map.wait()
        tracker.update([CUP])
        await until(lambda: len(heard) == 1, what="the objects")
    assert heard[0].objects[0].position_m == (1.5, 2.0, 1.0)
    assert heard[0].objects[0].position_sigma_m == 0.02
