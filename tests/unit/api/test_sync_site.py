"""A site without asyncio, on a bus in memory."""

from collections.abc import Iterator

import pytest

from pointit.api.loop_thread import LoopThread
from pointit.api.sync_site import SyncSite
from pointit.errors import KeyNameError, SchemaError
from pointit.schemas import TrackedObject
from tests.contract.public_api import in_memory

CUP = TrackedObject(id="cup", kind="red", position_m=(1.0, 2.0, 0.8))


@pytest.fixture
def site() -> Iterator[SyncSite]:
    with SyncSite(in_memory(), LoopThread()) as site:
        yield site


def test_objects_may_come_from_a_generator_that_uses_the_site(site: SyncSite) -> None:
    things = site.objects("camera")
    site.tracker("camera").update(CUP for _ in [site.now_ns()])
    assert next(things).objects == (CUP,)


def test_the_thread_of_the_site_does_not_wait_for_itself(site: SyncSite) -> None:
    with pytest.raises(RuntimeError, match="the loop of the site cannot wait for itself"):
        site._thread.call(site.now_ns)


@pytest.mark.parametrize(("objects", "stamp_ns"), [([CUP], -1), ([7], 1)])
def test_wrong_objects_are_named(site: SyncSite, objects: list[TrackedObject], stamp_ns: int) -> None:
    with pytest.raises(SchemaError, match="objects/camera: "):
        site.tracker("camera").update(objects, stamp_ns=stamp_ns)


def test_an_empty_name_is_not_everybodys(site: SyncSite) -> None:
    with pytest.raises(KeyNameError, match="user ''"):
        site.cursors("")
    with pytest.raises(KeyNameError, match="user ''"):
        site.selections("")
    with pytest.raises(KeyNameError, match="lamp ''"):
        site.lamp("")


def test_the_traceback_of_a_wrong_name_has_no_frames_of_the_sites_thread(site: SyncSite) -> None:
    with pytest.raises(KeyNameError, match="user ''") as told:
        site.cursors("")
    assert [frame.name for frame in told.traceback[1:]] == ["iterating", "call", "run"]
