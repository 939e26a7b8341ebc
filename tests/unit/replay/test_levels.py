"""Division of a recording into its edge and what is recomputed."""

from typing import Any

import pytest

from pointit.recording.entries import AnyRow, entry
from pointit.replay.levels import Level, ReplayError, Split
from pointit.schemas import Feedback, ImuSample, PointingRay, SelectionEvent, UserPose, topics

ALL = (
    "pui",
    "selector",
    "led-driver",
    "conveyor-sim",
    "user-sim.anna",
    "supervisor.anna",
    "pointing.anna",
    "localizer.anna",
)

SAMPLE = ImuSample(stamp_ns=1, orientation_xyzw=(0.0, 0.0, 0.0, 1.0))
A_RAY = PointingRay(stamp_ns=1, origin_m=(0.0, 0.0, 1.6), direction=(1.0, 0.0, 0.0))


def pose(**fields: Any) -> UserPose:
    return UserPose(stamp_ns=1, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0, **fields)


def event(kind: Any) -> SelectionEvent:
    return SelectionEvent(stamp_ns=1, event=kind, object_id="a")


@pytest.mark.parametrize(
    ("row", "name", "body", "levels"),
    [
        (topics.IMU, "anna", SAMPLE, ""),
        (topics.RAY, "anna", A_RAY, "edge"),
        (topics.RAY, "ben", A_RAY, ""),
        (topics.POSE, "anna", pose(), "edge"),
        (topics.POSE, "anna", pose(method="external"), ""),
        (topics.SELECTION_EVENTS, "", event("selected"), "edge rays cursors"),
        (topics.SELECTION_EVENTS, "", event("left"), ""),
        (topics.SELECTION_EVENTS, "", event("dispatched"), ""),
        (topics.FEEDBACK, "anna", Feedback(stamp_ns=1, cue="started"), "edge rays"),
        (topics.FEEDBACK, "anna", Feedback(stamp_ns=1, cue="selected"), "edge rays cursors"),
        (topics.SERVICE_ALIVE, "pointing.anna", True, "edge"),
        (topics.SERVICE_ALIVE, "user-sim.anna", True, ""),
        (topics.SHARD_ALIVE, "pui.anna", True, "edge rays"),
        (topics.SHARD_ALIVE, "selector.ben", True, "edge rays cursors"),
        (topics.USER_ALIVE, "anna", True, ""),
    ],
)
def test_entry_is_recomputed_where_its_writer_runs(row: AnyRow, name: str, body: Any, levels: str) -> None:
    said = entry(1, row, name, body)
    every: tuple[Level, ...] = ("edge", "rays", "cursors")
    assert [level for level in every if Split(level, ALL).is_recomputed(said)] == levels.split()


def test_a_recording_without_configurations_is_refused_with_what_is_missing() -> None:
    with pytest.raises(ReplayError, match=r"no configuration of any service that --from cursors replays"):
        Split("cursors", ["pointing.anna"])
