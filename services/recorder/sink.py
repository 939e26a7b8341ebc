"""Thread that decodes and writes messages, with people's names replaced where it is wished."""

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
from pointit.schemas.topics import DEPLOYMENT, USER_ALIVE, Delivery, Presence, Topic

log = logging.getLogger(__name__)

T = TypeVar("T")
R = TypeVar("R")

SHORT = 3
"""Names of fewer characters, and mere numbers, are replaced only where `-` and `_` do not continue them."""

MAX_NAMES = 10_000
"""Most names that are learnt: anybody can send messages that have some."""
BATCH_S = 0.1
"""Period at which the thread works: short, as it holds Python's lock meanwhile."""

FLUSH_S = 0.5
"""Longest time until what was written is on disk, s."""

MAX_WAITING = 30_000
"""Most messages that wait for the disk: about half a minute of four people."""

MAX_WAITING_BYTES = 64 * 1024 * 1024
"""Most bytes that wait of messages from other processes."""

LEARN_S = 2.0
"""Time that messages wait for names that come after them, if people get pseudonyms."""

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
        is_own = row.placeholder == "user" or row is USER_ALIVE
        if is_own or (row is DEPLOYMENT and not name.startswith(RUN)):
            self._learn(name)
        self._learn_in(body)
        if isinstance(body, Configuration):
            self._learn_in(_parsed(body.parameters))

    def replace(self, found: Entry) -> Entry:
        """Return an entry with pseudonyms for the known names, and without command lines of services."""
        time_ns, _, row, name, body = found
        if isinstance(body, Configuration):
            body = body.model_copy(update={"parameters": json.dumps(self._in(_parsed(body.parameters)))})
        elif isinstance(body, Deployment):
            services = tuple(each.model_copy(update={"command": ()}) for each in body.services)
            body = body.model_copy(update={"services": services})
        return entry(time_ns, row, self._in(name), self._in(body))

    def _learn_in(self, value: object) -> None:
        if isinstance(value, BaseModel):
            self._learn_in({name: getattr(value, name) for name in _text_fields(type(value))})
        elif isinstance(value, (tuple, list)):
            for each in cast("list[object]", value):
                self._learn_in(each)
        elif isinstance(value, dict):
            for field, each in cast("dict[str, object]", value).items():
                if field in ("user", "person") and isinstance(each, str):
                    self._learn(each)
                elif field == "places" and isinstance(each, dict):
                    for name in cast("dict[str, object]", each):
                        self._learn(name)
                else:
                    self._learn_in(each)

    def _learn(self, name: str) -> None:
        if not name or name in self._numbers or len(self._numbers) >= MAX_NAMES:
            return
        self._numbers[name] = f"person-{len(self._numbers) + 1}"
        self._folded.setdefault(name.lower(), self._numbers[name])
        names = sorted(self._numbers, key=len, reverse=True)
        self._pattern = re.compile("|".join(_as_word(each) for each in names), re.IGNORECASE)

    def _in(self, value: Any) -> Any:
        """Return `value` with its texts replaced."""
        if isinstance(value, BaseModel):
            fields = {name: self._in(getattr(value, name)) for name in _text_fields(type(value))}
            return value.model_copy(update=fields) if fields else value
        if type(value) is str:
            return value if self._pattern is None else self._pattern.sub(self._number, value)
        if isinstance(value, PurePath):
            return type(value)(self._in(str(value)))
        if type(value) in (tuple, list, set, frozenset):
            return type(value)(self._in(each) for each in value)
        if isinstance(value, dict):
            items = cast("dict[object, object]", value).items()
            return {self._in(name): self._in(each) for name, each in items}
        return value

    def _number(self, match: re.Match[str]) -> str:
        return self._numbers.get(match[0]) or self._folded[match[0].lower()]


def _as_word(name: str) -> str:
    """Return the pattern of `name` as a word; a number is none within another number."""
    if len(name) < SHORT or name.isdecimal():
        return rf"(?<![\w-])(?<!\d\.){re.escape(name)}(?![\w-])(?!\.\d)"
    return rf"(?<![^\W_]){re.escape(name)}(?![^\W_])"


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text


@functools.cache
def _text_fields(kind: type[BaseModel]) -> tuple[str, ...]:
    """Return the fields of `kind` that can hold a text that anybody may choose."""
    return tuple(name for name, field in kind.model_fields.items() if _has_text(field.annotation))


def _has_text(annotation: Any) -> bool:
    if isinstance(annotation, type) and not get_args(annotation):
        if issubclass(annotation, BaseModel):
            return bool(_text_fields(annotation))
        return annotation is str or issubclass(annotation, PurePath)
    if annotation is Any:
        return True
    if get_origin(annotation) is Literal:
        return False
    return any(_has_text(each) for each in get_args(annotation))


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
        """Flush all added entries, so that readers see them."""
        self._writer.flush()

    def close(self) -> None:
        """Write the index of the file."""
        self._writer.close()

    def _next(self, now_ns: int) -> None:
        """End the file, and begin one whose first entries are those that still hold."""
        self.close()
        self._closed_size = self.size
        self.closed_entries = self.entries
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
        self._lock = threading.Lock()
        self._waiting: deque[Arrival] = deque()
        self._waiting_bytes = 0
        self._held: deque[tuple[float, Entry]] = deque()
        """Entries that wait for names, and when they were decoded (monotonic, s)."""
        self._keys: dict[tuple[str, str], str] = {}
        self._ending = threading.Event()
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
        """Hand `arrival` to the thread. From any thread; never waits for the disk."""
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
        """Write the rest and the index, and end the thread; give up on a disk that hangs."""
        self._ending.set()
        await in_daemon_thread(functools.partial(self._thread.join, CLOSE_S), "recorder ends")
        if self._thread.is_alive() and not self.problem:
            self._end(f"{self.path}: the disk hangs; what it has taken is readable")

    def _work(self) -> None:
        try:
            with self._files:
                self._write_all()
        except Exception as error:
            if not isinstance(error, OSError):
                log.exception("the recorder's thread has failed")
            reason = (isinstance(error, OSError) and error.strerror) or str(error) or type(error).__name__
            self._recount()
            self._end(
                f"{self.path}: {reason}; nothing more is recorded, "
                f"and the {self.entries} messages before are readable"
            )

    def _end(self, problem: str) -> None:
        with self._lock:
            self.problem = problem
            self.left_out[ENDED] += len(self._waiting) + len(self._held)
            self._waiting.clear()
            self._held.clear()

    def _write_all(self) -> None:
        flushed_s = time.monotonic()
        is_over = False
        while not is_over:
            is_over = self._ending.wait(BATCH_S)
            for _ in range(len(self._waiting)):
                arrival = self._next()
                entry = self._guarded(self._entry, arrival) if arrival is not None else None
                if entry is not None:
                    self._held.append((time.monotonic(), entry))
            learnt_s = time.monotonic() - (LEARN_S if self._pseudonyms is not None and not is_over else 0.0)
            while self._held and self._held[0][0] <= learnt_s:
                self._guarded(self._write, self._held.popleft()[1])
            if time.monotonic() - flushed_s >= FLUSH_S:
                self._files.flush()
                flushed_s = time.monotonic()
                self._count()
        self._files.close()
        self._count()

    def _next(self) -> Arrival | None:
        with self._lock:
            if not self._waiting:  # given up meanwhile
                return None
            arrival = self._waiting.popleft()
            self._waiting_bytes -= _size(arrival)
        return arrival

    def _count(self) -> None:
        self.entries = self._files.entries
        self.size = self._files.size
        if self._files.left_out:
            with self._lock:
                self.left_out[TOO_MANY_KEYS] = self._files.left_out

    def _recount(self) -> None:
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
                    key = self._keys[row.key, name] = row.at(name)
                entry = Entry(time_ns, key, row, name, body)
        if entry is None:
            with self._lock:
                self.left_out[INVALID] += 1
        elif self._pseudonyms is not None:
            self._pseudonyms.learn(entry)
        return entry

    def _write(self, entry: Entry) -> None:
        self._files.add(entry if self._pseudonyms is None else self._pseudonyms.replace(entry))


def _size(arrival: Arrival) -> int:
    """Return the bytes of a message from another process; those of this one are no copies."""
    return 0 if isinstance(arrival.body, bool | Message) else arrival.body.size
