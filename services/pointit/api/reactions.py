"""Functions that are called when somebody points at a thing."""

import asyncio
import functools
import inspect
import logging
from collections.abc import Awaitable, Callable, Collection
from typing import TypeVar

from pointit.api.feed import Feed
from pointit.runtime.config.nearest_name import nearest
from pointit.runtime.errors import ConfigError, PointItError
from pointit.runtime.host.threads import in_daemon_thread
from pointit.schemas import Environment, SelectionEvent

log = logging.getLogger(__name__)

Reaction = Callable[[SelectionEvent], Awaitable[object] | object]
"""Called with an event: `thing`, `user` who pointed, `stamp_ns`, `confidence`, `cause` and `is_on`."""
F = TypeVar("F", bound=Reaction)

MAX_AT_ONCE = 8
"""Limit of calls of one function that run at once. Further events are left out, and named."""


def is_reaction(event: SelectionEvent, names: Collection[str], room: Environment | None) -> bool:
    """Return True if `event` is of a thing among `names`, or of any without names: it fired, or was switched.

    Before the map has come nothing is deselected.
    """
    if names and event.object_id not in names:
        return False
    if room is None:
        return bool(names) and event.is_reaction("button")
    return any(thing.id == event.object_id and event.is_reaction(thing.mode) for thing in room.things)


def check_things(names: Collection[str], room: Environment) -> None:
    """Check that the map has things of these names.

    Raises:
        ConfigError: If it has not. The message names similar ones.
    """
    known = [thing.id for thing in room.things]
    for name in names:
        if name not in known:
            raise ConfigError(
                f"the map has no thing {name!r}; {nearest(name, known) if known else 'it has none'}"
            )


async def react(
    feed: Feed[SelectionEvent], function: Reaction, fail: Callable[[PointItError], object]
) -> None:
    """Call `function` with each event: a plain one in a thread, so that it holds up nothing.

    `fail` gets the error that ends the events, such as a thing that the map does not have.
    """
    name = getattr(function, "__qualname__", repr(function))
    running: set[asyncio.Task[None]] = set()
    try:
        async for event in feed:
            if len(running) >= MAX_AT_ONCE:
                log.warning("%s still runs %d times: left out %s", name, len(running), event.object_id)
                continue
            task = asyncio.create_task(_called(function, event, name), name=f"reaction {name}")
            running.add(task)
            task.add_done_callback(running.discard)
            for _ in range(2):  # a call that ends at once has ended for the next event
                await asyncio.sleep(0)
    except PointItError as error:
        fail(error)
    finally:
        ending = list(running)
        for task in ending:
            task.cancel()
        await asyncio.gather(*ending, return_exceptions=True)


async def _called(function: Reaction, event: SelectionEvent, name: str) -> None:
    try:
        if inspect.iscoroutinefunction(function):
            await function(event)
        else:
            result = await in_daemon_thread(functools.partial(_checked, function, event), f"reaction {name}")
            if inspect.isawaitable(result):
                await result
    except Exception:
        log.exception("%s failed for %s", name, event.object_id)


def _checked(function: Reaction, event: SelectionEvent) -> object:
    """Call `function`; `sys.exit` would end its thread without a result."""
    try:
        return function(event)
    except SystemExit as error:
        raise RuntimeError("sys.exit() in a thread does not end the program") from error
