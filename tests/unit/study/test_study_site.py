"""Changes of parameters: those that a running site takes, and those that need another one."""

from collections.abc import AsyncIterator
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

from pointit.forearm.true_pose import TruePose
from pointit.schemas import (
    NS_PER_S,
    ActOutcome,
    Announced,
    SelectionEvent,
    TrackedObject,
    TrackedObjects,
    UserPose,
)
from pointit.schemas.selection import ResultKind
from pointit.study.measure import Attempt
from pointit.study.study_site import StudySite

GAUGE = {"selector.method": "gauge", "selector.gauge.full_s": 0.8}


@pytest.mark.parametrize(
    ("before", "after", "is_live"),
    [
        (GAUGE, {**GAUGE, "selector.gauge.full_s": 1.2}, True),
        (GAUGE, {"selector.method": "hold", "selector.window_s": 0.5}, False),  # full_s gets its default
        ({"selector.gauge.full_s": 0.8}, {"selector.gauge.full_s": 1.2}, False),  # of which method?
        ({**GAUGE, "selector.window_s": 0.5}, {**GAUGE, "selector.window_s": 0.9}, False),
        ({"pui.smoothing": 1}, {"pui.smoothing": 2}, False),
    ],
)
def test_dwell_time_is_live_for_the_set_method_only(
    before: dict[str, Any],
    after: dict[str, Any],
    is_live: bool,
) -> None:
    site: Any = SimpleNamespace(tracker=MagicMock(return_value=None))
    assert StudySite(site, "P01", before, None).is_live(after) is is_live  # pyrefly: ignore[bad-argument-type]


class SiteWithTrackers:
    """A site whose trackers have published one message each."""

    def __init__(self, messages: dict[str, TrackedObjects], pose: UserPose) -> None:
        self._messages = messages
        self.time_ns = 100 * NS_PER_S
        self.latest = SimpleNamespace(pose={"P01": pose})
        self.tracker = MagicMock(return_value=None)

    def now_ns(self) -> int:
        return self.time_ns

    def messages(self, _topic: object) -> Any:
        async def items() -> AsyncIterator[tuple[str, TrackedObjects]]:
            for each in self._messages.items():
                yield each

        return SimpleNamespace(items=items)


async def test_declared_truth_is_followed_and_its_absence_is_a_problem() -> None:
    person = TrackedObject(id="P01", kind="person_frame", position_m=(1.0, 2.0, 1.7), yaw_rad=0.5)
    other = person.model_copy(update={"position_m": (9.0, 9.0, 0.0)})
    messages = {
        "mocap": TrackedObjects(stamp_ns=100 * NS_PER_S, objects=(person,)),
        "camera": TrackedObjects(stamp_ns=100 * NS_PER_S, objects=(other,)),
    }
    pose = UserPose(
        stamp_ns=90 * NS_PER_S, position_m=(1.0, 2.25, 0.0), yaw_rad=0.45, method="static_targets",
        covariance=(0.01, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.01),
    )  # fmt: skip
    site: Any = SiteWithTrackers(messages, pose)
    study_site = StudySite(site, "P01", {}, None)  # pyrefly: ignore[bad-argument-type]

    assert study_site.truth_problem == ""
    study_site.truth_tracker = "mocap"
    assert study_site.truth_problem.startswith("the tracker mocap sees no P01: start it")

    received: list[object] = []
    study_site.on_message = lambda message, _now_ns: received.append(message)
    await study_site._follow_truth()
    assert received == [TruePose(100 * NS_PER_S, (1.0, 2.0, 1.7), 0.5)]
    assert study_site.truth_problem == ""
    assert study_site.quality.endswith("; true error 25 cm, -2.9°")

    site.time_ns += 10 * NS_PER_S
    assert study_site.truth_problem != ""
    assert "true error" not in study_site.quality


async def test_names_are_spoken_to_participants_whose_first_message_is_nameless() -> None:
    async def messages() -> AsyncIterator[Announced]:
        yield Announced(stamp_ns=1)

    site: Any = SiteWithTrackers({}, UserPose(stamp_ns=1, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0))
    study_site = StudySite(site, "P01", {}, None)  # pyrefly: ignore[bad-argument-type]
    assert not study_site.has_names
    await study_site._pump(messages(), Attempt.on_announced)
    assert study_site.has_names


@pytest.mark.parametrize(("result", "is_early"), [("done", False), ("done", True), ("failed", False)])
def test_selection_ends_a_trial_once_it_is_told_as_done(*, result: ResultKind, is_early: bool) -> None:
    class Trial:
        def __init__(self) -> None:
            self.events: list[tuple[str, int]] = []

        def on_selection(self, event: SelectionEvent, now_ns: int) -> None:
            self.events.append((event.event, now_ns))

    site: Any = SiteWithTrackers({}, UserPose(stamp_ns=1, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0))
    study_site = StudySite(site, "P01", {}, None)  # pyrefly: ignore[bad-argument-type]
    asked = SelectionEvent(stamp_ns=5, event="selected", object_id="t", carriers=("home",), status="asked")
    outcome = ActOutcome(stamp_ns=9, event="selected", object_id="t", event_ns=5, result=result)
    trial: Any = Trial()

    messages = [(outcome, 9), (asked, 7)] if is_early else [(asked, 7), (outcome, 9)]
    study_site._on_selection(trial, *messages[0])
    assert trial.events == []
    study_site._on_selection(trial, *messages[1])
    assert trial.events == [("selected" if result == "done" else "refused", 7)]
