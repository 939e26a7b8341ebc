"""Opens ROS 2 bags: a folder with its metadata.yaml, or one of its files. Damaged ones are refused."""

import shlex
import shutil
import sqlite3
import tempfile
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from pointit.recording.container import (
    DAMAGED,
    Chunk,
    DamagedError,
    Opcode,
    read,
    records,
    unpack,
)
from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy
from pointit.runtime.host.unpacking import (
    MAX_BYTES,
    UNPACKERS,
    TooLargeError,
    UnpackError,
    copy_zstd,
    unpack_zstd,
)
from pointit.schemas.text import system_reason

try:
    from rosbags.rosbag2 import Reader, storage_mcap
except ImportError as error:
    raise ConfigError(f"ROS 2 bags need {remedy('ros2')}") from error

METADATA = "metadata.yaml"
"""File in the folder of a bag."""
COMPRESSED = ".zstd"
"""Further suffix of a file that is compressed as a whole."""
REPAIRS = {
    ".mcap": "`mcap recover {0} -o whole.mcap` writes a whole file",
    ".db3": "`sqlite3 {0} .dump | sed 's/^ROLLBACK.*/COMMIT;/' | sqlite3 whole.db3` writes a whole file",
}
"""Commands that repair a file, by its suffix."""
MAX_RATIO = 20
"""Maximum size of an unpacked file relative to the packed one."""
RESERVE_BYTES = 1 << 30
"""Space that unpacked files leave free on their disk, bytes."""
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


def _limit(unpack_data: Callable[[bytes, int], bytes]) -> Callable[[bytes, int], bytes]:
    """Return `unpack_data` with our limit, in place of the size that a file states."""

    def unpack_limited(data: bytes, _stated_size: int) -> bytes:
        return unpack_data(data, MAX_BYTES)

    return unpack_limited


# rosbags unpacks what its index names, which may be another place than those of the chunks, without a limit
storage_mcap.DECOMPRESSORS.update({name: _limit(unpacker) for name, unpacker in UNPACKERS.items()})


class BagConnection(NamedTuple):
    """A topic of a bag."""

    id: int
    topic: str
    msgtype: str
    digest: str
    """Hash of the type, or `""` if the bag has none."""
    messages: int
    """Number of its messages."""


@dataclass
class OpenBag:
    """A bag that can be read."""

    connections: Sequence[BagConnection]
    began_ns: int
    """Time of the first message, ns."""
    messages: Callable[[Sequence[BagConnection]], Iterator[tuple[BagConnection, int, bytes]]]
    """Returns topic, time (ns) and content of the messages of some topics, in order of time."""


def is_bag(path: Path) -> bool:
    """Return True if `path` has the form of a bag: a file of one, or a folder with such."""
    files = path.iterdir() if path.is_dir() else [path]
    return any(map(_is_storage, files)) or (path / METADATA).is_file()


@contextmanager
def open_bag(path: Path) -> Generator[OpenBag]:
    """Open the bag at `path`, a folder or a file.

    Raises:
        ConfigError: If it is damaged or incomplete. The message has the command that repairs it.
    """
    metadata = _Metadata(path) if path.is_dir() else None
    with ExitStack() as stack:
        # Each file is unpacked if need be, and read to its end once: only then is it known to be whole.
        folder: Path | None = None
        readers: list[Any] = []
        files = [path] if metadata is None else metadata.files
        for file in files:
            storage = file
            if file.suffix == COMPRESSED:
                folder = folder or _temporary_folder(file, stack)
                storage = _unpack(file, folder)
            readers.append(_open_storage(file, storage, stack))

        count = sum(reader.message_count for reader in readers)
        if metadata is not None and count != metadata.count:
            raise ConfigError(
                f"{path}: has {count} messages, and {metadata.count} by its {METADATA}: copy it again, or "
                f"give one of its files instead of the folder"
            )
        if not count:
            raise ConfigError(f"{path}: has no messages: record it again")

        # A topic that several files have is one.
        connections = _connections(readers, {} if metadata is None else metadata.digests)

        def messages(connections_read: Sequence[BagConnection]) -> Iterator[tuple[BagConnection, int, bytes]]:
            for reader in readers:
                own = [
                    connection
                    for connection in reader.connections
                    if connections[connection.topic, connection.msgtype] in connections_read
                ]
                if not own:  # to rosbags, none means all
                    continue
                for connection, time_ns, data in reader.messages(own):
                    yield connections[connection.topic, connection.msgtype], time_ns, data

        began_ns = min(reader.start_time for reader in readers)
        yield OpenBag([*connections.values()], began_ns, messages)


def _connections(readers: Sequence[Any], digests: Mapping[str, str]) -> dict[tuple[str, str], BagConnection]:
    """Return the topics of all files by name and type.

    Args:
        readers: of the files.
        digests: hashes of types by topic that the bag's metadata states; they come before those of files.
    """
    own_digests: dict[tuple[str, str], str] = {}
    counts: Counter[tuple[str, str]] = Counter()
    for reader in readers:
        for connection in reader.connections:
            key = connection.topic, connection.msgtype
            own_digests[key] = connection.digest
            counts[key] += connection.msgcount
    connections: dict[tuple[str, str], BagConnection] = {}
    for number, (key, own_digest) in enumerate(own_digests.items()):
        topic, msgtype = key
        digest = digests.get(topic, "") or own_digest
        connections[key] = BagConnection(number, topic, msgtype, digest, counts[key])
    return connections


class _Metadata:
    """Content of a bag's metadata.yaml.

    Raises: ConfigError: If it is missing or damaged, or a file that it names is missing.
    """

    def __init__(self, folder: Path) -> None:
        path = folder / METADATA
        try:
            content: Any = read_yaml(path)["rosbag2_bagfile_information"]
            self.files = [folder / Path(name).name for name in content["relative_file_paths"]]
            self.count = int(content["message_count"])
            """Number of messages."""
            topics = [entry["topic_metadata"] for entry in content["topics_with_message_count"]]
            self.digests: Mapping[str, str] = {
                topic["name"]: topic.get("type_description_hash", "") for topic in topics
            }
            """Hashes of types by topic."""
        except (ConfigError, LookupError, TypeError, ValueError, AttributeError) as error:
            raise ConfigError(
                f"{path}: is missing or damaged: `ros2 bag reindex {folder}` writes it again, or give one of "
                "the bag's files instead of the folder"
            ) from error
        for file in self.files:
            if not file.is_file():
                raise ConfigError(
                    f"{folder}: {file.name} is missing: copy it there, or give another file alone"
                )


def _is_storage(path: Path) -> bool:
    return Path(path.name.removesuffix(COMPRESSED)).suffix in REPAIRS


def _open_storage(file: Path, storage: Path, stack: ExitStack) -> Any:
    """Return a reader of `storage`, which is `file` or unpacked from it, after it was read to its end.

    Raises: ConfigError: If it is damaged.
    """
    _check_closed(file)
    suffix = storage.suffix
    try:
        # rosbags and SQLite would not notice all damages.
        if suffix == ".mcap":
            _check_chunks(storage)
        else:
            _check_pages(storage)
        reader: Any = stack.enter_context(Reader(str(storage)))
        _check_messages(reader)
    except Exception as error:  # those of rosbags, SQLite and the packings
        if "Profile is not ros2" in str(error):
            raise ConfigError(
                f"{file}: is an MCAP file, but not of ROS 2: if it is a recording of PointIt, give it to "
                "`pointit export`, `page` or `replay`"
            ) from error
        repair = REPAIRS[suffix].format(storage.name)
        if file != storage:
            command = f"zstd -dcf {shlex.quote(str(file))} > {shlex.quote(storage.name)}"
            repair = f"`{command}` unpacks what is there, and {repair}"
        raise ConfigError(f"{file}: is damaged ({error}): {repair}") from error
    return reader


def _check_closed(file: Path) -> None:
    """Check that a file has content, and that SQLite keeps none of it beside the file.

    Raises: ConfigError: If not.
    """
    if not file.is_file():
        raise ConfigError(f"{file}: is missing: record or copy it again")
    if not file.stat().st_size:
        raise ConfigError(f"{file}: is empty: record or copy it again")
    for end in ("-wal", "-journal"):
        journal = file.with_name(file.name + end)
        if journal.is_file() and journal.stat().st_size:
            raise ConfigError(
                f"{file}: its recorder did not close it, and messages are in the journal beside it: "
                f"`sqlite3 {file} 'PRAGMA integrity_check'` moves them into the file"
            )


def _check_messages(reader: Any) -> None:
    """Check the format of the messages, and that there are as many as the index states.

    Raises: DamagedError: If not.
    """
    formats = {connection.ext.serialization_format for connection in reader.connections} - {"cdr"}
    if formats:
        raise DamagedError(f"has messages in {min(formats)[:20]!r}, not in 'cdr'")
    count = sum(1 for _ in reader.messages())  # the damage may be in the last message
    if count != reader.message_count:
        raise DamagedError(f"has {count} messages, and {reader.message_count} by its index")


def _check_chunks(path: Path) -> None:
    """Check that an MCAP file is whole, and that its chunks unpack to no more than the limit.

    Raises: DamagedError: If not.
    """
    with path.open("rb") as file:
        for place in records(file):
            if place.opcode == DAMAGED:
                raise DamagedError("it is damaged in the middle")
            if place.opcode == Opcode.CHUNK:
                unpack(read(file, place, Chunk), packings=UNPACKERS)


def _check_pages(path: Path) -> None:
    """Check that an SQLite file has the size that its header states. SQLite reads missing bytes as zeros.

    Raises: DamagedError: If not.
    """
    with path.open("rb") as file:
        head = file.read(100)
    page_bytes = int.from_bytes(head[16:18], "big")
    pages = int.from_bytes(head[28:32], "big")
    if page_bytes == 1:  # the format's code for a size that its two bytes cannot hold
        page_bytes = 65536
    size = path.stat().st_size
    if not head.startswith(b"SQLite format 3\0") or size != pages * page_bytes:
        raise DamagedError(f"has {size} bytes, and its head states {pages} pages of {page_bytes}")
    _check_tables(path)


def _check_tables(path: Path) -> None:
    """Check that an SQLite file has plain tables only.

    A view or a generated column needs no bytes of the file, and can yield rows without end.

    Raises: DamagedError: If not.
    """
    with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)) as database:
        database.execute("PRAGMA trusted_schema = OFF")
        kinds = database.execute("SELECT name, type, sql FROM sqlite_schema WHERE type != 'index'").fetchall()
        for name, kind, sql in kinds:
            is_plain = kind == "table" and not str(sql).upper().startswith("CREATE VIRTUAL")
            if is_plain:
                columns = database.execute("SELECT hidden FROM pragma_table_xinfo(?)", [name])
                is_plain = not any(hidden for (hidden,) in columns)
            if not is_plain:
                raise DamagedError(f"its {kind} {str(name)[:20]!r} is computed, and no plain table")


def _temporary_folder(path: Path, stack: ExitStack) -> Path:
    """Return a folder in which `path` can be unpacked. Raises: ConfigError: If none can be written."""
    try:
        return Path(stack.enter_context(tempfile.TemporaryDirectory()))
    except OSError as error:
        raise ConfigError(
            f"{path}: is packed, and no temporary folder can be written ({system_reason(error)}): set "
            "TMPDIR to a folder that can be, or unpack the file by `zstd -d` and give that one"
        ) from error


def _unpack(path: Path, folder: Path) -> Path:
    """Return the unpacked file of `path` in `folder`. Raises: ConfigError: If it is too large or no zstd."""
    unpacked = folder / path.stem
    ratio_bytes = MAX_RATIO * path.stat().st_size if path.is_file() else 0
    max_bytes = min(ratio_bytes, shutil.disk_usage(folder).free - RESERVE_BYTES)
    by_hand = f"`zstd -d {shlex.quote(str(path))}` unpacks it: give the unpacked file"
    try:
        with path.open("rb") as packed, unpacked.open("wb") as file:
            copy_zstd(packed, file, max_bytes)
    except TooLargeError as error:
        limit = f"{MAX_RATIO} times its size" if max_bytes == ratio_bytes else "the free space"
        raise ConfigError(f"{path}: unpacks to more than {limit} ({max_bytes} bytes); {by_hand}") from error
    except UnpackError as error:
        raise ConfigError(f"{path}: {error}: copy it again; {by_hand}") from error
    return unpacked


def unpack_message(data: bytes) -> bytes:
    """Return a serialized message, unpacked if it is compressed and can be."""
    if not data.startswith(_ZSTD_MAGIC):
        return data
    with suppress(UnpackError):
        return unpack_zstd(data)
    return data
