"""What was told before, for who comes late: read from the journal, beside its writer."""

import asyncio
import sqlite3
from pathlib import Path

from pointit.runtime.errors import RefusedError
from pointit.schemas import ReadHistory, ReadHistoryReply, SelectionEvent, encode
from pointit.services.selector.outputs import event_of
from pointit.services.selector.store.journal_table import recent

REST_S = 0.05
"""Pause after each reading: who asks again and again keeps nobody from selecting."""

ENVELOPE_BYTES = 1024
"""What a reply has besides its events is shorter."""


class History:
    """Answers what was told; one caller after the other, in a thread of its own."""

    def __init__(self, path: Path | None) -> None:
        """Have read nothing yet; `path`: of the journal, none: there is none."""
        self._path = path
        self._turn = asyncio.Lock()

    async def answer(self, query: ReadHistory, _name: str) -> ReadHistoryReply:
        """Return the last events.

        Raises:
            RefusedError: they are not kept, or cannot be read.
        """
        if self._path is None:
            raise RefusedError("this selector keeps no journal: start it with journal.enabled=true")
        async with self._turn:
            try:
                events = await asyncio.to_thread(_read, self._path, query)
            except sqlite3.Error as error:
                raise RefusedError(f"the journal cannot be read ({error}): see `pointit doctor`") from error
            finally:
                await asyncio.sleep(REST_S)
        return ReadHistoryReply(message=f"the last {len(events)} events", events=events)


def _read(path: Path, query: ReadHistory) -> tuple[SelectionEvent, ...]:
    records = recent(path, query.last, since_ns=query.since_ns)
    events = (event_of(record, record.seq or 0) for record in records)
    return fitting([event for event in events if event is not None])


def fitting(
    events: list[SelectionEvent], most_bytes: int = ReadHistoryReply.max_bytes - ENVELOPE_BYTES
) -> tuple[SelectionEvent, ...]:
    """Return the newest of `events`, which are in order, that are not longer than `most_bytes` together."""
    room = most_bytes
    for index in reversed(range(len(events))):
        room -= len(encode(events[index]))
        if room < 0:
            return tuple(events[index + 1 :])
    return tuple(events)
