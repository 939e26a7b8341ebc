"""Whatever valid messages others put on the bus, a localization refuses, or gives a pose that can travel."""

import math
from unittest import mock

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pointit.geometry.vector import Vec3
from pointit.schemas import FARTHEST, Environment, Lamp, PointingRay, SetPose, TrackedObject, TrackedObjects
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation.estimator import SolverSettings
from pointit.services.localizer.moving_target import MovingTarget
from pointit.services.localizer.pose_manager import PoseManager
from tests.unit.localizer.person import LOOSE, START_NS, angles, config

S = 1_000_000_000

far = st.one_of(st.floats(-5.0, 5.0), st.floats(-FARTHEST, FARTHEST), st.sampled_from([-FARTHEST, FARTHEST]))
places = st.tuples(far, far, far)


def ray(origin: tuple[float, float, float], azimuth: float, elevation: float, stamp_ns: int) -> PointingRay:
    level = math.cos(elevation)
    direction = (level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation))
    return PointingRay(stamp_ns=stamp_ns, origin_m=origin, direction=direction)


def seen_from(x_m: float, *robots: tuple[float, float]) -> list[tuple[Vec3, float, float]]:
    """Return the rays at robots on the floor (x, y) of who stands at (`x_m`, 0) and looks along x."""
    away = [(x - x_m, y) for x, y in robots]
    return [((0.0, 0.0, 1.64), math.atan2(y, x), -math.atan2(1.64, math.hypot(x, y))) for x, y in away]


AT_THE_EDGE = ((FARTHEST, 2.0), (FARTHEST, -2.0), (FARTHEST - 2.0, 0.0))


@given(
    st.lists(st.tuples(places, places), min_size=1, max_size=5),
    st.lists(st.tuples(places, angles, angles), min_size=1, max_size=4),
    st.sampled_from([0, 2**62, -START_NS]),
    st.sampled_from([SolverSettings(), LOOSE]),
)
@example(  # a pose that is accepted, further away than can be told
    [((x, y, 0.0), (x, y, 0.0)) for x, y in AT_THE_EDGE for _ in range(3)],
    seen_from(FARTHEST + 1.0, *AT_THE_EDGE),
    0,
    LOOSE,
)
def test_any_robots_and_rays_give_refusals_or_valid_poses(
    robots: list[tuple[tuple[float, float, float], tuple[float, float, float]]],
    rays: list[tuple[tuple[float, float, float], float, float]],
    off_ns: int,
    solver_settings: SolverSettings,
) -> None:
    with mock.patch.object(LocalizerConfig, "believed", return_value=solver_settings):
        procedure = MovingTarget(config(autostart=True))
    procedure.start(max(0, START_NS + off_ns))
    for tick in range(200):
        now_ns = START_NS + off_ns + (tick + 1) * S // 50
        procedure.on_ray(ray(*rays[tick // 30 % len(rays)], now_ns))
        one, other = robots[tick // 10 % len(robots)]
        objects = (
            TrackedObject(id="one", kind="robot", position_m=one),
            TrackedObject(id="other", kind="robot", position_m=other),
        )
        procedure.on_objects("x", TrackedObjects(stamp_ns=now_ns, objects=objects))
        procedure.step(now_ns)


@settings(max_examples=20)
@given(
    st.lists(places, min_size=2, max_size=4, unique=True),
    st.lists(st.tuples(places, angles, angles), min_size=1, max_size=4),
    st.tuples(places, far),
)
@pytest.mark.slow
def test_lamps_anchors_and_poses_anywhere(
    lamps: list[tuple[float, float, float]],
    rays: list[tuple[tuple[float, float, float], float, float]],
    given_pose: tuple[tuple[float, float, float], float],
) -> None:
    """Informative lamps, a pose from anywhere, anchors and headings on top: whatever comes out can travel."""
    config = LocalizerConfig(method="static_targets", reaction_s=0.0, hold_s=0.2, patience_s=0.4)
    locating = PoseManager("anna", config)
    locating.begin(START_NS)
    room = Environment(
        stamp_ns=0,
        name="x",
        lamps=tuple(Lamp(id=f"led_{index}", position_m=place) for index, place in enumerate(lamps)),
    )
    locating.on_map(room, START_NS)
    locating.start(None, START_NS)
    for tick in range(400):
        now_ns = START_NS + (tick + 1) * S // 50
        locating.on_ray(ray(*rays[tick // 15 % len(rays)], now_ns), now_ns)
        locating.procedures.step(now_ns)
        locating.due(now_ns)
        if tick == 200:
            position_m, yaw_rad = given_pose
            locating.set_pose(SetPose(position_m=position_m, yaw_rad=yaw_rad), now_ns)
        if tick >= 210 and not locating.procedures.is_busy:
            locating.set_heading(rays[0][1], now_ns)
            locating.point_anchor("", now_ns)

    assert list(locating.figures(START_NS + 9 * S))
