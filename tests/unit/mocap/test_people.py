"""People who wear marker bodies."""

import math

import pytest
from scipy.spatial.transform import Rotation

from pointit.bridges.mocap.bodies import BodyPose
from pointit.bridges.mocap.config import MocapConfig
from pointit.bridges.mocap.people import WornBodies
from pointit.schemas import NS_PER_S, ImuSample, UserPose
from pointit.schemas.system import Figure
from tests.support.bench import START_NS


def test_figures_of_a_person_with_the_longest_name_are_accepted_by_health() -> None:
    person = "p" * 64
    bodies = {"cuff": {"person": person, "part": "forearm"}, "cap": {"person": person}}
    config = MocapConfig.model_validate({"server": "127.0.0.1", "truth": True, "bodies": bodies})
    figures = WornBodies(config).figures(START_NS)
    assert len(figures) == 3
    assert [Figure(name=name, value=1.0, unit=unit).name for name, (_, unit) in figures.items()] == [*figures]


def test_truth_shows_the_error_of_the_pose_in_force_as_the_person_moves() -> None:
    bodies = {"cap": {"person": "anna"}}
    config = MocapConfig.model_validate({"server": "127.0.0.1", "truth": True, "bodies": bodies})
    worn = WornBodies(config)
    worn.on_pose(
        "anna", UserPose(stamp_ns=START_NS, position_m=(1.0, 2.0, 0.0), yaw_rad=0.0, method="static_targets")
    )
    errors_m: list[float | None] = []
    for second, x in ((0, 1.25), (1, 2.0)):
        now_ns = START_NS + second * NS_PER_S
        worn.on_body(BodyPose("cap", now_ns, (x, 2.0, 1.75), (0.0, 0.0, 0.0, 1.0), 0.001))
        errors_m.append(worn.figures(now_ns)["position error of anna"][0])
    assert errors_m == pytest.approx([0.25, 1.0])
    assert [each.id for each in worn.objects(now_ns, now_ns)] == ["anna"]
    assert worn.objects(now_ns, now_ns + NS_PER_S // 5) == [], "newer frames do not have the cap"
    later_ns = START_NS + 10 * NS_PER_S  # nobody is seen any more
    assert worn.figures(later_ns)["position error of anna"][0] is None
    assert worn.figures(later_ns)["yaw error of anna"][0] is None


@pytest.mark.parametrize("is_truth", [False, True])
def test_a_yaw_that_jumps_ends_pose_and_truth_within_2_s(*, is_truth: bool) -> None:
    bodies = {"cap": {"person": "anna"}, "cuff": {"person": "anna", "part": "forearm"}}
    config = MocapConfig.model_validate({"server": "127.0.0.1", "truth": is_truth, "bodies": bodies})
    worn, mount = WornBodies(config), Rotation.from_euler("xyz", (0.4, -0.8, 1.2))
    poses: list[tuple[float, UserPose]] = []
    kinds: list[tuple[float, str]] = []
    for tick in range(500):
        time_s, now_ns = tick / 50, START_NS + tick * NS_PER_S // 50
        yaw_rad = 0.9 if time_s < 8 else -0.3
        angles = (math.sin(1.7 * time_s), 0.5 * math.sin(2.3 * time_s + 0.4), 0.3 * math.sin(time_s))
        arm = Rotation.from_euler("ZYX", angles)
        x, y, z, w = (arm * mount).as_quat()
        worn.on_body(BodyPose("cap", now_ns, (1.0, 2.0, 1.7), (0.0, 0.0, 0.0, 1.0), 0.001))
        worn.on_body(BodyPose("cuff", now_ns, (1.4, 2.0, 1.2), (x, y, z, w), 0.001))
        x, y, z, w = (Rotation.from_euler("z", -yaw_rad) * arm).as_quat()
        worn.on_imu("anna", ImuSample(stamp_ns=now_ns, orientation_xyzw=(x, y, z, w)))
        poses += [(time_s, pose) for _, pose in worn.poses(now_ns)]
        kinds += [(time_s, each.kind) for each in worn.objects(now_ns, now_ns)]
    if is_truth:
        assert poses == []
        assert {kind for time_s, kind in kinds if 6 < time_s < 8} == {"person_frame"}
        assert {kind for time_s, kind in kinds if time_s > 9} == {"person"}
    else:
        lost_s, last = poses[-1]
        assert 8 < lost_s < 9
        assert last.yaw_rad == pytest.approx(0.9, abs=0.05)
        assert math.sqrt(last.covariance[8]) > math.radians(90.0)
        assert math.sqrt(poses[-2][1].covariance[8]) < math.radians(65.0)
    assert "turned by 69° against each other" in worn.problem(now_ns)
