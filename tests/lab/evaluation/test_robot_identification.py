"""The robot that simulated people point at is identified, and doubt is stated as such."""

from dataclasses import replace

import numpy as np
import pytest

from pointit.schemas import NS_PER_S, PointingRay, UserPose
from pointit.services.goal.robot_choice import RobotIdentifier
from pointit_lab.evaluation.robots.choice import choices
from pointit_lab.evaluation.robots.identification import BEGIN_NS, rates, simulated_results
from pointit_lab.evaluation.robots.simulated_follower import RATE_HZ, SimulatedFollower
from tests.unit.goal.test_robot_identification import COVARIANCE


def test_one_of_two_is_identified_in_3_s_and_probabilities_mean_what_they_say() -> None:
    results = simulated_results(range(20), (3.0,))
    for rate in rates(results):
        if rate.subject == "all":
            assert rate.right.value >= 0.95, rate
            assert rate.wrong.value <= 0.05, rate
    stated = np.mean([guess.probability for guess in results])
    true = np.mean([guess.is_right for guess in results])
    assert abs(stated - true) < 0.1


def test_robots_beside_each_other_are_told_apart_by_their_motion() -> None:
    rng = np.random.default_rng(3)
    person = replace(SimulatedFollower.drawn(rng), x_m=0.0, y_m=0.0, yaw_rad=0.0)
    core = RobotIdentifier()
    core.on_pose(UserPose(stamp_ns=0, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0, covariance=COVARIANCE))
    times_s = np.arange(0.0, 3.0, 1.0 / RATE_HZ)

    def there_and_back(times: np.ndarray) -> np.ndarray:
        return np.stack([np.full(len(times), 2.0), np.sin(2.0 * times), np.full(len(times), 1.0)], axis=1)

    stamp_ns = BEGIN_NS
    for time_s, aim in zip(times_s, person.directions(there_and_back, times_s, rng), strict=True):
        stamp_ns = BEGIN_NS + round(time_s * NS_PER_S)
        x, y, z = there_and_back(np.array([time_s]))[0].tolist()
        core.on_robot("moves", stamp_ns, (x, y, z))
        core.on_robot("stands", stamp_ns, (2.0, 0.3, 1.0))
        core.on_ray(PointingRay(stamp_ns=stamp_ns, origin_m=(0.0, 0.0, 1.64), direction=tuple(aim.tolist())))
    assert core.identify(stamp_ns).chosen == "moves"


@pytest.mark.slow
def test_probabilities_are_not_too_high_though_half_the_people_point_beside_the_robots() -> None:
    every = choices(range(900, 920), (("lone", 1), ("row", 2)))
    likely = [choice for choice in every if choice.stated >= 0.6]
    assert len(likely) >= 20
    right = np.mean([choice.is_right for choice in likely])
    assert right >= np.mean([choice.stated for choice in likely]) - 0.1
    started = [choice.result != "none" for choice in every if choice.is_beside]
    assert sum(started) <= 0.05 * len(started)
    taken = [choice.result == "right" for choice in every if not choice.is_beside]
    assert sum(taken) >= 0.7 * len(taken)
