"""People who wear marker bodies."""

import pytest

from pointit.bridges.mocap.bodies import BodyPose
from pointit.bridges.mocap.config import MocapConfig
from pointit.bridges.mocap.people import WornBodies
from pointit.schemas import NS_PER_S, UserPose
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
