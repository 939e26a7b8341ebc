"""Seeded faults: plug-ins made from a template with one fault each, and the check that must catch it."""

import asyncio
import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from pointit.testing import Harness

C = TypeVar("C", bound=Callable[..., Any])


@dataclass(frozen=True)
class Fault:
    """A faulty plug-in, the check that catches it, and words of the report."""

    check: str
    words: str
    harness: Harness[Any]


FAULTS: dict[str, Fault] = {}


class CaughtBy:
    """Decorators of the faulty plug-ins of one kind."""

    def __init__(self, template: Harness[Any]) -> None:
        self._template = template

    def __call__(
        self, check: str, words: str, /, *, timeout_s: float = 5.0, **changes: Any
    ) -> Callable[[C], C]:
        """Return a decorator for what makes the plug-in, which says that `check` reports `words` of it."""

        def seeded(make: C) -> C:
            plugin = replace(self._template.plugin, make=make, **changes)
            name = f"{type(plugin).__name__}-{make.__name__}-{check}-{words}"
            assert name not in FAULTS
            FAULTS[name] = Fault(check, words, replace(self._template, plugin=plugin, timeout_s=timeout_s))
            return make

        return seeded


def seed_in_run(caught_by: CaughtBy, plugin: type[Any]) -> None:
    """Seed the faults that `run` of any kind can have in the class `plugin`."""

    async def sleeps_in_the_loop(self: Any, *arguments: Any) -> None:
        time.sleep(0.6)  # noqa: ASYNC251 - the fault
        await plugin.run(self, *arguments)

    async def leaves_a_task(self: Any, *arguments: Any) -> None:
        self.task = asyncio.create_task(asyncio.sleep(3600))
        await plugin.run(self, *arguments)

    async def cannot_be_cancelled(self: Any, *arguments: Any) -> None:
        while True:
            with contextlib.suppress(asyncio.CancelledError):
                await plugin.run(self, *arguments)

    for run, check, words in (
        (sleeps_in_the_loop, "does_not_block", r"stood still .*time\.sleep"),
        (leaves_a_task, "leaves_nothing", "task"),
        (cannot_be_cancelled, "cancels", "still ran"),
    ):
        caught_by(check, words)(type(run.__name__, (plugin,), {"run": run}))
