"""The live view of a run in the terminal, with the keyboard as a person's button."""

import contextlib
import functools
import time
from collections.abc import Callable, Generator, Sequence

from rich.console import Console, RenderableType
from rich.live import Live

from pointit.cli.common.keyboard import has_keyboard, keys
from pointit.cli.display.display_part import DisplayPart
from pointit.cli.display.view import REFRESH_HZ, ConsoleView
from pointit.launch.run.running_scenario import RunningScenario
from pointit.schemas import ButtonEvent
from pointit.schemas.topics import BUTTON


@contextlib.contextmanager
def on_screen(
    scenario: RunningScenario,
    console: Console,
    end_s: Callable[[], float | None],
    looks_on: Callable[[], bool],
    parts: Sequence[DisplayPart],
) -> Generator[None]:
    """Draw the run in the terminal. Its Space key is the first person's button.

    Args:
        scenario: the scenario to draw; it may change.
        console: the terminal.
        end_s: returns the monotonic time when the run ends by itself, if ever.
        looks_on: returns True if a page is open, for which the run continues.
        parts: what optional rooms show in it.
    """
    button = functools.cache(functools.partial(scenario.bus.publisher, BUTTON))

    def press() -> None:
        person = _first_person(scenario)
        if person:
            button(person).put(ButtonEvent(stamp_ns=scenario.clock.now_ns(), source="keyboard"))

    def left_s() -> float:
        over_s = end_s()
        return 0.0 if over_s is None else max(0.0, over_s - time.monotonic())

    def drawn() -> RenderableType:
        return ConsoleView(
            scenario.monitor,
            f"PointIt {scenario.plan.name}",
            left_s,
            _first_person(scenario) if has_keyboard() else "",
            page=scenario.address,
            parts=parts,
            is_looked_on=end_s() is not None and looks_on(),
        )

    live = Live(get_renderable=drawn, console=console, refresh_per_second=REFRESH_HZ, transient=True)
    with contextlib.ExitStack() as stack:
        if has_keyboard():
            stack.enter_context(keys(press))
        stack.enter_context(live)
        yield


def _first_person(scenario: RunningScenario) -> str:
    return next(iter(scenario.plan.users), "")
