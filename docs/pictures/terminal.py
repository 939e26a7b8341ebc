"""Makes the picture of a run in a terminal, view.svg: `python docs/pictures/terminal.py`."""

import asyncio
import io
import re
from pathlib import Path

from rich._export_format import CONSOLE_SVG_FORMAT
from rich.console import Console

from pointit.cli.view import ConsoleView
from pointit.launch.plan.launches import Choices, site_launches, user_launches
from pointit.launch.plan.plan import read_scenario
from pointit.launch.run.monitor import Monitor, RunScore
from pointit.runtime.clock import SimulatedClock
from pointit.runtime.link.link import Link
from pointit.runtime.service.service import run_services
from pointit.runtime.zenoh.zenoh_bus import ZenohBus

PEOPLE = 1
SPEED = 1.0
MOMENT_S = 12.0
"""Earliest time of the picture after the start, s."""


async def photograph(path: Path) -> None:
    """Run scenario_3 until the person is half-way through a selection, and save the view."""
    scenario = read_scenario("scenario_3")
    choices = Choices()
    launches = site_launches(scenario, choices)
    for index in range(PEOPLE):
        launches += user_launches(scenario, choices, f"user{index + 1}", index)
    clock = SimulatedClock(SPEED)
    bus = await ZenohBus.open(Link())
    monitor = Monitor(RunScore(scenario.target_kinds), clock)
    monitor.attach(bus)
    services = asyncio.create_task(run_services(launches, bus, clock))
    try:
        await asyncio.sleep(MOMENT_S / SPEED)
        for _ in range(2000):
            if any(0.3 < hover.progress < 0.9 for hover in monitor.hovers.values()):
                break
            await asyncio.sleep(0.01)
        console = Console(record=True, width=110, file=io.StringIO(), force_terminal=True)
        console.print(ConsoleView(monitor, "PointIt scenario_3", lambda: 60 - MOMENT_S))
    finally:
        services.cancel()
        await asyncio.wait({services})
        await bus.close()
    # no external font: use the reader's own monospace
    form = re.sub(r"@font-face \{\{.*?\}\}", "", CONSOLE_SVG_FORMAT, flags=re.DOTALL)
    form = form.replace("Fira Code, monospace", "ui-monospace, Menlo, Consolas, monospace")
    path.write_text(console.export_svg(title="pointit run scenario_3", code_format=form))


if __name__ == "__main__":
    asyncio.run(photograph(Path(__file__).with_name("view.svg")))
