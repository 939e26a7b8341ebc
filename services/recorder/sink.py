"""Thread that decodes and writes messages, with people's names replaced if that is configured.

No core: it writes a file in a thread.
"""

import contextlib
import functools
import json
import logging
import re
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from pathlib import Path, PurePath
from typing import IO, Any, Literal, NamedTuple, Self, TypeVar, cast, get_args, get_origin

from pydantic import BaseModel

from pointit.recording.entries import AnyRow, Entry, entry, entry_of
from pointit.recording.head import Head
from pointit.recording.reader import Recording
from pointit.recording.writer import RecordingWriter
from pointit.runtime.bus.contract import Undecoded
from pointit.runtime.errors import ConfigError, PointItError
from pointit.runtime.host.threads import in_daemon_thread
from pointit.schemas import Configuration, DecodeError, Deployment, Message, ServedRequest
from pointit.schemas.system import RUN
from pointit.schemas.text import system_reason
from pointit.schemas.topics import DEPLOYMENT, USER_ALIVE, Delivery, Presence, Topic

log = logging.getLogger(__name__)

T = TypeVar("T")
R = TypeVar("R")

SHORT = 3
"""Names of fewer characters, and mere numbers, are replaced only where `-` and `_` do not continue them."""

MAX_NAMES = 10_000
"""Maximum number of names that are learnt: anybody can send messages with names."""
BATCH_S = 0.1
"""Period at which the thread works: short, as it holds Python's lock meanwhile."""

FLUSH_S = 0.5
"""Longest time until what was written is on disk, s."""

MAX_WAITING = 30_000
"""Maximum number of messages that wait for the disk: about half a minute of four people."""

MAX_WAITING_BYTES = 64 * 1024 * 1024
"""Maximum number of waiting bytes of messages from other processes."""

LEARN_S = 2.0
"""Time for which messages wait for names that are received after them, if people get pseudonyms, s."""

CLOSE_S = 5.0
"""Longest time that closing waits for the disk."""

TOO_SLOW = "machine or disk are too slow"
ENDED = "nothing more could be written"
INVALID = "they are not valid"
FAULTY = "a fault of PointIt, see the log"
TOO_MANY_KEYS = "there are too many keys"
"""Causes for which messages are left out."""


class Pseudonyms:
    """Learns names from keys and messages, and replaces them in those that are written later.

    A name is replaced wherever it is a word of a text, in upper or lower case: `anna` also in `Anna-laptop`.
    Numbers, names of fields and values of enumerations of messages stay. The parameters of services have no
    types here: if somebody is called like one, or like its value, such as `left`, it is replaced, too.
    """

    def __init__(self) -> None:
        self._numbers: dict[str, str] = {}
        self._folded: dict[str, str] = {}
        """Pseudonyms by the name in lower case, for other spellings of it."""
        self._pattern: re.Pattern[str] | None = None

    def learn(self, entry: Entry) -> None:
        """Store the names in `entry`: the user of its key, and the user in its body."""
        _, _, row, name, body = entry
        is_personal = row.placeholder == "user" or row is USER_ALIVE
        is_deployment_of_person = row is DEPLOYMENT and not name.startswith(RUN)
        if is_personal or is_deployment_of_person:
            self._learn_name(name)
        self._learn_names_in(body)
        if isinstance(body, Configuration):
            self._learn_names_in(_parsed(body.parameters))

    def replace(self, named_entry: Entry) -> Entry:
        """Return an entry with pseudonyms for the known names, and without command lines of services."""
        time_ns, _, row, name, body = named_entry
        if isinstance(body, Configuration):
            parameters = self._replaced(_parsed(body.parameters))
            body = body.model_copy(update={"parameters": json.dumps(parameters)})
        elif isinstance(body, Deployment):
            services = tuple(service.model_copy(update={"command": ()}) for service in body.services)
            body = body.model_copy(update={"services": services})
        return entry(time_ns, row, self._replaced(name), self._replaced(body))

    def _learn_names_in(self, value: object) -> None:
        """Learn the values of all fields of `value`, at any depth, that have names of people."""
        if isinstance(value, BaseModel):
            fields = {name: getattr(value, name) for name in _text_fields(type(value))}
            self._learn_names_in(fields)
        elif isinstance(value, (tuple, list)):
            for item in cast("list[object]", value):
                self._learn_names_in(item)
        elif isinstance(value, dict):
            for field, field_value in cast("dict[str, object]", value).items():
                if field in ("user", "person") and isinstance(field_value, str):
                    self._learn_name(field_value)
                elif field == "places" and isinstance(field_value, dict):
                    for name in cast("dict[str, object]", field_value):
                        self._learn_name(name)
                else:
                    self._learn_names_in(field_value)

    def _learn_name(self, name: str) -> None:
        if not name or name in self._numbers:
            return
        if len(self._numbers) >= MAX_NAMES:
            return
        pseudonym = f"person-{len(self._numbers) + 1}"
        self._numbers[name] = pseudonym
        self._folded.setdefault(name.lower(), pseudonym)
        # longer names first: the first alternative that fits is replaced
        names = sorted(self._numbers, key=len, reverse=True)
        words = "|".join(_word_pattern(known_name) for known_name in names)
        self._pattern = re.compile(words, re.IGNORECASE)

    def _replaced(self, value: Any) -> Any:
        """Return `value` with its texts replaced."""
        if isinstance(value, BaseModel):
            fields = {name: self._replaced(getattr(value, name)) for name in _text_fields(type(value))}
            return value.model_copy(update=fields) if fields else value
        if type(value) is str:
            return value if self._pattern is None else self._pattern.sub(self._pseudonym, value)
        if isinstance(value, PurePath):
            return type(value)(self._replaced(str(value)))
        if type(value) in (tuple, list, set, frozenset):
            return type(value)(self._replaced(item) for item in value)
        if isinstance(value, dict):
            items = cast("dict[object, object]", value).items()
            return {self._replaced(name): self._replaced(item) for name, item in items}
        return value

    def _pseudonym(self, match: re.Match[str]) -> str:
        """Return the pseudonym of a name, or that of its first spelling in other cases."""
        name = match[0]
        return self._numbers.get(name) or self._folded[name.lower()]


def _word_pattern(name: str) -> str:
    """Return the pattern of `name` as a word. A number is none within another number."""
    if len(name) < SHORT or name.isdecimal():
        return rf"(?<![\w-])(?<!\d\.){re.escape(name)}(?![\w-])(?!\.\d)"
    return rf"(?<![^\W_]){re.escape(name)}(?![^\W_])"


def _parsed(text: str) -> Any:
    """Return the value of a JSON text, or the text itself if it is none."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text


@functools.cache
def _text_fields(kind: type[BaseModel]) -> tuple[str, ...]:
    """Return the fields of `kind` that can hold a text that anybody may choose."""
    return tuple(name for name, field in kind.model_fields.items() if _has_text(field.annotation))


def _has_text(annotation: Any) -> bool:
    """Return True if a value of this type can hold a text that anybody may choose."""
    if isinstance(annotation, type) and not get_args(annotation):
        if issubclass(annotation, BaseModel):
            return bool(_text_fields(annotation))
        return annotation is str or issubclass(annotation, PurePath)
    if annotation is Any:
        return True
    if get_origin(annotation) is Literal:
        return False
    return any(_has_text(argument) for argument in get_args(annotation))


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
        """Number of entries in all files except the one that is being written."""
        self._closed_size = 0
        self._retained_entries: dict[tuple[str, str], Entry] = {}
        """By row and name: the newest of each state, and who is present."""
        try:
            self._file, self._writer = self._open(head)
        except OSError as error:
            problem = f"{path} cannot be written ({system_reason(error)})"
            raise ConfigError(f"{problem}; give another file to record") from error

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
            self._begin_next_file(entry.time_ns)
        self._write(entry)

        # States and presences that the next file begins with
        if isinstance(entry.row, Topic) and entry.row.delivery is Delivery.STATE:
            self._retained_entries[entry.row.key, entry.name] = entry
        elif isinstance(entry.row, Presence):
            if entry.body is True:
                self._retained_entries[entry.row.key, entry.name] = entry
            else:
                self._retained_entries.pop((entry.row.key, entry.name), None)

    def flush(self) -> None:
        """Flush all added entries, so that readers see them."""
        self._writer.flush()

    def close(self) -> None:
        """Write the index of the file."""
        self._writer.close()

    def _begin_next_file(self, now_ns: int) -> None:
        """End the file, and start one whose first entries are those that are still valid."""
        self.close()
        self._closed_size = self.size
        self.closed_entries = self.entries
        self._file.close()
        head = self._head.model_copy(update={"began_ns": now_ns})
        self._file, self._writer = self._open(head)
        log.info("the recording goes on in %s", self.path)
        for retained in self._retained_entries.values():
            self._write(retained._replace(time_ns=now_ns))

    def _write(self, entry: Entry) -> None:
        entries_before = self._writer.entries
        self._writer.add(entry)
        if self._writer.entries > entries_before:
            self.entries += 1
        else:
            self.left_out += 1

    def _open(self, head: Head) -> tuple[IO[bytes], RecordingWriter]:
        """Create the next file whose name is free, and write its head."""
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
        except OSError:  # the caller has no file to close yet
            file.close()
            raise
        return file, writer


class Arrival(NamedTuple):
    """A message, or a change of presence, as it arrived."""

    time_ns: int
    row: AnyRow
    name: str
    body: Message | Undecoded | bool


class Sink:
    """A recording and its thread."""

    def __init__(self, path: Path, head: Head, pseudonyms: Pseudonyms | None = None) -> None:
        """Create the file, or one with a number if there is one, and start the thread.

        Raises:
            ConfigError: If it cannot be written.
        """
        self._files = FileSeries(path, head)
        self._pseudonyms = pseudonyms

        # Messages on their way to the disk. The lock is for what both threads change
        self._lock = threading.Lock()
        self._waiting: deque[Arrival] = deque()
        self._waiting_bytes = 0
        self._held: deque[tuple[float, Entry]] = deque()
        """Entries that wait for names, and the times at which they were decoded (monotonic, s)."""
        self._keys: dict[tuple[str, str], str] = {}
        self._ending = threading.Event()

        # Figures for the event loop
        self.problem = ""
        """Error message if nothing more is written, else `""`."""
        self.entries = 0
        """Number of entries written."""
        self.size = 0
        """Number of bytes in the files."""
        self.left_out: Counter[str] = Counter()
        """Number of messages that are not written, by cause."""
        self._thread = threading.Thread(target=self._work, name="recorder writes", daemon=True)
        self._thread.start()

    @property
    def path(self) -> Path:
        """Return the file that is being written."""
        return self._files.path

    def add(self, arrival: Arrival) -> None:
        """Pass `arrival` to the thread. It can be called in any thread, and never waits for the disk."""
        size = _size(arrival)
        with self._lock:
            if self.problem:
                self.left_out[ENDED] += 1
            elif len(self._waiting) >= MAX_WAITING or self._waiting_bytes + size > MAX_WAITING_BYTES:
                self.left_out[TOO_SLOW] += 1
            else:
                self._waiting.append(arrival)
                self._waiting_bytes += size

    async def close(self) -> None:
        """Write the rest and the index, and end the thread. Give up on a disk that hangs."""
        self._ending.set()
        await in_daemon_thread(functools.partial(self._thread.join, CLOSE_S), "recorder ends")
        if self._thread.is_alive() and not self.problem:
            self._end(f"{self.path}: the disk hangs; what it has taken is readable")

    def _work(self) -> None:
        """Write until the end, or until an error, which is reported."""
        try:
            with self._files:
                self._write_all()
        except Exception as error:
            if isinstance(error, OSError):
                reason = system_reason(error)
            else:
                reason = str(error) or type(error).__name__
                log.exception("the recorder's thread has failed")
            self._count_as_reader()
            self._end(
                f"{self.path}: {reason}; nothing more is recorded, "
                f"and the {self.entries} messages before are readable"
            )

    def _end(self, problem: str) -> None:
        """Set the problem, and drop what waits."""
        with self._lock:
            self.problem = problem
            self.left_out[ENDED] += len(self._waiting) + len(self._held)
            self._waiting.clear()
            self._held.clear()

    def _write_all(self) -> None:
        """Decode and write in batches until the end, then write the index."""
        hold_s = 0.0 if self._pseudonyms is None else LEARN_S
        flushed_s = time.monotonic()
        is_over = False
        while not is_over:
            is_over = self._ending.wait(BATCH_S)

            # Decode what waits now: what is added meanwhile is of the next batch
            for _ in range(len(self._waiting)):
                arrival = self._next_arrival()
                if arrival is None:
                    continue
                entry = self._guarded(self._entry, arrival)
                if entry is not None:
                    self._held.append((time.monotonic(), entry))

            # Write the entries whose names were learnt for long enough, at the end all
            if is_over:
                hold_s = 0.0
            decoded_before_s = time.monotonic() - hold_s
            while self._held and self._held[0][0] <= decoded_before_s:
                _decoded_s, entry = self._held.popleft()
                self._guarded(self._write, entry)
            if time.monotonic() - flushed_s >= FLUSH_S:
                self._files.flush()
                flushed_s = time.monotonic()
                self._count()
        self._files.close()
        self._count()

    def _next_arrival(self) -> Arrival | None:
        with self._lock:
            if not self._waiting:  # given up meanwhile
                return None
            arrival = self._waiting.popleft()
            self._waiting_bytes -= _size(arrival)
        return arrival

    def _count(self) -> None:
        """Update the figures."""
        self.entries = self._files.entries
        self.size = self._files.size
        if self._files.left_out:
            with self._lock:
                self.left_out[TOO_MANY_KEYS] = self._files.left_out

    def _count_as_reader(self) -> None:
        """Count the entries as a reader does, since the last ones may be on disk or not."""
        with contextlib.suppress(PointItError), Recording.open(self.path) as recording:
            self.entries = self._files.closed_entries + sum(recording.counts.values())

    def _guarded(self, step: Callable[[T], R], item: T) -> R | None:
        """Return the result of `step` for `item`, or None if it fails: one message may not end all."""
        try:
            return step(item)
        except OSError:
            raise
        except Exception:
            with self._lock:
                self.left_out[FAULTY] += 1
                is_first = self.left_out[FAULTY] == 1
            if is_first:
                log.exception("a message cannot be recorded")
            return None

    def _entry(self, arrival: Arrival) -> Entry | None:
        """Return the entry of an arrival, and learn the names in it. None if it is not valid."""
        time_ns, row, name, body = arrival
        entry: Entry | None = None
        try:
            if not isinstance(body, bool | Message):
                body = body.decode()
        except DecodeError:
            pass
        else:
            if isinstance(body, ServedRequest):
                entry = entry_of(body, name, time_ns)
            else:
                key = self._keys.get((row.key, name))
                if key is None:
                    key = row.at(name)
                    self._keys[row.key, name] = key
                entry = Entry(time_ns, key, row, name, body)
        if entry is None:
            with self._lock:
                self.left_out[INVALID] += 1
        elif self._pseudonyms is not None:
            self._pseudonyms.learn(entry)
        return entry

    def _write(self, entry: Entry) -> None:
        if self._pseudonyms is not None:
            entry = self._pseudonyms.replace(entry)
        self._files.add(entry)


def _size(arrival: Arrival) -> int:
    """Return the bytes of a message from another process. Those of this one are no copies."""
    if isinstance(arrival.body, bool | Message):
        return 0
    return arrival.body.size
