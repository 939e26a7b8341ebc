"""Wishes for another scenario: granted one after the other, by the run itself, each answered."""

import asyncio
from collections import deque
from collections.abc import Callable

from pointit.launch.plan.plan import Plan
from pointit.launch.run.running_scenario import RunningScenario
from pointit.runtime.errors import ConfigError, PointItError, RefusedError
from pointit.schemas import Done, RunScenario, SchemaError


class ScenarioRequests:
    """What was asked for and is not answered yet; in the loop."""

    def __init__(self, on_wish: Callable[[], None]) -> None:
        """Wait for wishes; `on_wish` is called when there is one to grant."""
        self._on_wish = on_wish
        self._waiting: deque[tuple[RunScenario, asyncio.Future[Done]]] = deque()

    def __bool__(self) -> bool:
        """Return True if somebody waits."""
        return bool(self._waiting)

    async def serve(self, query: RunScenario, _name: str) -> Done:
        """Answer when the wish has come true, or cannot."""
        answer: asyncio.Future[Done] = asyncio.get_running_loop().create_future()
        self._waiting.append((query, answer))
        self._on_wish()
        return await answer

    async def apply_next(self, stage: RunningScenario) -> None:
        """Change what `stage` runs to what was asked for first."""
        query, answer = self._waiting.popleft()
        try:
            await stage.switch_to(await _plan(query, stage.plan))
        except (PointItError, SchemaError) as error:
            if not answer.done():
                answer.set_exception(RefusedError(str(error)))
        else:
            if not answer.done():
                answer.set_result(Done())


async def _plan(query: RunScenario, now: Plan) -> Plan:
    """Return the plan of what is asked for, made and checked beside the loop: maps take long to read.

    Raises:
        ConfigError: there is none.
    """
    if now.another is None:
        raise ConfigError(
            f"{now.name} runs without people of its own (--site-only): it takes no other scenario"
        )
    return await asyncio.to_thread(now.another, query, now)
