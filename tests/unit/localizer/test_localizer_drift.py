"""The localizer on the bus: anchors, headings, drift, trackers outside."""

import asyncio
import math
from typing import Any, Literal

import pytest

from pointit.geometry import rotation, vector
from pointit.runtime.bus.contract import Publisher
from pointit.runtime.clock import sleep
from pointit.runtime.errors import RefusedError
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import (
    CancelLocalization,
    Health,
    ImuSample,
    Interaction,
    Localization,
    PointAnchor,
    PointingRay,
    SetHeading,
    SetPose,
    StartLocalization,
    UserPose,
)
from pointit.schemas.topics import (
    ANCHOR,
    CANCEL_LOCALIZATION,
    HEALTH,
    IMU,
    INTERACTION,
    LOCALIZATION,
    MAP,
    POINT_ANCHOR,
    POSE,
    RAY,
    SET_HEADING,
    SET_POSE,
    START_LOCALIZATION,
    Topic,
)
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.service import Localizer
from tests.support.bench import Bench, ManualClock, in_virtual_time, memory_bench, until
from tests.unit.localizer.lab import PLACES, ROOM
from tests.unit.localizer.person import Person, yaw_difference

FIXED = LocalizerConfig(position_m=(1.5, 1.2, 0.0), yaw_deg=20.0, reaction_s=0.5, hold_s=1.0)
LAMPS_FIRST = FIXED.model_copy(update={"method": "static_targets"})
USER = "anna"
DEGREE = math.radians(1.0)


class Wearer:
    """Points at what the localizer names, or ahead; {H} may have turned meanwhile."""

    def __init__(self, bench: Bench, yaw_rad: float = 20.0 * DEGREE) -> None:
        self.bench = bench
        self.person = Person(1.5, 1.2, yaw_rad)
        self.poses = bench.collect(POSE, USER)
        self.progress = bench.collect(LOCALIZATION, USER)
        self.anchors = bench.collect(ANCHOR, USER)
        self.health = bench.collect(HEALTH)

    async def live(self) -> None:
        """Point, 50 rays a second of the clock."""
        clock = self.bench.clock
        while True:
            asked = self.progress[-1].target_id if self.progress else ""
            target = PLACES.get(asked, (3.0, 3.0, 1.2))
            self.bench.put(RAY, self.person.ray(target, clock.now_ns()), USER)
            await sleep(clock, 0.02)

    async def until_phase(self, phase: str) -> Localization:
        await until(lambda: self.progress[-1].phase == phase, what=f"{phase}, was {self.progress[-1]}")
        return self.progress[-1]

    @property
    def warnings(self) -> tuple[str, ...]:
        return self.health[-1].warnings if self.health else ()

    def figure(self, name: str) -> float | None:
        last: Health = self.health[-1]
        return next((figure.value for figure in last.figures if figure.name == name), None)


async def ready(bench: Bench, config: LocalizerConfig) -> None:
    bench.put(MAP, ROOM)
    bench.start(Localizer, config, USER)
    await bench.settle()


@in_virtual_time
async def test_an_anchor_sets_a_fixed_pose_right_and_from_then_on_it_is_followed() -> None:
    clock = VirtualClock()
    async with memory_bench(clock) as bench:
        wearer = Wearer(bench, 28.0 * DEGREE)
        await ready(bench, FIXED)
        assert len(wearer.poses) == 1
        living = asyncio.create_task(wearer.live())
        done = await bench.bus.call(POINT_ANCHOR, PointAnchor(lamp="led_1"), USER)
        assert done.message == "point at led_1"
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


async def test_the_lamp_that_tells_most_about_the_yaw_is_taken_when_none_is_named() -> None:
    async with memory_bench(ManualClock()) as bench:
        wearer = Wearer(bench)
        await ready(bench, FIXED)
        done = await bench.bus.call(POINT_ANCHOR, PointAnchor(), USER)
        assert done.message == "point at led_0"  # far away and at eye height
        await bench.settle()
        cancelled = await bench.bus.call(CANCEL_LOCALIZATION, CancelLocalization(), USER)
        assert cancelled.message == "cancelled; the last pose stays"
        await bench.settle()
        assert (wearer.progress[-1].phase, wearer.progress[-1].purpose) == ("cancelled", "anchor")


async def test_impossible_anchor_is_refused_immediately() -> None:
    async with memory_bench(ManualClock()) as bench:
        bench.start(Localizer, LAMPS_FIRST, USER)
        await bench.settle()

        async def reason(lamp: str = "") -> str:
            with pytest.raises(RefusedError) as refused:
                await bench.bus.call(POINT_ANCHOR, PointAnchor(lamp=lamp), USER)
            return str(refused.value)

        assert (await reason()).startswith("no pose of anna is known; localize first")
        await bench.bus.call(SET_POSE, SetPose(position_m=(1.5, 1.2, 0.0)), USER)
        assert "no map yet" in await reason()
        bench.put(MAP, ROOM.model_copy(update={"lamps": ()}))
        await bench.settle()
        assert "has none; add it to the map" in await reason()
        bench.put(MAP, ROOM)
        await bench.settle()
        assert "lamps led_7 are not on map 'lab'" in await reason("led_7")
        await bench.bus.call(START_LOCALIZATION, StartLocalization(), USER)
        assert "anna is being localized now" in await reason()


async def test_silence_at_an_anchor_is_refused_and_shown_in_health() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        wearer = Wearer(bench)
        await ready(bench, FIXED)
        await bench.bus.call(POINT_ANCHOR, PointAnchor(), USER)
        clock.advance(20.0)
        refused = await wearer.until_phase("refused")
        assert "only 0 rays came while led_0 was lit" in refused.reason
        assert wearer.anchors == []
        await until(lambda: any("only 0 rays" in text for text in wearer.warnings), what="the warning")
        assert len(wearer.poses) == 1


async def test_an_untold_yaw_is_warned_of_with_the_remedy_until_an_anchor() -> None:
    clock = ManualClock()
    config = FIXED.model_copy(update={"track_drift": True})
    async with memory_bench(clock) as bench:
        wearer = Wearer(bench)
        await ready(bench, config)
        clock.advance(60.0)
        await until(
            lambda: any("`pointit person anchor anna`" in text for text in wearer.warnings),
            what="the warning",
        )
        assert any("uncertain by 15°" in text for text in wearer.warnings)
        assert wearer.poses[-1].covariance[8] > (14.0 * DEGREE) ** 2
        await bench.bus.call(SET_POSE, SetPose(position_m=(1.5, 1.2, 0.0)), USER)
        await until(lambda: not wearer.warnings, what="the warning to go")


@pytest.mark.parametrize(("state", "rate_degps"), [("idle", 0.3), ("pointing", 0.0)])
async def test_a_resting_arm_is_listened_to_while_no_cursor_is_shown(
    state: Literal["idle", "pointing"], rate_degps: float
) -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        wearer = Wearer(bench)
        await ready(bench, FIXED.model_copy(update={"track_drift": True}))
        bench.put(INTERACTION, Interaction(stamp_ns=clock.now_ns(), state=state), USER)
        await bench.settle()
        for tick in range(15 * 25):
            now_ns = clock.advance(0.04)
            arm = rotation.from_azimuth_elevation(-0.3 * DEGREE * tick * 0.04, -1.2)
            bench.put(IMU, ImuSample(stamp_ns=now_ns, orientation_xyzw=arm), USER)
            await bench.settle(3)
        await until(lambda: wearer.poses[-1].stamp_ns >= clock.now_ns(), what="a pose")
        assert wearer.poses[-1].yaw_rate_radps == pytest.approx(rate_degps * DEGREE, rel=0.3)


async def test_facing_the_wall_sets_the_yaw() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        wearer = Wearer(bench)
        await ready(bench, FIXED)
        query = SetHeading(azimuth_rad=90.0 * DEGREE)
        with pytest.raises(RefusedError, match="no rays come"):
            await bench.bus.call(SET_HEADING, query, USER)
        for _ in range(30):
            now_ns = clock.advance(0.02)
            level = vector.direction(30.0 * DEGREE, -0.1)
            bench.put(RAY, PointingRay(stamp_ns=now_ns, origin_m=(0.0, 0.0, 1.6), direction=level), USER)
            await bench.settle(3)
        done = await bench.bus.call(SET_HEADING, query, USER)
        assert done.message.startswith("the yaw is set; ")
        await bench.settle()
        pose = wearer.poses[-1]
        assert abs(yaw_difference(pose.yaw_rad, 60.0 * DEGREE)) < 2.0 * DEGREE
        assert pose.position_m == pytest.approx((1.5, 1.2, 0.0))


async def test_without_a_pose_a_heading_is_refused() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        await ready(bench, LAMPS_FIRST)
        for _ in range(30):
            now_ns = clock.advance(0.02)
            ray = PointingRay(stamp_ns=now_ns, origin_m=(0.0, 0.0, 1.6), direction=(1.0, 0.0, 0.0))
            bench.put(RAY, ray, USER)
            await bench.settle(3)
        with pytest.raises(RefusedError, match="no pose of anna is known"):
            await bench.bus.call(SET_HEADING, SetHeading(azimuth_rad=0.0), USER)


def tracked(clock: ManualClock, x_m: float = 7.0) -> UserPose:
    return UserPose(stamp_ns=clock.now_ns(), position_m=(x_m, 0.0, 0.0), yaw_rad=0.0, method="external")


async def test_where_a_tracker_gives_the_pose_the_localizer_stands_back() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        wearer = Wearer(bench)
        await ready(bench, LAMPS_FIRST)
        await bench.bus.call(SET_POSE, SetPose(position_m=(3.0, 4.0, 0.0)), USER)
        await bench.bus.call(START_LOCALIZATION, StartLocalization(), USER)
        await bench.settle()
        assert wearer.progress[-1].target_id
        bench.put(POSE, tracked(clock), USER)
        await bench.settle()
        assert wearer.progress[-1].phase == "cancelled"
        assert wearer.progress[-1].reason.startswith("a tracker provides the pose of anna now")
        count = len(wearer.progress)
        bench.put(POSE, tracked(clock, 7.1), USER)
        await bench.settle()
        assert len(wearer.progress) == count  # it says so once
        late = bench.collect(POSE, USER)
        await bench.settle()
        assert [pose.position_m[0] for pose in late] == [7.1]
        clock.advance(1.0)
        for asking in (
            bench.bus.call(START_LOCALIZATION, StartLocalization(), USER),
            bench.bus.call(SET_POSE, SetPose(position_m=(0.0, 0.0, 0.0)), USER),
            bench.bus.call(SET_HEADING, SetHeading(azimuth_rad=0.0), USER),
        ):
            with pytest.raises(RefusedError, match=r"a tracker provides the pose of anna, last 1.0 s ago"):
                await asking
        await until(lambda: wearer.figure("external pose") == 1.0, what="the figure")
        clock.advance(1.5)
        await until(
            lambda: any("the tracker that gave the pose of anna is silent" in w for w in wearer.warnings),
            what="the warning",
        )
        with pytest.raises(RefusedError, match="is silent for"):
            await bench.bus.call(POINT_ANCHOR, PointAnchor(), USER)
        known = len(wearer.poses)
        await bench.settle()
        assert len(wearer.poses) == known  # nobody asked
        await bench.bus.call(SET_POSE, SetPose(position_m=(5.0, 5.0, 0.0)), USER)
        await bench.settle()
        assert wearer.poses[-1].position_m == (5.0, 5.0, 0.0)
        assert wearer.poses[-1].method == "fixed"
        await until(lambda: wearer.figure("external pose") is None, what="the figure to go")


async def test_our_last_pose_is_taken_back_when_a_tracker_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a real network each writer keeps its last value, and who joins late would get both."""
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        closed: list[str] = []
        declare = bench.bus.publisher

        def publisher(topic: Topic[Any], name: str = "") -> Publisher[Any]:
            inner = declare(topic, name)
            close = inner.close

            def noted() -> None:
                closed.append(topic.at(name))
                close()

            monkeypatch.setattr(inner, "close", noted)
            return inner

        monkeypatch.setattr(bench.bus, "publisher", publisher)
        await ready(bench, FIXED)
        assert closed == []
        bench.put(POSE, tracked(clock), USER)
        await until(lambda: closed == [POSE.at(USER)], what="taking back")


async def test_idle_localizer_reports_that_a_tracker_provides_the_pose() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        wearer = Wearer(bench)
        await ready(bench, FIXED)
        bench.put(POSE, tracked(clock), USER)
        await until(lambda: "localizer pauses" in wearer.progress[-1].reason, what="pausing")
        assert wearer.progress[-1].phase == "idle"
        late = bench.collect(POSE, USER)
        await bench.settle()
        assert all(pose.method == "external" for pose in late)


@in_virtual_time
async def test_an_anchor_beside_a_tracker_tells_how_the_person_points() -> None:
    clock = VirtualClock()
    async with memory_bench(clock) as bench:
        wearer = Wearer(bench, 5.0 * DEGREE)
        await ready(bench, FIXED)

        async def track() -> None:
            while True:
                pose = UserPose(
                    stamp_ns=clock.now_ns(), position_m=(1.5, 1.2, 0.0), yaw_rad=0.0, method="external"
                )
                bench.put(POSE, pose, USER)
                await sleep(clock, 0.5)

        tasks = [asyncio.create_task(track()), asyncio.create_task(wearer.live())]
        await until(
            lambda: any("localizer pauses" in news.reason for news in wearer.progress), what="pausing"
        )
        await bench.bus.call(POINT_ANCHOR, PointAnchor(lamp="led_1"), USER)
        await wearer.until_phase("solved")
        (anchor,) = wearer.anchors
        assert not anchor.accepted
        assert anchor.azimuth_error_rad == pytest.approx(5.0 * DEGREE, abs=0.5 * DEGREE)
        assert {pose.method for pose in wearer.poses[1:]} == {"external"}
        for task in tasks:
            task.cancel()
