"""Requests for another scenario, applied one after the other by the run; each gets a reply."""

import asyncio
from collections import deque
from collections.abc import Callable

from pointit.launch.plan.plan import Plan
from pointit.launch.run.running_scenario import RunningScenario
from pointit.runtime.errors import ConfigError, PointItError, RefusedError
from pointit.schemas import Done, RunScenario, SchemaError


class ScenarioRequests:
    """Pending requests. Use in the event loop only."""

    def __init__(self, on_wish: Callable[[], None]) -> None:
        """Create an empty queue; `on_wish` is called when a request arrives."""
        self._on_wish = on_wish
        self._waiting: deque[tuple[RunScenario, asyncio.Future[Done]]] = deque()

    def __bool__(self) -> bool:
        """Return True if a request is pending."""
        return bool(self._waiting)

    async def serve(self, query: RunScenario, _name: str) -> Done:
        """Reply when the request is fulfilled or has failed."""
        answer: asyncio.Future[Done] = asyncio.get_running_loop().create_future()
        self._waiting.append((query, answer))
        self._on_wish()
        return await answer

    async def apply_next(self, stage: RunningScenario) -> None:
        """Switch `stage` to the scenario of the oldest request."""
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
    """Return the plan of the request, made and checked in a thread because maps are slow to read.

    Raises:
        ConfigError: If there is none.
    """
    if now.another is None:
        raise ConfigError(
            f"{now.name} runs without people of its own (--site-only): it cannot change the scenario"
        )
    return await asyncio.to_thread(now.another, query, now)
