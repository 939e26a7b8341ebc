"""Event lines that a run prints."""

import pytest

from pointit.launch.run.monitor import Monitor, RunScore
from pointit.schemas import ActOutcome, SelectionEvent
from pointit.schemas.selection import NOT_DONE
from pointit.schemas.topics import OUTCOMES, SELECTION_EVENTS
from tests.support.bench import ManualClock, memory_bench


@pytest.mark.parametrize(
    ("event", "cause", "line"),
    [
        ("selected", "dwell", "screws selected by anna"),
        ("deselected", "dwell", "screws deselected by anna"),
        ("deselected", "", None),
    ],
    ids=["fired", "switched off", "a button is over"],
)
async def test_a_button_that_is_over_is_not_printed(event: str, cause: str, line: str | None) -> None:
    told: list[str] = []
    async with memory_bench(ManualClock()) as bench:
        Monitor(RunScore(()), bench.clock, tell=told.append).attach(bench.bus)
        await bench.settle()
        fields = {"stamp_ns": 1, "event": event, "object_id": "screws", "user": "anna", "cause": cause}
        bench.put(SELECTION_EVENTS, SelectionEvent.model_validate(fields | {"kind": "screws"}))
        await bench.settle()
    assert [each for each in told if "screws" in each] == ([line] if line else [])


@pytest.mark.parametrize(
    ("results", "lines", "count", "acts"),
    [
        ([], [], 0, {"started": 1}),
        (["done"], ["screws selected by anna"], 1, {"started": 0, "done": 1}),
        (["failed"], ["screws refused by anna: no power"], 0, {"started": 0, "failed": 1}),
        (["started", "done"], ["screws selected by anna"], 1, {"started": 0, "done": 1}),
        (
            ["started", "failed"],
            ["screws selected by anna", "screws refused by anna: no power"],
            1,
            {"started": 0, "failed": 1},
        ),
    ],
)
async def test_an_act_is_told_and_counted_by_its_outcome(
    results: list[str], lines: list[str], count: int, acts: dict[str, int]
) -> None:
    told: list[str] = []
    async with memory_bench(ManualClock()) as bench:
        monitor = Monitor(RunScore(()), bench.clock, tell=told.append)
        monitor.attach(bench.bus)
        await bench.settle()
        usual = {"stamp_ns": 1, "event": "selected", "object_id": "screws", "user": "anna", "kind": "screws"}
        bench.put(SELECTION_EVENTS, SelectionEvent.model_validate(usual | {"carriers": ("reactions",)}))
        for result in results:
            text = "no power" if result == "failed" else ""
            bench.put(
                OUTCOMES, ActOutcome.model_validate(usual | {"event_ns": 1, "result": result, "text": text})
            )
        if "failed" in results:
            back = {"event": "deselected", "reason": f"{NOT_DONE}no power"}
            bench.put(SELECTION_EVENTS, SelectionEvent.model_validate(usual | back))
        await bench.settle()
    assert [each for each in told if "screws" in each] == lines
    assert (monitor.score.counts()["selected"], dict(monitor.acts)) == (count, acts)
