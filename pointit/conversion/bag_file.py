"""Opens ROS 2 bags: folders and files, also those that are cut off, compressed or without metadata.yaml."""

import itertools
import os
import re
import shutil
import tempfile
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pointit.recording.container import MAX_RECORD_BYTES, DamagedError
from pointit.recording.library import ZstdDecompressor, ZstdError
from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy
from pointit.schemas import NS_PER_S

try:
    from rosbags.rosbag2 import Reader

    from pointit.conversion.damaged_bag import (
        BagConnection,
        BagMessage,
        journals_of,
        page_bytes,
        read_mcap,
        read_sqlite,
    )
except ImportError as error:
    raise ConfigError(f"ROS 2 bags need {remedy('ros2')}") from error

METADATA = "metadata.yaml"
"""File in the folder of a bag."""

STORAGES: Mapping[str, Callable[[Path], Iterator[BagMessage]]] = {".mcap": read_mcap, ".db3": read_sqlite}
"""Readers of damaged files, by suffix."""

COMPRESSED = ".zstd"
"""Further suffix of a file that is compressed as a whole."""

REPAIRS = {
    ".mcap": "`mcap recover {0} -o whole.mcap` writes a whole file",
    ".db3": "`sqlite3 {0} .recover | sqlite3 whole.db3` writes a whole file",
}
"""Commands that repair a file, by suffix."""

_PARTS = re.compile(r"(\d+)")
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


@dataclass
class OpenBag:
    """A bag that can be read."""

    connections: Sequence[Any]
    """Topics: `id`, `topic`, `msgtype`, `digest`."""
    began_ns: int
    """Time of the first message, ns."""
    messages: Callable[[Sequence[Any]], Iterator[tuple[Any, int, bytes]]]
    """Returns topic, time (ns) and content of the messages of some topics, in order of time."""
    notes: list[str] = field(default_factory=list[str])
    """Sentences about what is missing."""


@contextmanager
def open_bag(path: Path) -> Generator[OpenBag]:
    """Open the bag at `path`, a folder or a file. Of a damaged one, what is complete can be read.

    Raises:
        ConfigError: If nothing of it can be read. The message has the reason and the repair.
    """
    with ExitStack() as stack:
        reader = None
        try:
            if not any(map(journals_of, _storages(path))):  # rosbags does not read them
                reader = stack.enter_context(Reader(str(path)))
                deque(reader.messages(), maxlen=0)  # the damage may be in the last message
        except Exception:  # noqa: BLE001 - those of rosbags, SQLite and the packings
            reader = None
        if reader is not None:
            yield OpenBag(reader.connections, reader.start_time, reader.messages)
        else:
            yield _open_damaged(path, Path(stack.enter_context(tempfile.TemporaryDirectory())))


def is_bag(path: Path) -> bool:
    """Return True if `path` has the form of a bag: a file of one, or a folder with such."""
    return bool(_storages(path)) or (path / METADATA).is_file()


class _Part:
    """A file of a damaged bag, read once to find out what is complete."""

    def __init__(self, path: Path, spare: Path) -> None:
        """Read the file at `path`; a copy of it in the folder `spare` is made if need be."""
        self.name = path.name
        self.problem = ""
        self.count = 0
        self.topics: set[tuple[str, str]] = set()
        """Names and types."""
        self.first_ns = self.last_ns = 0
        self._path = path
        try:
            if not path.stat().st_size:
                raise DamagedError("is empty")  # noqa: TRY301
            self._path = _copy(path, spare)
            for count, (connection, time_ns, _) in enumerate(self._read(), 1):
                self.first_ns = time_ns if count == 1 else min(self.first_ns, time_ns)
                self.last_ns = max(self.last_ns, time_ns)
                self.count = count
                self.topics.add((connection.topic, connection.msgtype))
        except (DamagedError, OSError) as error:
            self.problem = str(error)

    def messages(self, connections: Mapping[tuple[str, str], BagConnection]) -> Iterator[BagMessage]:
        """Yield the messages of the topics `connections`, by name and type, in order of time."""
        messages: list[BagMessage] = []
        with suppress(DamagedError):
            for connection, time_ns, data in self._read():
                if (own := connections.get((connection.topic, connection.msgtype))) is not None:
                    messages.append((own, time_ns, data))
        yield from sorted(messages, key=lambda each: each[1])

    def note(self, stated: int) -> str:
        """Return a sentence about what is missing; metadata have `stated` messages, 0 if it is unknown."""
        if not self.count:
            return f"{self.name}: {self.problem}"
        of = f" of {stated}" if stated else ""
        length_s = (self.last_ns - self.first_ns) / NS_PER_S
        return (
            f"{self.name}: {self.problem}; {self.count}{of} messages of {length_s:.2f} s are read; "
            f"{REPAIRS[self._path.suffix].format(self.name)}"
        )

    def _read(self) -> Iterator[BagMessage]:
        return STORAGES[self._path.suffix](self._path)


def _open_damaged(path: Path, spare: Path) -> OpenBag:
    """Return the readable part of a damaged bag. Copies of files are made in the empty folder `spare`."""
    metadata = _Metadata(path if path.is_dir() else path.parent)
    files, notes = _storages(path), list[str]()
    if path.is_dir():
        files = [each for each in files if each.name in metadata.counts] or files
        absent = [name for name in metadata.counts if not (path / name).exists()]
        notes += [f"{name}: is missing; copy it into {path}" for name in absent]
        if not metadata.counts:
            notes.append(f"{METADATA} is missing or damaged; `ros2 bag reindex {path}` writes a new one")
    parts = [_Part(file, spare) for file in files]
    notes += [part.note(metadata.counts.get(part.name, 0)) for part in parts if part.problem]
    topics = sorted(set[tuple[str, str]]().union(*(part.topics for part in parts)))
    if not topics:
        reason = "; ".join(notes) or "it has no messages"
        raise ConfigError(f"{path}: cannot be read as a ROS 2 bag ({reason}); record or copy it again")
    connections = [
        BagConnection(number, *topic, metadata.digests.get(topic[0], ""))
        for number, topic in enumerate(topics)
    ]

    def messages(connections: Sequence[BagConnection]) -> Iterator[BagMessage]:
        by_topic = {(each.topic, each.msgtype): each for each in connections}
        return itertools.chain.from_iterable(part.messages(by_topic) for part in parts)

    began_ns = min(part.first_ns for part in parts if part.count)
    return OpenBag(connections, began_ns, messages, notes)


class _Metadata:
    """Contents of a bag's metadata.yaml, as far as it can be read."""

    def __init__(self, folder: Path) -> None:
        self.counts: dict[str, int] = {}
        """Messages by the name of the file, in the order of the bag."""
        self.digests: dict[str, str] = {}
        """Hashes of types by topic."""
        with suppress(ConfigError, LookupError, TypeError, AttributeError):
            stated = read_yaml(folder / METADATA)["rosbag2_bagfile_information"]
            self.counts = {Path(name).name: 0 for name in stated["relative_file_paths"]}
            self.counts |= {
                Path(each["path"]).name: each["message_count"] for each in stated.get("files", [])
            }
            for each in stated["topics_with_message_count"]:
                topic = each["topic_metadata"]
                self.digests[topic["name"]] = topic.get("type_description_hash", "")


def _storages(path: Path) -> list[Path]:
    """Return the files of the bag at `path`, in the order of their numbers."""
    files = path.iterdir() if path.is_dir() else [path]
    storages = [each for each in files if Path(each.name.removesuffix(COMPRESSED)).suffix in STORAGES]
    return sorted(
        storages, key=lambda each: [int(part) if part.isdigit() else part for part in _PARTS.split(each.name)]
    )


def _copy(path: Path, spare: Path) -> Path:
    """Return `path`, or a copy of it in `spare`: if it is compressed, has journals, or ends within a page."""
    if path.suffix == COMPRESSED:
        copy = spare / path.stem
        with path.open("rb") as packed, copy.open("wb") as file, suppress(ZstdError):
            # of a file that is cut off, what is there
            shutil.copyfileobj(ZstdDecompressor().stream_reader(packed, read_across_frames=True), file)
        return copy
    if journals := journals_of(path):
        for each in (path, *journals):
            shutil.copy(each, spare)
        return spare / path.name
    if path.suffix == ".db3" and (rest := path.stat().st_size % page_bytes(path)):
        copy = Path(shutil.copy(path, spare))  # SQLite would read the missing part of a page as zeros
        os.truncate(copy, path.stat().st_size - rest)
        return copy
    return path


def unpack_message(data: bytes) -> bytes:
    """Return a serialized message, unpacked if it is compressed and can be."""
    if not data.startswith(_ZSTD_MAGIC):
        return data
    with suppress(ZstdError, MemoryError):
        reader = ZstdDecompressor(max_window_size=MAX_RECORD_BYTES).stream_reader(data)
        return reader.read(MAX_RECORD_BYTES)
    return data
