"""Event lines that a run prints."""

import pytest

from pointit.launch.run.monitor import Monitor, RunScore
from pointit.schemas import SelectionEvent
from pointit.schemas.topics import SELECTION_EVENTS
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
