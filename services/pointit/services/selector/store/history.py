"""Past events for late subscribers, read from the journal beside its writer."""

import asyncio
import sqlite3
from pathlib import Path

from pointit.runtime.errors import RefusedError
from pointit.schemas import ReadHistory, ReadHistoryReply, SelectionEvent, encode
from pointit.services.selector.outputs import event_of
from pointit.services.selector.store.journal_table import recent

PAUSE_S = 0.05
"""Pause after each reading, so that repeated queries do not block selecting, s."""

ENVELOPE_BYTES = 1024
"""Upper limit of the size of a reply without its events."""


class History:
    """Answers queries for past events, one at a time, each in a thread."""

    def __init__(self, path: Path | None) -> None:
        """Create for the journal at `path`. None: there is no journal."""
        self._path = path
        self._turn = asyncio.Lock()

    async def answer(self, query: ReadHistory, _name: str) -> ReadHistoryReply:
        """Return the last events.

        Raises:
            RefusedError: If there is no journal, or it cannot be read.
        """
        if self._path is None:
            raise RefusedError("this selector keeps no journal: start it with journal.enabled=true")
        async with self._turn:
            try:
                events = await asyncio.to_thread(_read, self._path, query)
            except sqlite3.Error as error:
                raise RefusedError(f"the journal cannot be read ({error}): see `pointit doctor`") from error
            finally:
                await asyncio.sleep(PAUSE_S)
        return ReadHistoryReply(message=f"the last {len(events)} events", events=events)


def _read(path: Path, query: ReadHistory) -> tuple[SelectionEvent, ...]:
    records = recent(path, query.last, since_ns=query.since_ns)
    events = (event_of(record, record.seq or 0) for record in records)
    return fitting([event for event in events if event is not None])


def fitting(
    events: list[SelectionEvent], max_bytes: int = ReadHistoryReply.max_bytes - ENVELOPE_BYTES
) -> tuple[SelectionEvent, ...]:
    """Return the newest of `events`, which are in order, that fit into `max_bytes` together."""
    room = max_bytes
    for index in reversed(range(len(events))):
        room -= len(encode(events[index]))
        if room < 0:
            return tuple(events[index + 1 :])
    return tuple(events)
