"""Refusals of unsolvable localizations. The bus and the view name the reason and the remedy."""

from pathlib import Path

from pointit.launch.plan.launches import Choices
from pointit.launch.plan.plan import Scenario, read_scenario
from tests.integration.scenario.play import Outcome, play

EYES_M = 1.64
ROOM = """\
lamps:
{lamps}
strips:
  0: {{line: [[4.0, -2.0, 0.9], [4.0, 2.0, 0.9]], direction: 1, pixels: 60}}
"""
SCENARIO = """\
about: a room
places: [{position_m: [2.0, 0.5, 0.0], yaw_deg: 20.0}]
site: {pui: {map: room.yaml, surfaces: [strip]}}
user: {pointing: {}, localizer: {}, supervisor: {}, user-sim: {think_s: 0.3, behaviour: strips}}
"""

Place = tuple[float, float, float]


def room_with(folder: Path, *lamps: Place) -> Scenario:
    lines = "\n".join(f"  led_{number}: {{position: {list(lamp)}}}" for number, lamp in enumerate(lamps))
    (folder / "room.yaml").write_text(ROOM.format(lamps=lines))
    (folder / "mine.yaml").write_text(SCENARIO)
    return read_scenario(str(folder / "mine.yaml"))


def refusals(outcome: Outcome) -> list[str]:
    return [news.reason for news in outcome.progress if news.phase == "refused"]


PATIENT = ("user-sim.press_pause_s=600",)
"""They press once, so that the refusal is what is seen at the end."""


def test_two_lamps_at_one_place(tmp_path: Path) -> None:
    room = room_with(tmp_path, (4.0, 1.0, 0.5), (4.0, 1.03, 0.5))
    outcome = play(room, Choices(seed=1, localize=True, targets=2, settings=PATIENT), 15.0)
    reason = outcome.steps[-1].reason
    assert outcome.states[-1] == "idle"
    assert "two at different places" in reason
    assert f"anna: refused: {reason}" in outcome.view[80]


def test_person_who_does_not_point_is_refused_until_another_attempt() -> None:
    settings = ("user-sim.points_when_asked=false", "user-sim.press_pause_s=1")
    outcome = play("scenario_2", Choices(seed=1, localize=True, targets=3, settings=settings), 16.0)
    assert refusals(outcome)[0] in {step.reason for step in outcome.steps}
    assert "pointing" not in outcome.states
    assert not [found for found in outcome.found if found.pose.method != "fixed"]
    assert "anna localizing" in outcome.view[80]  # they have pressed again
    assert "refused" not in outcome.view[80]
    assert "samples" in outcome.view[80]


def test_anchor_with_a_hanging_arm_is_refused_and_changes_nothing() -> None:
    """Localized by pointing, they let the arm hang when the lamp lights: that is beyond the gate."""
    settings = (
        "user-sim.points_when_asked=false",
        "user-sim.anchor_every_s=5",
        "user-sim.anchor_when_off_deg=0",
        "localizer.method=fixed",
        "supervisor.localize=false",
        "localizer.position_m=[2.0, 0.5, 0]",
        "localizer.yaw_deg=20",
        "user-sim.yaw_deg=20",
    )
    outcome = play("scenario_2", Choices(seed=1, localize=True, settings=settings), 10.0)
    (anchor,) = outcome.anchors

    assert not anchor.accepted
    assert anchor.reason in refusals(outcome)
    assert f"refused: {anchor.reason}" in outcome.view[80]
    assert "anna pointing" in outcome.view[80]
