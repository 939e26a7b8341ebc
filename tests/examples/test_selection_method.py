"""The selection method of the examples, installed as a package of its own."""

import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

import pointit
from pointit.plugins import GROUPS, Cursor, PointingSample, Surroundings
from pointit.schemas import SelectionEvent
from pointit.testing import SelectionMethodContract
from tests.architecture.sources import ROOT
from tests.support import strangers

EXAMPLE = ROOT / "examples" / "selection_method"
STEP_NS = 20_000_000
PATIENCE_S = 120.0
"""Time limit by the site's clock, s."""


@pytest.fixture(autouse=True)
def _installed(tmp_path: Path) -> Iterator[None]:
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    entries = project["entry-points"]["pointit.selection_methods"]
    lines = "\n".join(f"{name} = {value}" for name, value in entries.items())
    source = (EXAMPLE / "leaky_dwell.py").read_text(encoding="utf-8")
    with strangers.installed(tmp_path, "leaky_dwell", source, selection_methods=lines):
        yield


def acts_on_all(_object_id: str) -> bool:
    return True


def fired(*stays: tuple[str | None, float]) -> Iterator[str]:
    """Yield what is selected by a cursor that is on each object for so many seconds."""
    plugin = GROUPS["selection-method"].get("leaky")
    method = plugin.make(plugin.config(dwell_s=0.8), Surroundings.detached("anna"))
    now_ns = STEP_NS
    for under, stay_s in stays:
        for _ in range(round(stay_s * 1e9 / STEP_NS)):
            now_ns += STEP_NS
            found = method.step(PointingSample(Cursor(stamp_ns=now_ns), under, None, acts_on_all))
            assert 0.0 <= found.progress <= 1.0
            if found.fired is not None:
                yield found.fired


def test_moment_elsewhere_costs_a_moment_and_a_long_one_everything() -> None:
    assert [*fired(("a", 0.6), (None, 0.2), ("a", 0.4))] == ["a"]
    assert [*fired(("a", 0.6), ("b", 0.2), ("a", 0.4))] == ["a"]
    assert [*fired(("a", 0.6), (None, 1.2), ("a", 0.7))] == []
    assert [*fired(("a", 3.0))] == ["a"]
    assert [*fired(("a", 0.9), (None, 0.1), ("a", 0.9))] == ["a", "a"]


def test_it_keeps_the_promises_of_every_selection_method() -> None:
    plugin = GROUPS["selection-method"].get("leaky")
    promised = {"plugin": plugin, "wrong_parameters": ({"drain": -1.0},)}
    contract = type("Leaky", (SelectionMethodContract,), promised)
    tests = [name for name in dir(contract) if name.startswith("test_")]
    assert len(tests) > 5
    for test in tests:
        getattr(contract(), test)()


def test_people_select_with_it() -> None:
    events: list[SelectionEvent] = []

    async def main() -> None:
        chosen = {"selector.method": "leaky", "selector.leaky.drain": 0.25}
        async with pointit.run("scenario_3", virtual=True, settings=chosen) as site:
            async for event in site.selections().during(PATIENCE_S):
                events.append(event)
                break

    pointit.run_virtually(main())
    assert [(event.event, event.user) for event in events] == [("selected", "user1")]
