"""The scenario as shipped: a simulated person, who sees no cursor, sends a robot to places on the floor."""

import pytest

from pointit.launch.plan.launches import Choices
from tests.integration.scenario.play import play


@pytest.mark.parametrize(("skill", "least", "farthest_m"), [(0.0, 5, 0.8), (1.0, 8, 0.4)])
def test_goals_are_where_they_were_meant_to_be(skill: float, least: int, farthest_m: float) -> None:
    outcome = play("send_a_robot", Choices(seed=1, settings=(f"user-sim.aim.skill={skill}",)), 120.0)
    assert len(outcome.goals) >= least
    assert max(away_m for _, away_m in outcome.goals) < farthest_m
    for goal, _ in outcome.goals:
        assert goal.surface_id == "workspace/horizontal"
        assert goal.position_m[2] == pytest.approx(0.0, abs=1e-9)
        assert goal.clearance_m >= 0.5
    texts = [cue.text for cue in outcome.cues]
    assert texts.count("the robot is sent there") == len(outcome.goals)
    assert outcome.states[-1] == "pointing"


def test_nothing_is_sent_to_where_somebody_is_kept_away_from() -> None:
    far = Choices(seed=1, settings=("goal.keep_out_m=5",))
    outcome = play("send_a_robot", far, 30.0)
    assert outcome.goals == []
    assert any("from you: choose one 5 m away" in cue.text for cue in outcome.cues)
