"""Stored calibrations, from the running service or from the state directory of this machine."""

from collections.abc import Awaitable, Callable
from contextlib import AbstractAsyncContextManager
from typing import TypeVar

import click
from pydantic import BaseModel

from pointit.cli.common.output import print_json
from pointit.runtime.bus.contract import Bus
from pointit.runtime.errors import ConnectError, NoAnswerError
from pointit.runtime.host.state_file import StateFile

R = TypeVar("R")
K = TypeVar("K", bound=BaseModel)


async def query_site(
    ask: Callable[[Bus], Awaitable[R]], connection: AbstractAsyncContextManager[Bus]
) -> R | None:
    """Return the result of `ask` on a site that is joined, or None if there is none or no service replies."""
    try:
        async with connection as bus:
            return await ask(bus)
    except (ConnectError, NoAnswerError):
        return None


def erase_local(user: str, file: StateFile[K], quantity: str, *, as_json: bool) -> int:
    """Delete the calibration stored on this machine, and print that; return the exit code."""
    was_stored = file.erase()
    if as_json:
        print_json({"user": user, "from": str(file.path), "erased": was_stored})
    elif was_stored:
        click.echo(
            f"{user}: no service runs; the {quantity} stored on this machine ({file.path}) was deleted"
        )
    else:
        click.echo(f"{user}: no service runs, and no {quantity} is stored on this machine ({file.path})")
    return 0


def read_local(user: str, file: StateFile[K], quantity: str, *, as_json: bool) -> K | None:
    """Return the calibration stored on this machine for output as text, after printing its file's name."""
    state = file.read()
    if as_json:
        shown = None if state is None else state.model_dump(mode="json")
        print_json({"user": user, "from": str(file.path), quantity: shown})
        return None
    if state is None:
        click.echo(f"{user}: no service runs, and no {quantity} is stored on this machine ({file.path})")
        return None
    click.echo(f"{user}: no service runs; stored on this machine ({file.path}):")
    return state
