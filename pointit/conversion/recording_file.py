"""A new recording from entries of another source."""

from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from pathlib import Path

from pointit.recording.entries import Entry, RecordingError
from pointit.recording.head import Head, make_head
from pointit.recording.writer import RecordingWriter
from pointit.runtime.host.state_file import replaced_file

TICK = 1000
"""Entries between two reports of progress."""


@contextmanager
def new_recording(path: Path, head: Head, *, overwrite: bool = False) -> Generator[RecordingWriter]:
    """Yield a writer of the recording `path`, which is there once the body ends, and not if it fails.

    Raises:
        RecordingError: If the file exists and may not be overwritten, or it cannot be written.
    """
    if path.exists() and not overwrite:
        raise RecordingError(f"{path}: exists already; give another file, or --overwrite to replace it")
    with replaced_file(path) as part, part.open("wb") as file:
        writer = RecordingWriter(file, head)
        yield writer
        writer.close()


def write_recording(
    entries: Iterable[Entry],
    path: Path,
    site: str,
    *,
    overwrite: bool = False,
    tick: Callable[[int], None] = lambda _: None,
) -> int:
    """Write `entries`, in order of time, as the recording `path`, and return their number.

    Raises:
        RecordingError: If there are no entries, the file exists and may not be overwritten, or it cannot be
            written.
    """
    rest = iter(entries)
    first = next(rest, None)
    if first is None:
        raise RecordingError(f"{path} is not written: nothing in the source can be recorded")
    with new_recording(path, make_head(site, first.time_ns), overwrite=overwrite) as writer:
        writer.add(first)
        for each in rest:
            writer.add(each)
            if writer.entries % TICK == 0:
                tick(writer.entries)
    return writer.entries
