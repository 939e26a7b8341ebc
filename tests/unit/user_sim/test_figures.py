"""The whole person beside what was measured of people (pointing.md §7); run with `-s` to see the figures.

A laser shows where they point on the floor, as in the recordings of closed-loop pointing.
"""

import functools
import math
from collections.abc import Iterable

import numpy as np

from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import BodyMeasures, Feedback, StripsFrame, TrackedObject, TrackedObjects, UserProfile
from pointit.services.user_sim.config import UserSimConfig
from pointit.services.user_sim.person import Person
from pointit.services.user_sim.sight.eyes import Eyes, SeenCursor, Span
from pointit.services.user_sim.sight.pixels import Kind
from pointit.sim.aim import Stance

PERIOD_NS = 20_000_000
PERIOD_S = 0.02
BEGIN_NS = 1_000_000_000
TARGETS: tuple[Vec3, ...] = ((2.0, -1.0, 0.0), (2.0, 0.0, 0.0), (2.0, 1.0, 0.0))
"""2 to 2.24 m away."""
PEOPLE = 90
WITHIN_M = 0.1


class Laser(Eyes):
    """See a point of light on the floor: each frame's number says which."""

    def __init__(self) -> None:
        super().__init__()
        self.points: list[Vec3 | None] = []
        self._shown: Vec3 | None = None

    def open(self, frame: StripsFrame) -> None:
        self._shown = self.points[frame.seq]

    def cursor(
        self,
        kind: Kind,
        expected_m: Vec3 | None = None,  # noqa: ARG002 - as the eyes have it
        things: Iterable[Span] = (),  # noqa: ARG002 - as the eyes have it
    ) -> SeenCursor | None:
        return None if self._shown is None else SeenCursor(kind, "floor", 0.0, self._shown, 0.1)


@functools.cache
def pointing_at_the_floor(number: int) -> tuple[tuple[float, ...], float]:
    """Return the distance from the light to the target, m, at every step, and the reach, rad."""
    person = Person(
        UserSimConfig(position_m=(0.0, 0.0, 0.0), target_kinds=("spot",)), "a", np.random.default_rng(number)
    )
    laser = Laser()
    person._sight.eyes = laser
    eyes_m = Stance(BodyMeasures()).eyes_m
    target = TARGETS[number % len(TARGETS)]
    spot = TrackedObject(id="spot", kind="spot", position_m=target, length_m=2 * WITHIN_M)
    person.see(0, UserProfile(stamp_ns=0))
    person.see(0, Feedback(stamp_ns=0, cue="started"))
    off_m: list[float] = []
    amplitude_rad = 0.0
    for step in range(round(6.0 / PERIOD_S)):
        now_ns = step * PERIOD_NS
        if now_ns >= BEGIN_NS:
            person.see(now_ns, TrackedObjects(stamp_ns=now_ns, objects=(spot,)))
        sample, _ = person.step(now_ns)
        assert sample is not None
        finger = rotation.rotate(sample.orientation_xyzw, (0.73, 0.0, 0.0))
        ray = vector.normalized(vector.subtract(finger, (0.0, 0.0, 0.21)))
        reach_m = eyes_m[2] / -ray[2] if ray[2] < -0.1 else math.inf
        point = vector.add(eyes_m, vector.scale(ray, reach_m)) if reach_m < 15.0 else None
        laser.points.append(point)
        person.see(now_ns, StripsFrame(stamp_ns=now_ns, seq=step, strips=()))
        if now_ns == BEGIN_NS:
            amplitude_rad = vector.angle_between(ray, vector.subtract(target, eyes_m))
        if now_ns >= BEGIN_NS:
            off_m.append(math.inf if point is None else math.dist(point, target))
    return tuple(off_m), amplitude_rad


def time_to_stay_s(off_m: tuple[float, ...]) -> float:
    """Return from when on the light stays within reach until 5 s are over; infinite when it does not."""
    outside = np.flatnonzero(np.array(off_m) > WITHIN_M)
    if not len(outside):
        return 0.0
    return math.inf if outside[-1] == len(off_m) - 1 else (int(outside[-1]) + 1) * PERIOD_S


def test_time_to_stay_within_10_cm_at_2_m() -> None:
    """Measured: median 2.86 s, 11 % not within 5 s."""
    times_s = np.array([time_to_stay_s(pointing_at_the_floor(number)[0]) for number in range(PEOPLE)])
    late = float(np.mean(np.isinf(times_s)))
    print(f"\ntime to stay: median {np.median(times_s):.2f} s, {late:.0%} not within 5 s")  # noqa: T201
    assert 2.0 < np.median(times_s) < 3.4
    assert late < 0.2


def test_throughput_of_pointing_is_as_measured() -> None:
    """Measured with an arm's IMU: 1.05 to 1.12 bit/s, ID = log2(A / 2r + 1)."""
    width_rad = 2.0 * math.atan(WITHIN_M / math.hypot(2.1, 1.64))
    rates: list[float] = []
    for number in range(PEOPLE):
        off_m, amplitude_rad = pointing_at_the_floor(number)
        time_s = time_to_stay_s(off_m)
        if time_s < math.inf:
            rates.append(math.log2(amplitude_rad / width_rad + 1.0) / time_s)
    print(f"\nthroughput: median {np.median(rates):.2f} bit/s")  # noqa: T201
    assert 0.8 < np.median(rates) < 1.8


def test_the_skilled_point_straighter() -> None:
    def bias_rad(skill: float) -> float:
        config = UserSimConfig()
        config = config.model_copy(update={"aim": config.aim.model_copy(update={"skill": skill})})
        people = [Person(config, "a", np.random.default_rng(seed)) for seed in range(40)]
        return abs(float(np.median([person._error.bias_rad for person in people])))

    assert bias_rad(1.0) < bias_rad(0.5) < bias_rad(0.0)
