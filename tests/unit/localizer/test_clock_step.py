"""A clock that is set back blocks nothing."""

import math
from collections.abc import Iterable

import pytest

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Anchor, Localization, UserPose
from pointit.schemas.environment import TrackedObject, TrackedObjects
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.drift.filter import DriftFilter
from pointit.services.localizer.estimation.estimator import Refusal
from pointit.services.localizer.estimation.rays import mean
from pointit.services.localizer.outputs import Output
from pointit.services.localizer.pose_manager import PoseManager, Response
from pointit.services.localizer.procedures.clock_step import ClockStepDetector
from pointit.services.localizer.procedures.external_pose import ExternalPose
from pointit.services.localizer.procedures.moving_target import MovingTarget
from pointit.services.localizer.procedures.static_targets import StaticTargets
from pointit.services.localizer.tracking.pose_tracking import PoseTracker
from tests.unit.localizer.lab import LAMPS, ROOM, config
from tests.unit.localizer.person import Person, yaw_difference
from tests.unit.localizer.test_drift_filter import LAMPS as PLACES
from tests.unit.localizer.test_drift_filter import MINUTE_NS, PERSON, RATE_RADPS, calibrated, drifted, point

S = NS_PER_S
START_NS = 1_700_000_000 * S
HOUR_S = 3600.0
FIXED = LocalizerConfig(position_m=(1.5, 1.2, 0.0), yaw_deg=20.0, reaction_s=0.5, hold_s=1.0)
LAMPS_FIRST = FIXED.model_copy(update={"method": "static_targets"})
DEGREE = math.radians(1.0)


class World:
    """A localizer, and a person who points at what it names, in a time that may jump."""

    def __init__(self, config: LocalizerConfig, yaw_rad: float = 28.0 * DEGREE) -> None:
        self.locating = PoseManager("anna", config)
        self.person = Person(1.5, 1.2, yaw_rad)
        self.now_ns = START_NS
        self.out: list[Output] = []
        self.aim: Vec3 = (3.0, 3.0, 1.2)
        self.take(self.locating.begin(self.now_ns))
        self.take(self.locating.on_map(ROOM, self.now_ns))

    def take(self, outputs: Iterable[Output]) -> None:
        self.out += outputs

    def accepted(self, answer: Response | Refusal) -> None:
        assert isinstance(answer, Response), answer
        self.take(answer.outputs)

    def last(self, kind: type[Output]) -> Output | None:
        return next((each for each in reversed(self.out) if isinstance(each, kind)), None)

    def pose(self) -> UserPose:
        pose = self.last(UserPose)
        assert isinstance(pose, UserPose)
        return pose

    def live(self, duration_s: float) -> None:
        places = {lamp.id: lamp.position_m for lamp in LAMPS}
        for tick in range(round(duration_s * 50)):
            self.now_ns += S // 50
            news = self.last(Localization)
            asked = news.target_id if isinstance(news, Localization) else ""
            ray = self.person.ray(places.get(asked, self.aim), self.now_ns)
            self.take(self.locating.on_ray(ray, self.now_ns))
            if tick % 3 == 0 and self.locating.is_busy:
                self.take(self.locating.step(self.now_ns))
            if tick % 10 == 0 and self.locating.is_followed:
                self.take(self.locating.due(self.now_ns))

    def set_back(self, by_s: float) -> None:
        self.now_ns -= round(by_s * S)

    def anchor(self) -> None:
        self.accepted(self.locating.point_anchor("led_1", self.now_ns))
        self.live(8.0)
        anchor = self.last(Anchor)
        assert isinstance(anchor, Anchor)
        assert anchor.accepted, anchor.reason
        assert abs(anchor.stamp_ns - self.now_ns) < 10 * S


def test_only_a_step_of_more_than_a_second_is_one() -> None:
    clock = ClockStepDetector()
    clock.begin(100 * S)
    assert clock.by_ns(101 * S) == 0
    assert clock.by_ns(100 * S) == 0
    assert clock.by_ns(101 * S - 1) == 0
    assert clock.by_ns(99 * S) == 2 * S
    assert clock.by_ns(99 * S) == 0
    clock.begin(5 * S)
    assert clock.by_ns(5 * S) == 0


@pytest.mark.parametrize("back_s", [3.0, HOUR_S])
def test_anchor_restarts_its_hold_after_a_clock_step(back_s: float) -> None:
    world = World(FIXED)
    world.live(1.0)
    world.accepted(world.locating.point_anchor("led_1", world.now_ns))
    world.live(1.0)
    world.set_back(back_s)
    world.live(4.0)
    assert not world.locating.is_busy
    anchor = world.last(Anchor)
    assert isinstance(anchor, Anchor)
    assert anchor.accepted
    assert yaw_difference(world.pose().yaw_rad, world.person.yaw_rad) == pytest.approx(0.0, abs=DEGREE)


@pytest.mark.parametrize("back_s", [3.0, HOUR_S])
@pytest.mark.parametrize("after_s", [1.0, 2.2, 3.7])
def test_a_localization_goes_on_with_the_lamps_it_has(back_s: float, after_s: float) -> None:
    world = World(LAMPS_FIRST.model_copy(update={"order": "given"}))
    world.live(1.0)
    world.accepted(world.locating.start(None, world.now_ns))
    world.live(after_s)
    before = world.last(Localization)
    world.set_back(back_s)
    world.live(10.0)
    news = world.last(Localization)
    assert isinstance(before, Localization)
    assert isinstance(news, Localization)
    assert before.phase == "sampling"
    assert news.phase == "solved", news
    assert news.since_ns == pytest.approx(before.since_ns - round(back_s * S), rel=0, abs=S)
    pose = world.pose()
    assert math.dist(pose.position_m, (1.5, 1.2, 0.0)) < 0.05
    assert pose.samples == news.samples
    assert pose.stamp_ns <= world.now_ns


def test_the_rays_of_lamps_before_stay_in_order_with_new_ones() -> None:
    procedure = StaticTargets(LAMPS, config(reaction_s=0.5, hold_s=1.0))
    procedure.start(START_NS)
    person, now_ns = Person(1.5, 1.2), START_NS
    for _ in range(100):  # the first lamp is done
        now_ns += S // 50
        procedure.on_ray(person.ray(LAMPS[0].position_m, now_ns))
        procedure.step(now_ns)
    now_ns -= 3600 * S
    procedure.step(now_ns)
    first_ns, middle_ns = procedure.times_ns
    assert now_ns - 2 * S < first_ns < middle_ns < now_ns


def test_a_pose_that_is_not_followed_is_not_of_the_future() -> None:
    tracking = PoseTracker(follow=False)
    given = UserPose(stamp_ns=START_NS, position_m=(1.5, 1.2, 0.0), yaw_rad=0.0)
    tracking.set_exact(given, START_NS)
    rays = [Person(1.5, 1.2).ray(LAMPS[0].position_m, START_NS + tick * S // 50) for tick in range(50)]
    told = mean(rays)
    assert told is not None
    assert tracking.anchor(LAMPS[0], told).anchor.accepted
    back_ns = START_NS - 3600 * S
    pose = tracking.pose(back_ns)
    assert pose is not None
    assert pose.stamp_ns == back_ns
    assert pose.anchored_ns <= back_ns


def test_without_rays_a_hold_ends_as_ever() -> None:
    procedure = StaticTargets(LAMPS, config(reaction_s=0.5, hold_s=1.0, patience_s=2.0))
    procedure.start(START_NS)
    back_ns = START_NS - 3600 * S
    procedure.step(back_ns)
    procedure.step(back_ns + 3 * S)
    assert procedure.running
    procedure.step(back_ns + 4 * S)
    assert not procedure.running


def test_following_restarts_after_a_clock_step() -> None:
    procedure = MovingTarget(config(reaction_s=0.0))
    procedure.start(START_NS)
    procedure.step(START_NS + S)
    back_ns = START_NS - 3600 * S
    (told,) = procedure.step(back_ns)
    assert isinstance(told, Localization)
    assert (told.phase, told.since_ns) == ("sampling", back_ns)
    robot = TrackedObject(id="drone", kind="robot", position_m=(1.0, 0.0, 1.0))
    procedure.on_objects("room", TrackedObjects(stamp_ns=back_ns, objects=(robot,)))
    procedure.on_ray(Person().ray((1.0, 0.0, 1.0), back_ns + 1))
    (told,) = procedure.step(back_ns + S)
    assert isinstance(told, Localization)
    assert told.samples == 1


@pytest.mark.parametrize("track_drift", [None, False])
@pytest.mark.parametrize("back_s", [8.0, HOUR_S])
def test_anchors_and_headings_go_on(*, track_drift: bool | None, back_s: float) -> None:
    world = World(FIXED.model_copy(update={"track_drift": track_drift}))
    world.live(1.0)
    world.anchor()
    world.set_back(back_s)
    world.live(2.0)
    world.anchor()
    world.set_back(back_s)
    world.live(2.0)
    ahead_rad = math.atan2(3.0 - 1.2, 3.0 - 1.5)
    world.accepted(world.locating.set_heading(ahead_rad, world.now_ns))
    assert abs(world.pose().stamp_ns - world.now_ns) < S
    figures = {name: value for name, value, _ in world.locating.figures(world.now_ns)}
    age_s = figures["anchor age"]
    assert age_s is not None
    assert 0.0 <= age_s < 10.0


def test_every_entry_of_the_filter_follows() -> None:
    now_ns = 20 * S
    late = now_ns - S
    direction = PERSON.direction(PLACES[0])

    def filters() -> DriftFilter:
        return calibrated(PERSON)

    drift = filters()
    refused = point(drift, drifted(PERSON, 3 * MINUTE_NS), PLACES[0], late)
    assert "old" in refused.reason
    drift.set_time(now_ns)
    assert point(drift, drifted(PERSON, 3 * MINUTE_NS), PLACES[0], late).accepted
    drift = filters()
    origin = (0.0, 0.0, 1.64)
    taken = drift.update_anchor(late, PLACES[0], origin, direction, now_ns=now_ns)
    assert "old" not in taken.reason
    assert filters().update_heading(late, 0.0, (1.0, 0.0, 0.0), now_ns=now_ns).accepted
    assert not filters().update_heading(late, 0.0, (1.0, 0.0, 0.0)).accepted
    assert filters().update_rest_rate(late, RATE_RADPS, 0.01, now_ns=now_ns).accepted
    assert not filters().update_rest_rate(late, RATE_RADPS, 0.01).accepted
    drift = filters()
    drift.reset_yaw(now_ns, is_restarted=False)
    assert drift.at(now_ns).stamp_ns == now_ns


def test_a_tracker_that_stopped_is_not_heard_for_as_long_as_the_jump() -> None:
    outside = ExternalPose()
    pose = UserPose(stamp_ns=START_NS, position_m=(1.0, 1.0, 0.0), yaw_rad=0.0, method="external")
    outside.hear(pose, START_NS)
    assert outside.is_fresh(START_NS - S)
    back_ns = START_NS - 3600 * S
    assert not outside.is_fresh(back_ns)
    assert outside.age_s(back_ns + 3 * S) == pytest.approx(5.0)
    assert not outside.is_fresh(START_NS)  # nor when the clock has come again to that time
    assert outside.busy_reason("anna", START_NS) == ""
    outside.hear(pose, back_ns)
    assert outside.is_fresh(back_ns + S)
