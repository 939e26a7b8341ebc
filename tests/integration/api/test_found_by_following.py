"""A simulated person is localized by following a robot, in virtual time."""

import math
from pathlib import Path

import pointit
from pointit.schemas.topics import POSE, ROBOT_STATE

SCENARIO = """
about: a robot that people follow
places: [{position_m: [3.0, 0.4, 0.0], yaw_deg: 20.0}]
site:
  pui: {map: lab, workspace: horizontal}
  robot.quad: {kind: quadrotor, start_m: [2.2, 2.8, 0.0], radius_m: 0.15}
user:
  pointing: {}
  localizer: {}
  supervisor: {}
  user-sim: {think_s: 0.0, behaviour: rest}
"""


def test_a_person_who_follows_a_quadrotor_is_found_with_the_stated_sigma(tmp_path: Path) -> None:
    path = tmp_path / "robots.yaml"
    path.write_text(SCENARIO, encoding="utf-8")
    with pointit.run(path, localize="robot", virtual=True) as site:
        pose = next(site.messages(POSE, "user1").during(40.0))
        x_m, y_m, _ = pose.position_m
        sigma_m = math.sqrt(max(pose.covariance[0], pose.covariance[4]))
        assert pose.method == "moving_target"
        assert 0.05 < sigma_m < 0.8
        assert math.dist((x_m, y_m), (3.0, 0.4)) < min(2.5 * sigma_m, 0.5)
        landed = (state for state in site.messages(ROBOT_STATE, "quad") if state.phase == "landed")
        assert math.dist(next(landed).position_m[:2], (3.0, 0.4)) > 1.0
