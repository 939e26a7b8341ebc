"""The localizer on the bus: anchors, headings, drift, trackers outside, an IMU whose yaw starts again."""

import asyncio
import math
from typing import Any, Literal

import pytest

from pointit.geometry import rotation, vector
from pointit.runtime.bus.contract import Publisher
from pointit.runtime.clock import Clock, sleep
from pointit.runtime.errors import RefusedError
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import (
    NS_PER_S,
    ImuSample,
    Interaction,
    PointAnchor,
    PointingRay,
    SetHeading,
    SetPose,
    StartLocalization,
    UserPose,
)
from pointit.schemas import topics as at
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.pose_manager import YawOrigin
from pointit.services.localizer.service import Localizer
from tests.support.bench import ManualClock, background, in_virtual_time, memory_bench, until
from tests.unit.localizer.person import ROOM, USER, Person, yaw_difference
from tests.unit.localizer.wearer import Wearer, worn

FIXED = LocalizerConfig(position_m=(1.5, 1.2, 0.0), yaw_deg=20.0, reaction_s=0.5, hold_s=1.0)
LAMPS_FIRST = FIXED.model_copy(update={"method": "static_targets"})
DEGREE = math.radians(1.0)


def person(yaw_deg: float) -> Person:
    """Return a person at the position of `FIXED` whose {H} is turned by `yaw_deg`."""
    return Person(1.5, 1.2, yaw_deg * DEGREE)


@in_virtual_time
async def test_anchor_corrects_a_fixed_pose_that_is_tracked_afterwards() -> None:
    async with worn(FIXED, VirtualClock(), person(28.0)) as wearer:
        assert len(wearer.poses) == 1
        living = asyncio.create_task(wearer.live())
        assert await wearer.call(at.POINT_ANCHOR, PointAnchor(lamp="led_1")) == "point at led_1"
        await until(lambda: wearer.progress[-1].target_id == "led_1", what="the lamp")

        sampling = wearer.progress[-1]
        assert (sampling.phase, sampling.purpose, sampling.target_id) == ("sampling", "anchor", "led_1")
        assert (await wearer.until_phase("solved")).purpose == "anchor"

        (anchor,) = wearer.anchors
        assert anchor.accepted
        assert anchor.azimuth_error_rad == pytest.approx(8.0 * DEGREE, abs=0.5 * DEGREE)

        anchored = wearer.poses[1]
        assert abs(yaw_difference(anchored.yaw_rad, 28.0 * DEGREE)) < 0.5 * DEGREE
        assert anchored.position_m == pytest.approx((1.5, 1.2, 0.0), abs=0.03)
        assert anchored.anchored_ns > 0
        await until(lambda: len(wearer.poses) > 4, what="the pose to be followed")

        stamps = [pose.stamp_ns for pose in wearer.poses]
        assert stamps == sorted(set(stamps))
        await until(lambda: (wearer.figure("anchor age") or 0.0) > 1.0, what="the anchor's age")
        assert wearer.figure("yaw σ") is not None  # noqa: RUF001 - sigma is meant
        living.cancel()


async def test_impossible_anchor_is_refused_immediately() -> None:
    async with worn(LAMPS_FIRST, environment=None) as wearer:

        async def reason(lamp: str = "") -> str:
            with pytest.raises(RefusedError) as refused:
                await wearer.call(at.POINT_ANCHOR, PointAnchor(lamp=lamp))
            return str(refused.value)

        assert (await reason()).startswith("no pose of anna is known; localize first")
        await wearer.call(at.SET_POSE, SetPose(position_m=(1.5, 1.2, 0.0)))
        assert "no map yet" in await reason()
        wearer.bench.put(at.MAP, ROOM.model_copy(update={"lamps": ()}))
        await wearer.bench.settle()
        assert "has none; add it to the map" in await reason()
        wearer.bench.put(at.MAP, ROOM)
        await wearer.bench.settle()
        assert "lamps led_7 are not on map 'lab'" in await reason("led_7")
        await wearer.call(at.START_LOCALIZATION, StartLocalization())
        assert "anna is being localized now" in await reason()


async def test_unknown_yaw_warning_has_the_remedy_until_an_anchor() -> None:
    clock = ManualClock()
    async with worn(FIXED.model_copy(update={"track_drift": True}), clock) as wearer:
        clock.advance(60.0)
        await wearer.until_warned("`pointit person anchor anna`")
        await wearer.until_warned("uncertain by 15°")
        assert wearer.poses[-1].covariance[8] > (14.0 * DEGREE) ** 2
        await wearer.call(at.SET_POSE, SetPose(position_m=(1.5, 1.2, 0.0)))
        await until(lambda: not wearer.warnings, what="the warning to go")


@pytest.mark.parametrize(("state", "rate_degps"), [("idle", 0.3), ("pointing", 0.0)])
async def test_resting_arm_measures_drift_only_while_no_cursor_is_shown(
    state: Literal["idle", "pointing"], rate_degps: float
) -> None:
    clock = ManualClock()
    async with worn(FIXED.model_copy(update={"track_drift": True}), clock) as wearer:
        await wearer.put(at.INTERACTION, Interaction(stamp_ns=clock.now_ns(), state=state))
        for tick in range(15 * 25):
            now_ns = clock.advance(0.04)
            arm = rotation.from_azimuth_elevation(-0.3 * DEGREE * tick * 0.04, -1.2)
            await wearer.put(at.IMU, ImuSample(stamp_ns=now_ns, orientation_xyzw=arm))
        await until(lambda: wearer.poses[-1].stamp_ns >= clock.now_ns(), what="a pose")
        assert wearer.poses[-1].yaw_rate_radps == pytest.approx(rate_degps * DEGREE, rel=0.3)


async def test_facing_the_wall_sets_the_yaw() -> None:
    clock = ManualClock()
    async with worn(FIXED, clock) as wearer:
        query = SetHeading(azimuth_rad=90.0 * DEGREE)
        with pytest.raises(RefusedError, match="no rays come"):
            await wearer.call(at.SET_HEADING, query)
        for _ in range(30):
            direction = vector.direction(30.0 * DEGREE, -0.1)
            ray = PointingRay(stamp_ns=clock.advance(0.02), origin_m=(0.0, 0.0, 1.6), direction=direction)
            await wearer.put(at.RAY, ray)
        assert (await wearer.call(at.SET_HEADING, query)).startswith("the yaw is set; ")
        pose = wearer.poses[-1]
        assert abs(yaw_difference(pose.yaw_rad, 60.0 * DEGREE)) < 2.0 * DEGREE
        assert pose.position_m == pytest.approx((1.5, 1.2, 0.0))


def tracked(clock: Clock, x_m: float = 7.0) -> UserPose:
    return UserPose(stamp_ns=clock.now_ns(), position_m=(x_m, 0.0, 0.0), yaw_rad=0.0, method="external")


async def test_localizer_pauses_when_a_tracker_provides_the_pose() -> None:
    clock = ManualClock()
    async with worn(LAMPS_FIRST, clock) as wearer:
        await wearer.call(at.SET_POSE, SetPose(position_m=(3.0, 4.0, 0.0)))
        await wearer.call(at.START_LOCALIZATION, StartLocalization())
        assert wearer.progress[-1].target_id

        await wearer.put(at.POSE, tracked(clock))
        assert wearer.progress[-1].phase == "cancelled"
        assert wearer.progress[-1].reason.startswith("a tracker provides the pose of anna now")

        count = len(wearer.progress)
        await wearer.put(at.POSE, tracked(clock, 7.1))
        assert len(wearer.progress) == count  # it says so once

        late = wearer.bench.collect(at.POSE, USER)
        await wearer.bench.settle()
        assert [pose.position_m[0] for pose in late] == [7.1]

        clock.advance(1.0)
        for asking in (
            wearer.call(at.START_LOCALIZATION, StartLocalization()),
            wearer.call(at.SET_POSE, SetPose(position_m=(0.0, 0.0, 0.0))),
            wearer.call(at.SET_HEADING, SetHeading(azimuth_rad=0.0)),
        ):
            with pytest.raises(RefusedError, match=r"a tracker provides the pose of anna, last 1.0 s ago"):
                await asking
        await until(lambda: wearer.figure("external pose") == 1.0, what="the figure")

        clock.advance(1.5)
        await wearer.until_warned("the tracker that gave the pose of anna is silent")
        with pytest.raises(RefusedError, match="is silent for"):
            await wearer.call(at.POINT_ANCHOR, PointAnchor())

        known = len(wearer.poses)
        await wearer.bench.settle()
        assert len(wearer.poses) == known  # nobody asked

        await wearer.call(at.SET_POSE, SetPose(position_m=(5.0, 5.0, 0.0)))
        assert (wearer.poses[-1].position_m, wearer.poses[-1].method) == ((5.0, 5.0, 0.0), "fixed")
        await until(lambda: wearer.figure("external pose") is None, what="the figure to go")


async def test_our_last_pose_is_taken_back_when_a_tracker_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a real network each writer keeps its last value, and who joins late would get both."""
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        closed: list[str] = []
        declare = bench.bus.publisher

        def publisher(topic: at.Topic[Any], name: str = "") -> Publisher[Any]:
            inner = declare(topic, name)
            close = inner.close

            def noted() -> None:
                closed.append(topic.at(name))
                close()

            monkeypatch.setattr(inner, "close", noted)
            return inner

        monkeypatch.setattr(bench.bus, "publisher", publisher)
        wearer = Wearer(bench, person(20.0))
        bench.start(Localizer, FIXED, USER)
        await bench.settle()
        assert closed == []
        await wearer.put(at.POSE, tracked(clock))
        await until(lambda: closed == [at.POSE.at(USER)], what="taking back")


@in_virtual_time
async def test_an_anchor_beside_a_tracker_tells_how_the_person_points() -> None:
    clock = VirtualClock()
    async with worn(FIXED, clock, person(5.0)) as wearer:

        async def track() -> None:
            while True:
                await wearer.put(at.POSE, tracked(clock).model_copy(update={"position_m": (1.5, 1.2, 0.0)}))
                await sleep(clock, 0.5)

        async with background(track()), background(wearer.live()):
            await until(lambda: any("localizer pauses" in it.reason for it in wearer.progress), what="pause")
            await wearer.call(at.POINT_ANCHOR, PointAnchor(lamp="led_1"))
            await wearer.until_phase("solved")
        (anchor,) = wearer.anchors
        assert not anchor.accepted
        assert anchor.azimuth_error_rad == pytest.approx(5.0 * DEGREE, abs=0.5 * DEGREE)
        assert {pose.method for pose in wearer.poses[1:]} == {"external"}


# an IMU whose yaw starts again

FOUND = SetPose(
    position_m=(1.5, 1.2, 0.0),
    method="static_targets",
    covariance=(0.01, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.001),
)


def sample(t_s: float, epoch: int = 0, device_s: float | None = None) -> ImuSample:
    return ImuSample(
        stamp_ns=round(t_s * NS_PER_S),
        orientation_xyzw=rotation.IDENTITY,
        yaw_epoch=epoch,
        device_time_ns=None if device_s is None else round(device_s * NS_PER_S),
    )


def test_yaw_origin_finds_changes_and_restarts_in_samples() -> None:
    origin = YawOrigin()
    for t_s, epoch, device_s, said in (
        (0.0, 3, 50.0, ""),  # the first one tells nothing
        (0.1, 3, 49.5, ""),  # out of order
        (0.2, 3, 50.2, ""), (0.3, 4, 50.3, "set"), (0.4, 4, 1.0, "restarted"), (0.5, 4, 1.1, ""),
        (0.7, 0, None, "set"),  # who counts was restarted
        (0.8, 0, 900.0, ""),
    ):  # fmt: skip
        assert origin.add(sample(t_s, epoch, device_s)) == said, t_s


async def send(wearer: Wearer, clock: ManualClock, epoch: int, device_s: float | None = None) -> None:
    now_ns = clock.advance(0.05)
    await wearer.put(at.IMU, sample(0.0, epoch, device_s).model_copy(update={"stamp_ns": now_ns}))


@pytest.mark.parametrize(("epoch", "device_s"), [(1, 10.1), (0, 1.0)], ids=["new origin", "restarted"])
async def test_the_yaw_is_unknown_and_it_is_said_until_told(epoch: int, device_s: float) -> None:
    clock = ManualClock()
    async with worn(LAMPS_FIRST, clock) as wearer:
        await wearer.call(at.SET_POSE, FOUND)
        await send(wearer, clock, 0, 10.0)
        count = len(wearer.poses)
        await send(wearer, clock, epoch, device_s)
        assert len(wearer.poses) == count + 1

        lost = wearer.poses[-1]
        assert math.sqrt(lost.covariance[8]) >= math.pi / 2
        assert lost.position_m == pytest.approx((1.5, 1.2, 0.0))

        await wearer.until_warned("the IMU of anna was restarted or turned")
        (warning,) = wearer.warnings
        assert "`pointit person anchor anna`" in warning
        assert "`pointit person pose anna --facing" in warning

        await send(wearer, clock, epoch, device_s + 0.1)
        assert len(wearer.poses) == count + 1  # once
        await wearer.call(at.SET_POSE, FOUND)
        await until(lambda: not wearer.warnings, what="the warning to go")


async def test_pointing_that_goes_on_meanwhile_is_refused() -> None:
    clock = ManualClock()
    async with worn(FIXED, clock) as wearer:
        await send(wearer, clock, 0)
        await wearer.call(at.POINT_ANCHOR, PointAnchor())
        await send(wearer, clock, 1)
        assert wearer.progress[-1].phase == "refused"
        said = wearer.progress[-1].reason
        assert said == "the IMU of anna was restarted or turned meanwhile; start again"
