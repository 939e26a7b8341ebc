"""Plays a shipped scenario with its real services on a bus in memory, in virtual time."""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass, field

from pointit.cli.scenario import Choices, Scenario, read_scenario, site_launches, user_launches
from pointit.runtime import Exchange, MemoryBus, run_services
from pointit.schemas import (
    Cursor,
    Hover,
    SelectionEvent,
    TrackedObjects,
)
from pointit.schemas.topics import (
    CURSOR,
    HOVER,
    INTERACTION,
    OBJECTS,
    SELECTION_EVENTS,
)
from tests.integration.scenario.virtual_time import START_NS, VirtualClock, run_virtually

USER = "anna"


@dataclass
class Outcome:
    """What happened, seen from outside."""

    kinds: dict[str, str] = field(default_factory=dict[str, str])
    fed_s: dict[str, float] = field(default_factory=dict[str, float])
    events: list[SelectionEvent] = field(default_factory=list[SelectionEvent])
    cursors: list[Cursor] = field(default_factory=list[Cursor])
    states: list[str] = field(default_factory=list[str])
    nearly: float = 0.0
    """How far the gauge of an object that is no target, or is selected already, ever came."""

    def on_hover(self, hover: Hover, target_kinds: Sequence[str]) -> None:
        """Note how near the person comes to a mistake."""
        chosen = self.chosen()
        if hover.object_id in chosen or self.kinds.get(hover.object_id) not in (None, *target_kinds):
            self.nearly = max(self.nearly, hover.progress)

    def of(self, event: str, kind: str, *, is_kind: bool = True) -> list[str]:
        """Return the objects of `kind` (or of any other) to which `event` happened."""
        return [e.object_id for e in self.events if e.event == event and (e.kind == kind) == is_kind]

    def chosen(self) -> set[str]:
        """Return what is, or was when it left, selected."""
        chosen: set[str] = set()
        for event in self.events:
            if event.event == "selected":
                chosen.add(event.object_id)
            elif event.event == "deselected":
                chosen.discard(event.object_id)
        return chosen

    def final(self, kind: str) -> tuple[int, int, int]:
        """Return how many of `kind` ended selected, how many did not, and how many others ever were."""
        chosen = self.chosen()
        targets = {name for name, its in self.kinds.items() if its == kind}
        return len(targets & chosen), len(targets - chosen), len(self.of("selected", kind, is_kind=False))


def play(scenario: str | Scenario, choices: Choices, duration_s: float | None = None) -> Outcome:
    """Run `scenario` for one person; the same choices give the same outcome."""
    plan = read_scenario(scenario) if isinstance(scenario, str) else scenario
    # the light is for other people's eyes: a simulated person sees the cursor's message
    dark = {name: parameters for name, parameters in plan.site.items() if name != "led-driver"}
    plan = plan.model_copy(update={"site": dark})
    return run_virtually(_play(plan, choices, duration_s or plan.duration_s))


async def _play(plan: Scenario, choices: Choices, duration_s: float) -> Outcome:
    launches = [*site_launches(plan, choices), *user_launches(plan, choices, USER)]
    bus = MemoryBus(Exchange())
    clock = VirtualClock()
    outcome = Outcome()

    def on_objects(message: TrackedObjects, _name: str) -> None:
        for thing in message.objects:
            outcome.kinds.setdefault(thing.id, thing.kind)
            outcome.fed_s.setdefault(thing.id, (message.stamp_ns - START_NS) / 1e9)

    bus.subscribe(OBJECTS, on_objects)
    bus.subscribe(SELECTION_EVENTS, lambda event, _name: outcome.events.append(event))
    bus.subscribe(HOVER, lambda hover, _name: outcome.on_hover(hover, plan.target_kinds), USER)
    bus.subscribe(CURSOR, lambda cursor, _name: outcome.cursors.append(cursor), USER)
    bus.subscribe(INTERACTION, lambda now, _name: outcome.states.append(now.state), USER)
    running = asyncio.create_task(run_services(launches, bus, clock))
    await asyncio.wait({running}, timeout=duration_s)
    if running.done():
        running.result()
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    await bus.close()
    return outcome
