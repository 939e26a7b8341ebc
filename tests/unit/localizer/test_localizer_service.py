"""The localizer on the bus: fixed pose, lamps with a person who looks at them, a robot; its parameters."""

import itertools
import math

import pytest

from pointit.diagnosis.symptoms import UNSURE_DEG, UNSURE_M
from pointit.geometry.rotation import IDENTITY
from pointit.geometry.vector import Vec3
from pointit.runtime.clock import sleep
from pointit.runtime.errors import RefusedError
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import (
    CancelLocalization,
    Environment,
    ImuSample,
    RememberedBias,
    SetPose,
    TrackedObject,
    TrackedObjects,
    UserPose,
)
from pointit.schemas import topics as at
from pointit.services.localizer.config import DriftConfig, LocalizerConfig
from pointit.services.localizer.drift.filter import DriftSettings
from pointit.services.localizer.estimation.estimator import SolverSettings
from pointit.services.localizer.pose_manager import PoseManager
from tests.support.bench import ManualClock, background, in_virtual_time, until
from tests.unit.localizer.person import EYES_M, ROOM, USER, Person
from tests.unit.localizer.wearer import FOUR, Wearer, worn

WITH_FOUR = ROOM.model_copy(update={"lamps": FOUR})
STATIC = LocalizerConfig(method="static_targets", order="given", reaction_s=0.5, hold_s=1.0)


async def test_late_joiners_get_a_fixed_pose_that_start_confirms() -> None:
    async with worn(LocalizerConfig(position_m=(1.0, 2.0, 0.0), yaw_deg=90.0)) as room:
        late = Wearer(room.bench, Person())
        await room.bench.settle()
        assert [pose.position_m for pose in late.poses] == [(1.0, 2.0, 0.0)]
        assert late.poses[0].yaw_rad == pytest.approx(math.pi / 2)
        assert late.poses[0].method == "fixed"
        assert [message.phase for message in late.progress] == ["idle"]
        assert "fixed" in await room.start()
        assert late.phase == "solved"


@in_virtual_time
async def test_cancel_leaves_lamps_dark_and_the_last_pose() -> None:
    async with worn(STATIC, VirtualClock(), environment=WITH_FOUR) as room:
        await room.set_pose((3.0, 4.0, 0.0), 0.5)
        await room.start()
        async with background(room.live()):
            await room.until_phase("sampling", target_index=1)
        assert (
            await room.call(at.CANCEL_LOCALIZATION, CancelLocalization()) == "cancelled; the last pose stays"
        )
        assert not room.lit
        assert room.phase == "cancelled"
        assert [pose.position_m for pose in room.poses] == [(3.0, 4.0, 0.0)]
        sequence = [message.seq for message in room.progress]
        assert sequence == sorted(set(sequence))
        assert await room.call(at.CANCEL_LOCALIZATION, CancelLocalization()) == "nothing was going on"


async def test_set_pose_stops_the_running_procedure() -> None:
    async with worn(STATIC) as room:
        await room.start()
        await room.set_pose((1.0, 0.0, 0.0), 0.25)
        assert not room.lit
        assert room.phase == "cancelled"
        assert (room.poses[-1].position_m, room.poses[-1].yaw_rad) == ((1.0, 0.0, 0.0), 0.25)
        assert room.poses[-1].method == "fixed"


async def test_lamps_are_dark_when_the_service_ends() -> None:
    async with worn(STATIC) as room:
        await room.start()
        assert room.lit
        await room.bench.stop()
        await until(lambda: not room.lit, what="darkness")


async def test_silence_is_refused_and_shown_in_health_until_it_works() -> None:
    clock = ManualClock()
    async with worn(STATIC, clock) as room:
        await room.start()
        clock.advance(20.0)
        await until(lambda: room.phase == "refused", what="refused")
        assert "only 0 rays came while led_0 was lit" in room.progress[-1].reason
        assert not room.lit
        assert room.poses == []
        await until(lambda: any("only 0 rays" in text for text in room.health[-1].warnings), what="warning")
        await room.start()
        await until(lambda: not room.health[-1].warnings, what="the warning to go")


@pytest.mark.parametrize(
    ("environment", "config", "sentence"),
    [
        (None, STATIC, "no map yet; start pui"),
        (ROOM, STATIC.model_copy(update={"lamps": ("led_0", "led_9")}), "lamps led_9 are not on map 'lab'"),
        (ROOM, STATIC.model_copy(update={"lamps": ("led_0",)}), "needs two at different places"),
        (ROOM.model_copy(update={"lamps": ()}), STATIC, "needs two at different places"),
    ],
)
async def test_impossible_start_is_refused_immediately(
    environment: Environment | None, config: LocalizerConfig, sentence: str
) -> None:
    async with worn(config, environment=environment) as room:
        with pytest.raises(RefusedError, match=sentence):
            await room.start()


async def test_refused_start_does_not_stop_the_running_procedure() -> None:
    async with worn(LocalizerConfig(method="moving_target"), environment=None) as room:
        await room.start()
        with pytest.raises(RefusedError):
            await room.start("static_targets")
        assert room.phase == "sampling"


@pytest.mark.parametrize("stray_s", [0.0, 3600.0], ids=["clean", "with strays an hour ahead"])
async def test_a_robot_is_followed_from_the_start(stray_s: float) -> None:
    clock = ManualClock()
    person = Person(0.5, -0.3, 1.1)
    config = LocalizerConfig(method="moving_target", autostart=True)
    async with worn(config, clock, environment=None) as room:
        bench = room.bench
        poses = room.poses
        assert room.phase == "sampling"

        for tick in range(300):  # 12 s at 25 Hz: the reaction and a whole window
            now_ns = clock.advance(0.04)
            angle = math.tau * tick / 200.0
            robot: Vec3 = (2.5 + math.cos(angle), 1.0 + math.sin(angle), 0.7 + 0.4 * math.sin(2.0 * angle))
            item = TrackedObject(id="drone", kind="robot", position_m=robot)
            package = TrackedObject(id="package", kind="package", position_m=(0.0, 0.0, 1.0))
            bench.put(at.OBJECTS, TrackedObjects(stamp_ns=now_ns, objects=(package, item)), "room")
            bench.put(at.RAY, person.ray(robot, now_ns), USER)
            await bench.settle(4)
            if stray_s and tick % 20 == 0:
                stray_ns = now_ns + round(stray_s * 1e9)
                bench.put(at.OBJECTS, TrackedObjects(stamp_ns=stray_ns, objects=(item,)), "room")
                bench.put(at.RAY, person.ray((9.0, 9.0, 1.0), stray_ns), USER)
                await bench.settle(4)
        await until(lambda: bool(poses), what="a pose")
        assert math.hypot(poses[-1].position_m[0] - person.x, poses[-1].position_m[1] - person.y) < 0.05
        assert poses[-1].method == "moving_target"
        await until(lambda: room.phase == "solved", what="solved")
        assert room.progress[-1].target_id == "drone"


FOLLOWS = LocalizerConfig(method="moving_target")
STILL_TICKS = 90
"""The robot stands still for 3.6 s: exact rays are certain enough after less, which measures no bias."""


async def localize_by_robot(room: Wearer, mounting: str = "band") -> UserPose:
    """Let the person follow a robot until a pose is accepted, and return it."""
    bench = room.bench
    clock = room.bench.clock

    async def follow() -> None:
        for tick in itertools.count():
            now_ns = clock.now_ns()
            angle = math.tau * max(0, tick - STILL_TICKS) / 100.0
            robot = (2.5 + math.cos(angle), 1.0 + math.sin(angle), 0.7 + 0.4 * math.sin(2.0 * angle))
            item = TrackedObject(id="drone", kind="robot", position_m=robot)
            sample = ImuSample(stamp_ns=now_ns, orientation_xyzw=IDENTITY, mounting=mounting)
            bench.put(at.IMU, sample, USER)
            bench.put(at.OBJECTS, TrackedObjects(stamp_ns=now_ns, objects=(item,)), "room")
            bench.put(at.RAY, room.person.ray(robot, now_ns), USER)
            await sleep(clock, 0.04)

    await room.start()
    async with background(follow()):
        await until(lambda: room.phase == "solved", what="a pose")
    return room.poses[-1]


@in_virtual_time
async def test_robot_localizations_remember_the_elevation_bias_until_it_is_forgotten() -> None:
    person = Person(0.5, -0.3, 1.1, math.radians(6.0))
    async with worn(FOLLOWS, VirtualClock(), person, None) as room:
        first = (await localize_by_robot(room)).remembered_bias
        second = (await localize_by_robot(room)).remembered_bias
        assert first is not None
        assert second is not None
        assert (first.localizations, second.localizations) == (1, 2)
        assert second.covariance[0] < first.covariance[0]
        assert math.degrees(second.bias_rad) == pytest.approx(6.0, abs=2.0)

        # by hand it stays, as the person does
        await room.set_pose((1.0, 2.0, 0.0), 0.0)
        assert room.poses[-1].remembered_bias == second

        forget = CancelLocalization(forget_bias=True)
        answer = await room.call(at.CANCEL_LOCALIZATION, forget)
        assert answer == "forgotten: the next localization expects no elevation bias"
        assert room.poses[-1].position_m == (1.0, 2.0, 0.0)
        assert room.poses[-1].remembered_bias is None

        third = (await localize_by_robot(room)).remembered_bias
        assert third is not None
        assert third.localizations == 1


@in_virtual_time
async def test_new_localizer_continues_with_the_remembered_bias() -> None:
    person = Person(0.5, -0.3, 1.1, math.radians(6.0))
    remembered = RememberedBias(
        localizations=4,
        origin_height_m=EYES_M,
        bias_rad=math.radians(5.0),
        slope=0.0,
        covariance=(math.radians(3.0) ** 2, 0.0, 0.0, 0.01),
        mounting="band",
    )
    async with worn(FOLLOWS, VirtualClock(), person, None) as room:
        await room.set_pose((1.0, 2.0, 0.0), remembered_bias=remembered)
        assert room.poses[-1].remembered_bias == remembered
        after = (await localize_by_robot(room)).remembered_bias
        assert after is not None
        assert after.localizations == 5
        assert after.bias_rad > remembered.bias_rad


@in_virtual_time
async def test_automatic_following_starts_again_after_the_bias_is_forgotten() -> None:
    config = LocalizerConfig(method="moving_target", autostart=True)
    async with worn(config, VirtualClock(), Person(0.5, -0.3, 1.1), None) as room:
        forget = CancelLocalization(forget_bias=True)
        await room.call(at.CANCEL_LOCALIZATION, forget)
        assert room.phase == "sampling"


@in_virtual_time
async def test_a_sensor_that_is_worn_otherwise_begins_a_new_memory() -> None:
    async with worn(FOLLOWS, VirtualClock(), Person(0.5, -0.3, 1.1), None) as room:
        await localize_by_robot(room)
        await localize_by_robot(room)
        remembered = (await localize_by_robot(room, mounting="phone")).remembered_bias
        assert remembered is not None
        assert (remembered.localizations, remembered.mounting) == (1, "phone")


def test_defaults_of_configuration_and_cores_are_equal() -> None:
    config = LocalizerConfig()
    want = SolverSettings()
    have = config.believed()
    for name in want.__dataclass_fields__:
        assert getattr(have, name) == pytest.approx(getattr(want, name)), name
    drift = config.drift.settings()
    settings = DriftSettings()
    assert drift.rate_sigma_radps == pytest.approx(settings.rate_sigma_radps)
    assert want.max_position_sigma_m < UNSURE_M
    assert config.trust.max_yaw_sigma_deg < UNSURE_DEG == config.drift.max_yaw_sigma_deg


def test_health_does_not_warn_of_what_localization_accepts() -> None:
    def warned(variance_deg2: float, after_s: float = 0.0, max_sigma_deg: float = 8.0) -> str:
        config = LocalizerConfig(drift=DriftConfig(max_yaw_sigma_deg=max_sigma_deg, rate_sigma_degps=1.0))
        manager = PoseManager("anna", config)
        yaw_variance = math.radians(1.0) ** 2 * variance_deg2
        covariance = (0.01, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, yaw_variance)
        pose = SetPose(position_m=(0.0, 0.0, 0.0), yaw_rad=0.0, method="moving_target", covariance=covariance)
        manager.set_pose(pose, 0)
        return manager.problem(round(after_s * 1e9))

    assert warned(13.0**2) == warned(20.0**2) == warned(20.0**2, after_s=9.0) == ""
    assert "uncertain by 18°" in warned(13.0**2, after_s=12.0)
    assert "uncertain by 28°" in warned(20.0**2, after_s=20.0)
    assert "uncertain by 26°" in warned(26.0**2)  # as one that drifted before its localizer was restarted
    assert warned(-1e-9) == warned(5.0**2, after_s=10.0) == ""  # within the 14° of poses of lamps
    assert "uncertain by 21°" in warned(5.0**2, after_s=20.0)
    assert warned(5.0**2, after_s=20.0, max_sigma_deg=30.0) == ""
