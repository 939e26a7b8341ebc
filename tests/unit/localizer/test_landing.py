"""Landings of confirmed selections as anchors: the ray that counts, and who and what counts."""

import math
from typing import Any, Self

import pytest

from pointit.geometry import vector
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import (
    NS_PER_S,
    Anchor,
    Announced,
    Environment,
    PointingRay,
    SelectionEvent,
    SetPose,
    Thing,
    UserPose,
)
from pointit.schemas import topics as at
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation.estimator import Refusal
from pointit.services.localizer.landing_detector import LandingDetector
from pointit.services.localizer.outputs import Output
from pointit.services.localizer.pose_manager import PoseManager
from pointit.services.localizer.service import Localizer
from tests.support.bench import in_virtual_time, memory_bench
from tests.unit.localizer.person import EYES_M, USER

START_NS = 10_000 * NS_PER_S
STEP_NS = NS_PER_S // 50
DRIFT_RAD = math.radians(8.0)
LAMP = Thing(id="lamp", center_m=(2.5, 0.0, EYES_M), size_m=(0.4, 0.4, 0.4))
CART = Thing(id="cart", center_m=(2.5, 1.0, EYES_M), size_m=(0.4, 0.4, 0.4), is_tracked=True)
ROOM = Environment(stamp_ns=1, name="room", things=(LAMP, CART))
COVARIANCE = (0.0025, 0.0, 0.0, 0.0, 0.0025, 0.0, 0.0, 0.0, math.radians(6.0) ** 2)
CONFIRMED = SelectionEvent(stamp_ns=1, event="selected", object_id="lamp", user=USER, cause="button")


class Arm:
    """An arm at azimuths of {H}, deg, that moves between them in half a second."""

    def __init__(self, now_ns: int = START_NS) -> None:
        self.now_ns = now_ns
        self.azimuth_deg = -60.0

    def reach(self, azimuth_deg: float, rest_s: float) -> list[PointingRay]:
        """Return the rays of a movement to `azimuth_deg` and of a rest there."""
        start_deg = self.azimuth_deg
        rays = list[PointingRay]()
        for index in range(1, 26 + round(rest_s * 50)):
            self.now_ns += STEP_NS
            share = min(index / 25, 1.0)
            done = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
            self.azimuth_deg = start_deg + (azimuth_deg - start_deg) * done
            direction = vector.direction(math.radians(self.azimuth_deg), 0.0)
            rays.append(PointingRay(stamp_ns=self.now_ns, origin_m=(0.0, 0.0, EYES_M), direction=direction))
        return rays


class Listener:
    """A person whose wrist has turned by `DRIFT_RAD`, so that the lamp is at minus that in {H}."""

    def __init__(self, covariance: Any = COVARIANCE, *, anchors: bool | None = True) -> None:
        self.core = PoseManager(USER, LocalizerConfig(anchor_at_things=anchors))
        self.core.on_map(ROOM, START_NS)
        pose = SetPose(position_m=(0.0, 0.0, 0.0), covariance=covariance, method="static_targets")
        assert not isinstance(self.core.set_pose(pose, START_NS), Refusal)
        self.arm = Arm()
        self.outputs: list[Output] = []

    @classmethod
    def at_the_lamp(cls, covariance: Any = COVARIANCE) -> Self:
        """Return a person who has reached for the lamp and has heard its name."""
        person = cls(covariance)
        person.reach()
        person.announce()
        return person

    def reach(
        self, azimuth_deg: float = -math.degrees(DRIFT_RAD), rest_s: float = 1.0, **ray_fields: float
    ) -> None:
        """Reach and rest. `elevation_deg` and fields of a calibrated person's rays are in `ray_fields`."""
        elevation_rad = math.radians(ray_fields.pop("elevation_deg", 0.0))
        for ray in self.arm.reach(azimuth_deg, rest_s):
            direction = vector.direction(vector.azimuth(ray.direction), elevation_rad)
            ray = ray.model_copy(update={"direction": direction, **ray_fields})  # noqa: PLW2901
            self.core.on_ray(ray, ray.stamp_ns)
            self.core.due(ray.stamp_ns)

    def announce(self, object_id: str = "lamp") -> None:
        self.core.on_announced(Announced(stamp_ns=self.arm.now_ns, object_id=object_id, label=object_id))

    def confirm(self, event: SelectionEvent = CONFIRMED) -> None:
        self.outputs += self.core.on_selection(event, self.arm.now_ns)

    def select(self, elevation_deg: float, **ray_fields: float) -> None:
        """Reach from aside for the lamp, too high by `elevation_deg`, and confirm its name."""
        self.reach(-60.0)
        self.arm.now_ns += 5 * NS_PER_S
        self.reach(elevation_deg=elevation_deg, **ray_fields)
        self.announce()
        self.confirm()

    @property
    def bias_deg(self) -> float:
        """Elevation bias of the newest pose."""
        poses = [each for each in self.outputs if isinstance(each, UserPose)]
        return math.degrees(poses[-1].elevation_bias_rad) if poses else 0.0

    @property
    def anchors(self) -> list[Anchor]:
        return [each for each in self.outputs if isinstance(each, Anchor)]


def test_confirmed_name_corrects_the_yaw_by_the_landing() -> None:
    person = Listener.at_the_lamp()
    person.confirm()
    (anchor,) = person.anchors
    assert (anchor.target_id, anchor.accepted) == ("lamp", True)
    assert anchor.azimuth_error_rad == pytest.approx(DRIFT_RAD, abs=math.radians(0.5))
    *_, pose = [each for each in person.outputs if isinstance(each, UserPose)]
    assert 0.4 * DRIFT_RAD < pose.yaw_rad < 0.8 * DRIFT_RAD  # of 6 and 5 degrees
    person.confirm()
    assert len(person.anchors) == 1  # one for each reach


@pytest.mark.parametrize("anchors", [None, True])
def test_landings_teach_the_elevation_of_the_person(anchors: bool | None) -> None:
    person = Listener(anchors=anchors)
    biases_deg = list[float]()
    for _ in range(12):
        person.select(4.0)
        biases_deg.append(person.bias_deg)
    assert biases_deg[0] == pytest.approx(2.0, abs=0.1)  # the pose counts as one pointing
    assert biases_deg == sorted(biases_deg)
    assert biases_deg[-1] == pytest.approx(4.0, abs=0.3)
    person.select(12.0)
    assert person.bias_deg - biases_deg[-1] == pytest.approx(8.3 / 8.0, abs=0.1)  # the mean of eight
    assert bool(person.anchors) is bool(anchors)


def test_landings_before_a_new_pose_do_not_affect_its_elevation() -> None:
    person = Listener(anchors=None)
    for _ in range(8):
        person.select(4.0)
    pose = SetPose(position_m=(0.0, 0.0, 0.0), covariance=COVARIANCE, method="static_targets")
    assert not isinstance(person.core.set_pose(pose, person.arm.now_ns), Refusal)
    person.select(4.0)
    assert person.bias_deg == pytest.approx(2.0, abs=0.1)


def test_without_anchors_landings_change_neither_the_yaw_nor_the_place() -> None:
    person = Listener(anchors=None)
    person.select(4.0)
    (pose,) = [each for each in person.outputs if isinstance(each, UserPose)]
    assert (pose.position_m, pose.yaw_rad) == ((0.0, 0.0, 0.0), 0.0)


def test_elevation_is_not_learned_from_calibrated_people_or_far_misses() -> None:
    calibrated = Listener(anchors=None)
    calibrated.select(4.0, elevation_sigma_rad=0.02)
    beside = Listener(anchors=None)
    beside.select(40.0)
    assert calibrated.outputs == beside.outputs == []


def test_landing_counts_and_not_the_ray_that_names_have_corrected() -> None:
    person = Listener.at_the_lamp()
    person.reach(0.0)  # where the wrong pose has the lamp
    person.confirm()
    (anchor,) = person.anchors
    assert anchor.azimuth_error_rad == pytest.approx(DRIFT_RAD, abs=math.radians(0.5))


def test_landing_after_a_long_rest_is_of_another_reach() -> None:
    person = Listener()
    person.announce()
    person.reach(-30.0, rest_s=2.6)
    person.reach()
    person.confirm()
    (anchor,) = person.anchors
    assert anchor.azimuth_error_rad == pytest.approx(DRIFT_RAD, abs=math.radians(0.5))


@pytest.mark.parametrize(
    "change",
    [
        {"cause": "dwell"},
        {"cause": "undo"},
        {"user": "ben"},
        {"event": "refused"},
        {"object_id": "cart"},
        {"object_id": "package_7"},
    ],
)
def test_landing_is_no_anchor_unless_the_person_confirms_a_thing(change: dict[str, Any]) -> None:
    person = Listener.at_the_lamp()
    person.confirm(CONFIRMED.model_copy(update=change))
    assert person.outputs == []


@pytest.mark.parametrize("reason", ["no name", "only the end of one", "no landing", "old landing"])
def test_press_without_a_name_or_a_landing_is_no_anchor(reason: str) -> None:
    person = Listener()
    if reason != "no landing":
        person.reach(rest_s=6.0 if reason == "old landing" else 1.0)
    if reason != "no name":
        person.announce("" if reason == "only the end of one" else "lamp")
    person.confirm()
    assert [anchor.accepted for anchor in person.anchors] == ([False] if reason == "old landing" else [])
    assert not [each for each in person.outputs if isinstance(each, UserPose)]


def test_exact_pose_is_not_corrected() -> None:
    person = Listener.at_the_lamp(covariance=None)
    person.confirm()
    assert person.outputs == []


def test_landing_before_the_pose_is_followed_is_not_used() -> None:
    person = Listener.at_the_lamp(covariance=None)
    pose = SetPose(position_m=(0.0, 0.0, 0.0), covariance=COVARIANCE, method="static_targets")
    person.core.set_pose(pose, person.arm.now_ns)
    person.confirm()
    assert person.outputs == []


@pytest.mark.parametrize("step_s", [-3600.0, 3600.0])
def test_landings_go_on_after_the_clock_was_set(step_s: float) -> None:
    detector = LandingDetector()
    arm = Arm()
    for ray in arm.reach(0.0, 1.0):
        detector.add(ray)
    arm.now_ns += round(step_s * NS_PER_S)
    for ray in arm.reach(40.0, 1.0):
        detector.add(ray)
    landing = detector.pop_landing()
    assert landing is not None
    assert math.degrees(vector.azimuth(landing.direction)) == pytest.approx(40.0, abs=1.0)


@pytest.mark.parametrize("turned_deg", [1.0, 1.9])
def test_tremor_and_slow_turns_are_no_reaches(turned_deg: float) -> None:
    detector = LandingDetector()
    arm = Arm()
    for azimuth_deg in (-60.0 + turned_deg, -60.0, -60.0 + turned_deg):
        for ray in arm.reach(azimuth_deg, 0.5):
            detector.add(ray)
    assert detector.pop_landing() is None


@in_virtual_time
@pytest.mark.parametrize("is_on", [True, False, None])
async def test_switch_decides_on_the_bus(is_on: bool | None) -> None:
    config = LocalizerConfig(anchor_at_things=is_on, track_drift=True)
    async with memory_bench(VirtualClock()) as bench:
        anchors = bench.collect(at.ANCHOR, USER)
        bench.put(at.MAP, ROOM)
        bench.start(Localizer, config, USER)
        await bench.settle()
        for ray in Arm(bench.clock.now_ns() - NS_PER_S).reach(0.0, 0.5):
            bench.put(at.RAY, ray, USER)
            await bench.settle()
        bench.put(at.ANNOUNCED, Announced(stamp_ns=1, object_id="lamp", label="lamp"), USER)
        await bench.settle()
        bench.put(at.SELECTION_EVENTS, CONFIRMED)
        await bench.settle()
        assert [anchor.target_id for anchor in anchors] == (["lamp"] if is_on else [])
