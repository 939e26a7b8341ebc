"""The files of one recording: the first, and further ones when it gets long or time is set back."""

import logging
from pathlib import Path
from typing import IO, Self

from pointit.recording.entries import Entry
from pointit.recording.head import Head
from pointit.recording.writer import RecordingWriter
from pointit.runtime.errors import ConfigError
from pointit.schemas.topics import Delivery, Presence, Topic

log = logging.getLogger(__name__)


class FileSeries:
    """Writes to one file at a time. Each is a recording of its own: it begins with states and presences."""

    def __init__(self, path: Path, head: Head) -> None:
        """Create the file, or one with a number if there is one, and write its head.

        Raises:
            ConfigError: If it cannot be written.
        """
        self._first = path
        self._head = head
        self.path = path
        """The file that is being written."""
        self.entries = 0
        """Number of entries in all files."""
        self.left_out = 0
        """Number of entries that are in none, as there are too many keys."""
        self.closed_entries = 0
        """Number of entries in all files but the one that is being written."""
        self._closed_size = 0
        self._retained_entries: dict[tuple[str, str], Entry] = {}
        """By row and name: the newest of each state, and who is present."""
        try:
            self._file, self._writer = self._open(head)
        except OSError as error:
            raise ConfigError(
                f"{path} cannot be written ({error.strerror}); give another file to record"
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    @property
    def size(self) -> int:
        """Return the number of bytes in all files."""
        return self._closed_size + self._writer.size

    def add(self, entry: Entry) -> None:
        """Write `entry`. Like all methods, raises the `OSError` of the disk."""
        if not self._writer.takes(entry.time_ns):
            self._next(entry.time_ns)
        self._write(entry)
        if isinstance(entry.row, Topic) and entry.row.delivery is Delivery.STATE:
            self._retained_entries[entry.row.key, entry.name] = entry
        elif isinstance(entry.row, Presence):
            if entry.body is True:
                self._retained_entries[entry.row.key, entry.name] = entry
            else:
                self._retained_entries.pop((entry.row.key, entry.name), None)

    def flush(self) -> None:
        """Make what was added so far readable."""
        self._writer.flush()

    def close(self) -> None:
        """Write the index of the file."""
        self._writer.close()

    def _next(self, now_ns: int) -> None:
        """End the file, and begin one whose first entries are those that still hold."""
        self.close()
        self._closed_size, self.closed_entries = self.size, self.entries
        self._file.close()
        self._file, self._writer = self._open(self._head.model_copy(update={"began_ns": now_ns}))
        log.info("the recording goes on in %s", self.path)
        for each in self._retained_entries.values():
            self._write(each._replace(time_ns=now_ns))

    def _write(self, entry: Entry) -> None:
        before = self._writer.entries
        self._writer.add(entry)
        if self._writer.entries > before:
            self.entries += 1
        else:
            self.left_out += 1

    def _open(self, head: Head) -> tuple[IO[bytes], RecordingWriter]:
        number = 1
        while True:
            try:
                file = self.path.open("xb")
            except FileExistsError:
                number += 1
                self.path = self._first.with_stem(f"{self._first.stem}-{number}")
            else:
                break
        try:
            writer = RecordingWriter(file, head)
            writer.flush()
        except OSError:
            file.close()
            raise
        return file, writer
