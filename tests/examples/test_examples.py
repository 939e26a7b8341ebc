"""The examples that use the API, beside a simulated site in virtual time."""

import ast
import inspect
import json
from typing import Any

import matplotlib as mpl
import pytest

import pointit
from examples import my_lamp, my_tracker
from pointit.schemas import SelectionEvent
from pointit.schemas.base import Rgb
from tests.architecture.sources import ROOT
from tests.examples.running import running

NOTEBOOK = json.loads((ROOT / "examples" / "pointing.ipynb").read_text(encoding="utf-8"))
PATIENCE_S = 120.0
"""Time limit by the site's clock, s."""


def code_lines(module: Any) -> int:
    tree = ast.parse(inspect.getsource(module))
    lines = {node.lineno for node in ast.walk(tree) if isinstance(node, (ast.stmt, ast.expr))}
    docstrings = {
        node.lineno
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    return len(lines - docstrings)


def test_lamp_turns_green_when_something_is_selected() -> None:
    colors: list[Rgb] = []

    async def main() -> None:
        async with pointit.run("scenario_3", virtual=True) as site, running(my_lamp.react(site)):
            async for shown in site.lamp("led_2").colors().during(PATIENCE_S):
                colors.append(shown.color)
                if len(colors) > 1:
                    break

    pointit.run_virtually(main())
    assert colors == [(0, 0, 0), (0, 0xC0, 0x40)]
    assert code_lines(my_lamp) <= 12


def test_train_is_selected_by_a_person_who_sees_it_on_the_strip() -> None:
    events: list[SelectionEvent] = []

    async def main() -> None:
        no_conveyor: dict[str, object] = {"conveyor-sim.feeder.sequence": []}
        async with (
            pointit.run("scenario_3", virtual=True, settings=no_conveyor) as site,
            running(my_tracker.track(site)),
        ):
            async for event in site.selections().during(PATIENCE_S):
                events.append(event)
                break

    pointit.run_virtually(main())
    (event,) = events
    assert (event.event, event.kind, event.user) == ("selected", "red", "user1")
    assert event.object_id.endswith("train")


@pytest.mark.slow
async def test_notebook_runs_and_is_stored_without_its_results() -> None:
    """Cells run as in Jupyter: one after the other, inside a running event loop."""
    mpl.use("Agg")
    cells = [cell for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells)
    names: dict[str, Any] = {"__name__": "__main__"}
    for cell in cells:
        code = compile("".join(cell["source"]), cell["id"], "exec", ast.PyCF_ALLOW_TOP_LEVEL_AWAIT)
        result = eval(code, names)  # noqa: S307 - our own notebook
        if inspect.isawaitable(result):
            await result
    names["plt"].close("all")
    assert names["found"].position_sigma_m < 0.5
    assert names["slope_s"] > 0.1  # s/bit: harder targets take longer
