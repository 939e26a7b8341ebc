"""Reader of the trace log of Zenoh's router, which alone has what it denied and what each client sends.

At level TRACE Zenoh's access control writes a line for every decision. Decisions that it caches for a new key
(`caching permissions`, then one line for each kind of message) are not attempts. A message that is allowed
and dropped right after is too long for its key, or one of its readers has just left: then it goes out to
others, if there are any. The only reader of a self-test is its second session, and its messages are short.

Access control decides on no interests: their lines are of the router itself, with the first characters of the
connection's name. Nothing is written about fragments and ends of answers.

A key may hold anything but the first bytes of colours, which Zenoh writes as text. So a line that does not
begin with a colour is the rest of a key, forged to blame another identity.

The text is not part of Zenoh's interface. It was read from version `ZENOH_VERSION`, of which
`tests/unit/access/zenoh_trace.log` is a sample.
"""

import re
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from pointit.access.rejected_connections import HANDSHAKE_TARGET, REJECTION_FILTER, RejectedConnections
from pointit.runtime.link.link import ROOM

ZENOH_VERSION = "1.10.2"
"""Version of Zenoh whose log this reads."""
FILTER = (
    "off,zenoh::net::routing::interceptor=trace,zenoh::net::routing::interceptor::qos_overwrite=off"
    ",zenoh::net::routing::hat::router::interests=debug"
    f",{REJECTION_FILTER}"
)
"""Log filter with which Zenoh tells what is denied and who is rejected."""
MARKS = (b"is unauthorized to ", b"+CertCommonName(", b"+Username(")
"""Marks of lines on denials and on identities of connections, which take priority."""

DEBUG = b"\x1b[34mDEBUG\x1b[0m "
INTERCEPTOR = b"\x1b[2mzenoh::net::routing::interceptor"
TIME_LENGTH = len("\x1b[2m2026-03-01T00:00:00.000000Z\x1b[0m ")
HEAD_LENGTH = 110
"""Number of bytes at the start of a line, in which there is no text of a client."""

KINDS = 9
"""Number of kinds of messages, each a line after `caching permissions`."""
MAX_NAMES = 10_000
"""Limit of remembered connections. `keep` forgets those that have ended."""
MAX_COUNTED = 10_000
"""Limit of operations that are counted apart at a time, of each kind. Others count by connection only."""
ID_LENGTH = 32
"""Maximum number of characters of a connection's name."""
MAX_KEY_LENGTH = 200
"""Maximum number of characters of a key that are kept."""
LONG_LENGTH = 1000
"""Number of characters of a line above which its length is counted. Only keys of strangers exceed it."""
CHARACTERS_OF_MESSAGE = 100
"""Number of characters of a long line whose load is that of one more message."""
OWN = "\x1b["
"""First characters of each of Zenoh's own lines."""
PLAIN = "\x1b[0m "
"""Characters after the coloured part of a line, before its message."""
COLOR = re.compile(r"\x1b\[[0-9;]*m")
THREAD = "ThreadId("
DECIDED = re.compile(
    r"(?:Using cached result: )?(\w+)(?: on (\S+))? is (?:un)?authorized to (.+?) \(ingress\) on (\S*)"
)
"""Connection, its properties, kind of message, key. Anchored, as the rest of a line may be anything."""
COMMON_NAME = re.compile(r"(?:CertCommonName|Username)\(([^)]+)\)")
DECISION = "authorized to "
CACHING = "caching permissions"
WRITES = " is authorized to Put (ingress) on "
ANSWERS = " is authorized to Reply (ingress) on "
INGRESS = " (ingress) on "
EGRESS = " (egress) on "
DROPPED = "interceptor: Msg intercepted!"
DOWNSAMPLING_TARGET = "\x1b[2mzenoh::net::routing::interceptor::downsampling\x1b"
INTEREST = "\x1b[1mroute_interest"
"""Start of lines on interests, behind the thread. Access control decides on none of them."""
INTEREST_FROM = re.compile(r"\x1b\[3msrc\x1b\[0m\x1b\[2m=\x1b\[0m\S*/(\w+):\d+\x1b")
"""First characters of the connection's name. They are behind the key, which cannot have such colours."""
DROP = "interceptor: "
FROM = ") from:"
TOO_FREQUENT = re.compile(r"interceptor: (Push|Request)\((.+)\) from:\S*/(\w+):\d+$", re.DOTALL)
"""Write or question, its key, and the first characters of the connection's name."""
DOWNSAMPLED_MESSAGES = {"Push": "Put", "Request": "Query"}
"""Names of messages in decisions by those in lines on downsampling."""
SELF_TEST = f"/{ROOM}/"
"""Text in the keys of `PermissionProbe`."""
INTERNAL = "/@"
"""Start of the part of a key that only Zenoh's own exchange and tests of rights have."""


class Operation(NamedTuple):
    """Operation of a client on a key."""

    connection: str
    """Name of the connection, or its first characters if that is all that is known."""
    common_name: str
    """Common name of its certificate, or user name; `""` if unknown."""
    message: str
    """Zenoh's name of the kind of message, such as `Put`, `Query` or `Subscriber`."""
    key: str
    """Complete key, or its first `MAX_KEY_LENGTH` characters."""
    is_internal: bool = False
    """True if the key is one below `@`."""


@dataclass(kw_only=True)
class TraceCounts:
    """Numbers of operations since the last `pop`."""

    writes: Counter[Operation] = field(default_factory=Counter[Operation])
    """Allowed writes."""
    requests: Counter[Operation] = field(default_factory=Counter[Operation])
    """Allowed questions and declarations."""
    denied: Counter[Operation] = field(default_factory=Counter[Operation])
    """Denied operations of all kinds."""
    too_frequent: Counter[Operation] = field(default_factory=Counter[Operation])
    """Writes and questions that were dropped by the maximum rate of their key."""
    too_long: Counter[Operation] = field(default_factory=Counter[Operation])
    """Operations that were dropped since they are too long. They are in `writes` or `requests`, too."""
    long_lines: Counter[str] = field(default_factory=Counter[str])
    """Additional load of long keys by common name, in messages."""
    rejected: Counter[str] = field(default_factory=Counter[str])
    """Rejected connections by reason."""


def version_warning(version: str) -> str:
    """Return a warning if the installed `version` of Zenoh is another than that whose log was read."""
    if version == ZENOH_VERSION:
        return ""
    return (
        f"Zenoh {version} is installed, but denied operations and floods are read from the log of "
        f"{ZENOH_VERSION}, and may go unnoticed: install eclipse-zenoh=={ZENOH_VERSION}"
    )


def is_configuration(line: bytes) -> bool:
    """Return True for a line on the rules of a new connection: 44 for each person of the site."""
    return line.startswith(DEBUG, TIME_LENGTH) and INTERCEPTOR in line[:HEAD_LENGTH]


class ZenohTrace:
    """Counts the operations in lines of the log. Thread-safe: the log is read in a separate thread."""

    def __init__(self, on_identity: Callable[[], object] = bool) -> None:
        """Count from now on. `on_identity` is called in the thread of `take` when one becomes known."""
        self._on_identity = on_identity
        self._lock = threading.Lock()
        self._rejected_connections = RejectedConnections()
        self._writes: Counter[str] = Counter()
        """Counts by the end of the line: connection and key."""
        self._requests: Counter[tuple[str, bool]] = Counter()
        """Counts by the start of the message of the line, and whether its key is internal."""
        self._denied: Counter[tuple[str, bool]] = Counter()
        """The same of denied operations."""
        self._too_long: Counter[tuple[str, bool]] = Counter()
        """The same of operations that are too long."""
        self._too_frequent: Counter[str] = Counter()
        """Counts by the end of the line."""
        self._interests: Counter[str] = Counter()
        """By the first characters of the connection."""
        self._long_lines: Counter[str] = Counter()
        """By connection."""

        # Operations are counted by connection. Its name is learned from any line that has it
        self._names: dict[str, str] = {}
        """Common name by connection."""
        self._new_names: dict[str, str] = {}
        """Those of `_names` since the last `keep`."""

        # Lines of several threads mix, so what a line means depends on the one before it of its thread
        self._decisions_to_skip: dict[str, int] = {}
        """By thread: number of following lines that are not attempts."""
        self._allowed: dict[str, str] = {}
        """By thread: its last line, if that allows something."""
        self._dropped: dict[str, str] = {}
        """By thread: the line that allows the message which its last line drops."""

    def take(self, line: str, times: int = 0) -> None:
        """Process one line of the log, or one that came `times` times among others that are left out."""
        if not line.startswith(OWN):
            return
        with self._lock:
            if times:  # lines in between are missing
                self._allowed.clear()
                self._dropped.clear()
            self._take(line, max(times, 1), in_order=not times)

    def pop(self) -> TraceCounts:
        """Return and reset the counts."""
        with self._lock:
            for line in self._dropped.values():
                self._count(self._too_long, line, 1)
            self._dropped.clear()
            return self._pop()

    def keep(self, common_names: Mapping[str, str]) -> None:
        """Forget all connections but these, by name, and those that have become known since the last call.

        A common name is `""` where only the log has it (sites with passwords).
        """
        with self._lock:
            names = dict(self._new_names)
            for connection, common_name in common_names.items():
                name = common_name or self._names.get(connection, "")
                if name:
                    names[connection] = name
            self._names = names
            self._new_names = {}

    def common_name(self, connection: str) -> str:
        """Return the common name of a connection, or `""` if it has not done anything yet."""
        return self._names.get(connection, "")

    def _take(self, line: str, times: int, *, in_order: bool) -> None:
        start = line.find(THREAD) + len(THREAD)
        end = line.find(")", start)
        thread = line[start:end]
        allowed = self._allowed.pop(thread, "")
        if line.startswith(INTEREST, end + 2):
            self._take_interest(line, times)
            return
        self._decide_dropped(line, thread)

        # A newcomer controls parts of the rest of a line on a handshake.
        if line.startswith(HANDSHAKE_TARGET, end + 2):
            self._take_other(line, thread, "")
            return
        decision = line.find(DECISION)
        caching = line.find(CACHING)
        # The key that follows may be any text, so what stands first decides.
        if caching >= 0 and (decision < 0 or caching < decision):
            self._decisions_to_skip[thread] = KINDS
        elif line.startswith(DOWNSAMPLING_TARGET, end + 2):
            self._take_too_frequent(line, times)
        elif decision < 0:
            self._take_other(line, thread, allowed)
        elif self._decisions_to_skip.get(thread, 0) and "Using cached" not in line[:decision]:
            self._decisions_to_skip[thread] -= 1
            self._learn_name(line)
        elif line.startswith("un", decision - 2):
            if INGRESS in line:
                self._count(self._denied, line, times)
                self._count_long_line(line, times)
        else:
            if in_order:
                self._allowed[thread] = line
            self._take_allowed(line, times)

    def _take_allowed(self, line: str, times: int) -> None:
        """Count a write, without regular expressions since this runs for every message, or a request."""
        written = line.find(WRITES)
        if written < 0:
            if INGRESS in line and ANSWERS not in line:
                self._count(self._requests, line, times)
                self._count_long_line(line, times)
            return
        operation = line[max(written - ID_LENGTH, 0) : written + len(WRITES) + MAX_KEY_LENGTH]
        if operation not in self._writes:
            self._learn_name(line)
            if len(self._writes) >= MAX_COUNTED:
                operation = line[max(written - ID_LENGTH, 0) : written + len(WRITES)]
        self._writes[operation] += times
        self._count_long_line(line, times)

    def _take_interest(self, line: str, times: int) -> None:
        """Count a question for all that is declared now or later, such as of a new publisher for readers."""
        source = INTEREST_FROM.search(line)
        if source is None:  # the end of an interest
            return
        connection = source[1]
        if connection in self._interests or len(self._interests) < MAX_COUNTED:
            self._interests[connection] += times

    def _take_too_frequent(self, line: str, times: int) -> None:
        text = line[line.find(DROP) :]
        if FROM not in text:
            return
        if text in self._too_frequent or len(self._too_frequent) < MAX_COUNTED:
            self._too_frequent[text] += times

    def _decide_dropped(self, line: str, thread: str) -> None:
        """Count the last dropped message of a thread as too long, unless `line` is on its further readers."""
        if thread not in self._dropped:
            return
        if INGRESS not in line and EGRESS not in line:
            return
        dropped = self._dropped.pop(thread)
        if not line.endswith(f"{EGRESS}{dropped.partition(INGRESS)[2]}"):
            self._count(self._too_long, dropped, 1)

    def _take_other(self, line: str, thread: str, allowed: str) -> None:
        plain = COLOR.sub("", line)
        if allowed and plain.endswith(DROPPED):
            if INGRESS in allowed and SELF_TEST not in allowed:
                self._dropped[thread] = allowed
            return
        self._rejected_connections.take(plain, thread)

    def _count(self, counts: Counter[tuple[str, bool]], line: str, times: int) -> None:
        start = line.rfind(PLAIN, 0, line.find(DECISION)) + len(PLAIN)
        ingress = line.find(INGRESS) + len(INGRESS)
        operation = (line[start : ingress + MAX_KEY_LENGTH], INTERNAL in line)
        if operation not in counts:
            self._learn_name(line)
            if len(counts) >= MAX_COUNTED:
                operation = (line[start:ingress], INTERNAL in line)
        counts[operation] += times

    def _count_long_line(self, line: str, times: int) -> None:
        if len(line) < LONG_LENGTH:
            return
        decided = _decided(line)
        if decided is not None:
            messages = len(line) // CHARACTERS_OF_MESSAGE
            self._long_lines[self._name(decided[1])] += times * messages

    def _learn_name(self, line: str) -> None:
        """Remember the common name of a connection where a line has it."""
        decided = _decided(line)
        if decided is None or not decided[2]:
            return
        common_name = COMMON_NAME.search(decided[2])
        if common_name is None:
            return
        # The client chooses the name of the connection, possibly one that another client had before.
        connection = decided[1]
        if connection not in self._names and len(self._names) >= MAX_NAMES:
            self._names.pop(next(iter(self._names)))
        is_new = self._names.get(connection) != common_name[1]
        self._names[connection] = common_name[1]
        if len(self._new_names) < MAX_NAMES:
            self._new_names[connection] = common_name[1]
        if is_new:
            self._on_identity()

    def _name(self, connection: str) -> str:
        return self._names.get(connection, "")

    def _pop(self) -> TraceCounts:
        counts = TraceCounts(rejected=self._rejected_connections.pop(), long_lines=self._long_lines)
        for text, count in self._writes.items():
            connection, _, key = text.partition(WRITES)
            connection = connection.rpartition("+")[2].rpartition(" ")[2]
            operation = Operation(connection, self._name(connection), "Put", key)
            counts.writes[operation] += count
        self._pop_decisions(self._requests, counts.requests)
        self._pop_decisions(self._denied, counts.denied)
        self._pop_decisions(self._too_long, counts.too_long)

        # Lines on downsampling have only the start of a connection's name, so decisions complete it
        senders = [_connections_by_key(counts.denied), _connections_by_key(counts.writes)]
        for text, count in self._too_frequent.items():
            downsampled = TOO_FREQUENT.match(text)
            if downsampled is None:
                continue
            message = DOWNSAMPLED_MESSAGES[downsampled[1]]
            key = downsampled[2][:MAX_KEY_LENGTH]
            connection = self._connection_of(downsampled[3], key, senders)
            operation = Operation(connection, self._name(connection), message, key)
            counts.too_frequent[operation] += count

        for start, count in self._interests.items():
            connection = self._connection_of(start, "", senders)
            counts.requests[Operation(connection, self._name(connection), "Interest", "")] += count

        # The counts above hold the present counter of long lines itself
        self._long_lines = Counter()
        self._interests.clear()
        for counter in (self._writes, self._requests, self._denied, self._too_long, self._too_frequent):
            counter.clear()
        return counts

    def _pop_decisions(self, texts: Counter[tuple[str, bool]], operations: Counter[Operation]) -> None:
        for (text, is_internal), count in texts.items():
            decided = DECIDED.match(text)
            if decided is None:
                continue
            connection, _, message, key = decided.groups()
            message = message.removeprefix("Declare/Undeclare ").removeprefix("Declare ")
            operation = Operation(connection, self._name(connection), message, key, is_internal)
            operations[operation] += count

    def _connection_of(self, start: str, key: str, senders: Sequence[Mapping[str, set[str]]]) -> str:
        """Return the connection whose name begins so, or `start` if those of several identities do.

        Who takes the first characters of the name of another's connection neither blames it nor goes
        unseen: of what is too frequent some is decided on, with the whole name. `senders` are the connections
        of these decisions by key, those of denied ones first.
        """
        # Connections of several identities may begin so: then decisions on the key tell
        connection = self._only_connection(self._names, start)
        for by_key in senders:
            if not connection:
                connection = self._only_connection(by_key.get(key, ()), start)
        return connection or start

    def _only_connection(self, connections: Iterable[str], start: str) -> str:
        """Return a connection whose name begins so, `""` if there is none or those of several identities."""
        owners: dict[str, str] = {}
        for connection in connections:
            if connection.startswith(start):
                owners[identity_of(self._name(connection))] = connection
        if len(owners) != 1:
            return ""
        return next(iter(owners.values()))


def identity_of(common_name: str) -> str:
    """Return the identity, `SITE/NAME`, of a common name `SITE/NAME/GENERATION`; of others, the name."""
    return common_name.rpartition("/")[0] or common_name


def _connections_by_key(operations: Iterable[Operation]) -> dict[str, set[str]]:
    connections: dict[str, set[str]] = {}
    for operation in operations:
        connections.setdefault(operation.key, set()).add(operation.connection)
    return connections


def _decided(line: str) -> re.Match[str] | None:
    start = line.rfind(PLAIN, 0, line.find(DECISION)) + len(PLAIN)
    return DECIDED.match(line, start)
