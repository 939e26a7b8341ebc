"""The newest messages of a site, on a bus in memory."""

import asyncio

import pytest

from pointit.api.site import Site
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.errors import AccessDeniedError, NoMessageError, VersionError
from pointit.schemas import PointingRay, Selection, UserPose
from pointit.schemas.topics import ANY, POSE, RAY, SELECTION
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
        await site.latest.pose.wait("ben", patience_s=0.01)
    with pytest.raises(NoMessageError, match="nothing has come on selection yet"):
        _ = site.latest.selection.value
    bus.publisher(SELECTION).put(Selection(stamp_ns=1))
    assert (await site.latest.selection.wait()).stamp_ns == 1 == site.latest.selection.value.stamp_ns


async def test_the_latest_ends_with_the_site(bus: MemoryBus, site: Site) -> None:
    bus.publisher(POSE, "anna").put(UserPose(stamp_ns=1, position_m=(1.0, 2.0, 0.0), yaw_rad=0.0))
    poses = site.latest.pose
    assert (await poses.wait("anna")).stamp_ns == 1
    sleeping = asyncio.create_task(site.sleep(3600.0))
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
    with pytest.raises(ValueError, match="broken"):
        await sleeping


async def test_the_latest_says_that_nothing_can_be_read(bus: MemoryBus, site: Site) -> None:
    rays = site.latest.ray
    assert len(rays) == 0
    rays._subscriptions[ANY].traffic.invalid = 3
    with pytest.raises(VersionError, match="3 messages came and none could be read"):
        await rays.wait("anna", patience_s=0.01)
    ray = PointingRay(stamp_ns=1, origin_m=(0.0, 0.0, 0.0), direction=(1.0, 0.0, 0.0))
    bus.publisher(RAY, "ben").put(ray)
    assert await rays.wait("ben") == ray
    with pytest.raises(NoMessageError):
        await rays.wait("anna", patience_s=0.01)


@pytest.mark.usefixtures("denied")
async def test_the_latest_says_that_nothing_may_be_read(site: Site) -> None:
    with pytest.raises(AccessDeniedError, match="reads users/anna/ray"):
        await site.latest.ray.wait("anna", patience_s=0.01)
