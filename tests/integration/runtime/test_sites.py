"""Two sites on one router do not see each other."""

from collections.abc import AsyncIterator

import pytest
import pytest_asyncio

from pointit.runtime.errors import NoAnswerError
from pointit.runtime.link.link import Link
from pointit.runtime.router import running_router
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import ButtonEvent, Done, ImuSample, KeyNameError, SetBrightness, UserProfile
from pointit.schemas.topics import BUTTON, IMU, PROFILE, SET_BRIGHTNESS, USER_ALIVE
from tests.support.bench import until
from tests.support.buses import free_port, settled


@pytest_asyncio.fixture
async def endpoint() -> AsyncIterator[str]:
    where = f"tcp/127.0.0.1:{free_port()}"
    async with running_router((where,)):
        yield where


async def test_sites_are_isolated_from_each_other(endpoint: str) -> None:
    async def done(_query: SetBrightness, _name: str) -> Done:
        return Done()

    mine, same, other = [
        await ZenohBus.open(Link(site=site, connect=(endpoint,)), patience_s=30)
        for site in ("lab", "lab", "lab-2")
    ]
    seen: dict[ZenohBus, list[object]] = {same: [], other: []}
    early_state = mine.publisher(PROFILE, "early")
    early_state.put(UserProfile(stamp_ns=1))
    for bus, found in seen.items():
        for topic in (IMU, BUTTON, PROFILE):
            bus.subscribe(topic, lambda _message, name, found=found, key=topic.key: found.append((key, name)))  # pyrefly: ignore[bad-argument-type]
        bus.watch(USER_ALIVE, lambda name, *, present, found=found: found.append((name, present)))
    mine.serve(SET_BRIGHTNESS, done)
    await settled(mine, same)
    mine.announce(USER_ALIVE, "anna")
    imu = mine.publisher(IMU, "anna")
    button = mine.publisher(BUTTON, "anna")
    profile = mine.publisher(PROFILE, "anna")
    button.put(ButtonEvent(stamp_ns=1))
    profile.put(UserProfile(stamp_ns=1))

    def everything() -> bool:
        imu.put(ImuSample(stamp_ns=1, orientation_xyzw=(0, 0, 0, 1)))
        return {
            ("users/{user}/imu", "anna"),
            ("users/{user}/button", "anna"),
            ("users/{user}/profile", "anna"),
            ("users/{user}/profile", "early"),
            ("anna", True),
        } <= set(seen[same])

    await until(everything)
    await same.call(SET_BRIGHTNESS, SetBrightness(brightness=1))
    with pytest.raises(NoAnswerError):
        await other.call(SET_BRIGHTNESS, SetBrightness(brightness=1))
    assert seen[other] == []
    for bus in (mine, same, other):
        await bus.close()


@pytest.mark.parametrize("site", ["", "*", "a/b", "lab/**", "ä", "@"])
async def test_a_site_that_would_see_others_is_refused(site: str, endpoint: str) -> None:
    with pytest.raises(KeyNameError, match="site"):
        await ZenohBus.open(Link(site=site, connect=(endpoint,)))
