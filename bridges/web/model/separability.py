"""Separability of things by pointing, for each square of the floor.

No core: it calculates in a thread.
"""

import asyncio
import functools
from itertools import chain, pairwise
from typing import TypedDict

import numpy as np

from pointit.bridges.web.wire import SharedReply
from pointit.maps.checks.pacing import uncovered_things
from pointit.maps.checks.things import TESTED, confusions
from pointit.maps.floor import extent, floor_edges
from pointit.runtime.errors import RefusedError
from pointit.runtime.host.threads import in_daemon_thread
from pointit.schemas import Environment

MAX_PAIRS = 3
"""Maximum number of confused pairs that are named for a square of the floor."""


class Floor(TypedDict):
    """Squares of the floor, by row from low to high y, then by column."""

    x_m: list[float]
    """Edges of the squares, as `y_m`."""
    y_m: list[float]
    things: list[str]
    """Names."""
    told_apart: list[list[int]]
    """Number of things that a person there tells apart."""
    confused: list[list[list[tuple[int, int]]]]
    """Pairs of indices of things that they do not, at most `MAX_PAIRS` a square."""
    uncovered: list[list[list[int]]]
    """Indices of things to which a paced map knows no direction from there, at most `MAX_PAIRS` a square."""


class FloorSeparability:
    """Computes it in a thread when a page first asks, and keeps it until the map changes."""

    def __init__(self) -> None:
        self._room: Environment | None = None
        self._reply_task: asyncio.Task[SharedReply] | None = None

    def set_room(self, room: Environment) -> None:
        """Use `room` from now on."""
        if self._room is None or room.model_copy(update=_stamps(self._room)) != self._room:
            self._room = room
            self._reply_task = None

    async def answer(self) -> SharedReply:
        """Return the squares of the floor, with the fields of `Floor`.

        Raises:
            RefusedError: If the map has no things, or more than can be computed in a few seconds.
        """
        room = self._room
        things = () if room is None else room.fixed_things
        if room is None or not things:
            raise RefusedError("the map has no things that could be told apart; add a section `things`")
        count = len(things)
        if count > TESTED:
            raise RefusedError(
                f"the map has {count} things, limit {TESTED} for colouring the floor of the page; "
                "use `pointit map plot --told-apart`"
            )
        if self._reply_task is None:
            work = in_daemon_thread(functools.partial(_reply, room), "told apart")
            self._reply_task = asyncio.get_running_loop().create_task(work, name="told apart")
        return await asyncio.shield(self._reply_task)  # others may wait for it, too


def _stamps(room: Environment) -> dict[str, int]:
    return {"stamp_ns": room.stamp_ns, "seq": room.seq}


def _reply(room: Environment) -> SharedReply:
    return SharedReply(floor(room))


def floor(room: Environment) -> Floor:
    """Return the squares of the floor as `pointit map plot --told-apart` colours them."""
    clouds = {cloud.id: np.array([cloud.low_m, cloud.high_m]) for cloud in room.clouds}
    floor_extent = extent(room, clouds, None)
    x_m, y_m = floor_edges(*floor_extent)
    things = room.fixed_things
    confused_pairs = confusions(things)
    names = [thing.label or thing.id for thing in things]
    squares: Floor = {
        "x_m": x_m,
        "y_m": y_m,
        "things": names,
        "told_apart": [],
        "confused": [],
        "uncovered": [],
    }
    for y, y2 in pairwise(y_m):
        told_apart_row: list[int] = []
        confused_row: list[list[tuple[int, int]]] = []
        uncovered_row: list[list[int]] = []
        for x, x2 in pairwise(x_m):
            center_m = ((x + x2) / 2.0, (y + y2) / 2.0)
            pairs = confused_pairs(*center_m)
            uncovered = uncovered_things(room.paced_from, things, *center_m)

            # The count is of all pairs, the list of the first ones
            lost = {*chain(*pairs), *uncovered}
            told_apart_row.append(len(things) - len(lost))
            confused_row.append(pairs[:MAX_PAIRS])
            uncovered_row.append(uncovered[:MAX_PAIRS])
        squares["told_apart"].append(told_apart_row)
        squares["confused"].append(confused_row)
        squares["uncovered"].append(uncovered_row)
    return squares
