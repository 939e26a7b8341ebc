"""Who was refused what, read from a router's own log: the only place where Zenoh tells of it.

At level TRACE its access control writes a line for every decision. Those that it works out beforehand for a
key it hears of (`caching permissions`, then one line for each kind of message) are nobody's attempts. What
is let in and dropped right after is too long for its key. Who writes too often is told, too.

A key may hold anything but what colours are made of, which Zenoh writes as text: a line that does not begin
with a colour is the rest of a key, with which somebody wants to lay the blame on others.
"""

import re
import threading
from collections import Counter, defaultdict

from pointit.access import rejected_connections
from pointit.access.rejected_connections import RejectedConnections

KINDS = 9
"""Kinds of messages, each a line after `caching permissions`."""
MOST_KEYS = 3
MOST_NAMES = 1000
"""Connections and identities remembered; somebody may come again and again."""
MOST_WRITTEN = 10_000
"""Keys that are counted at a time."""
FLOOD_HZ = 1000.0
"""No key needs more: wrists give 200 Hz at most, and of most keys only the newest counts."""
ID_LENGTH = 32
"""Characters of a connection's own name, at most."""

OWN = "\x1b["
"""What each line of Zenoh's own begins with."""
PLAIN = "\x1b[0m "
"""After the coloured part of a line, before what it says."""
LONGEST_KEY = 100
"""Characters of a key that are kept and shown."""

COLOR = re.compile(r"\x1b\[[0-9;]*m")
THREAD = "ThreadId("
DECIDED = re.compile(
    r"(?:Using cached result: )?(\w+)(?: on (\S+))? is (?:un)?authorized to (.+?) \(ingress\) on (\S+)"
)
"""Connection, what is known of it, kind of message, key; anchored: the rest of a line may be anything."""
KNOWN = re.compile(r"(?:CertCommonName|Username)\(([^)]+)\)")
DECISION = "authorized to "
WORKS_OUT = "caching permissions"
WRITES = " is authorized to Put (ingress) on "
DROPPED = "interceptor: Msg intercepted!"

VERBS = {
    "Put": "write",
    "Delete": "write",
    "Reply": "answer",
    "Query": "ask",
    "Subscriber": "read",
    "Queryable": "answer",
    "Liveliness Token": "be present as",
    "Liveliness Query": "watch",
    "Liveliness Subscriber": "watch",
}
"""By the name of the message, without `Declare`; to undeclare what was refused is nobody's attempt."""
LATE_VERBS = {
    message: "write" if verb in ("write", "answer", "be present as") else "read"
    for message, verb in VERBS.items()
}
"""The same of what writers keep for late joiners, below `@adv` of their key."""
TOO_LONG_VERBS = {
    "Put": "write such long messages to",
    "Query": "ask such long questions of",
    "Reply": "give such long answers to",
}

MARKS = (b"is unauthorized to ", b"+CertCommonName(", b"+Username(")
"""In lines that tell of refusals and of who a connection is, which are taken before others."""
FILTER = (
    "off,zenoh::net::routing::interceptor=trace,zenoh::net::routing::interceptor::qos_overwrite=off"
    f",{rejected_connections.FILTER}"
)
"""What of its log Zenoh has to write for this."""


class DeniedOperations:
    """Counts attempts that a router has refused, and who writes without measure; on any threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        """The log is read in a thread of its own."""
        self.total = 0
        """How many attempts there were so far."""
        self._attempts: dict[str, Counter[tuple[str, str]]] = defaultdict(Counter)
        self.rates_hz: dict[str, float] = {}
        """Messages a second by identity, until sentences were taken last; at least, where there are many."""
        self.keys: dict[str, frozenset[str]] = {}
        """Keys written by each identity in the same time."""
        self._strangers = RejectedConnections()
        self._written: Counter[str] = Counter()
        """By the end of the line: connection and key."""
        self._names: dict[str, str] = {}
        """Identity by connection."""
        self._working_out: dict[str, int] = {}
        """By thread: lines still to come that are no attempts."""
        self._let_in: dict[str, str] = {}
        """By thread: its last line, if that lets something in."""

    def take(self, line: str) -> None:
        """Take one line of the log."""
        if line.startswith(OWN):
            with self._lock:
                self._take(line)

    def take_sentences(self, elapsed_s: float) -> dict[str, str]:
        """Return what was refused in the last `elapsed_s`, and who wrote too often, and forget it.

        Returns:
            A sentence by the identity it is about, `SITE/NAME`; by an empty name, of whom nobody knows.
        """
        with self._lock:
            return self._take_sentences(elapsed_s)

    def identity(self, connection: str) -> str:
        """Return the identity of a connection, or nothing if it has done nothing so far."""
        return self._names.get(connection, "").rpartition("/")[0]

    def _take(self, line: str) -> None:
        at = line.find(THREAD) + len(THREAD)
        end = line.find(")", at)
        where = line[at:end]
        before = self._let_in.pop(where, "")
        if line.startswith(rejected_connections.TARGET, end + 2):  # who knocks chooses some of what follows
            self._take_other(line, where, "")
            return
        decision, works_out = line.find(DECISION), line.find(WORKS_OUT)
        if works_out >= 0 and (decision < 0 or works_out < decision):  # the key that follows may say anything
            self._working_out[where] = KINDS
        elif decision < 0:
            self._take_other(line, where, before)
        elif self._working_out.get(where, 0) and "Using cached" not in line[:decision]:
            self._working_out[where] -= 1
            self._read(line)
        elif line.startswith("un", decision - 2):
            self._count(line, LATE_VERBS if "/@adv" in line else VERBS)
        else:
            self._let_in[where] = line
            self._take_let_in(line)

    def _take_sentences(self, elapsed_s: float) -> dict[str, str]:
        clauses: dict[str, list[str]] = defaultdict(list)
        for name, attempts in self._attempts.items():
            clauses[name].append(f"may not {_listed(attempts)}: refused")
        for name, floods in self._floods(elapsed_s).items():
            key, count = floods.most_common(1)[0]
            clauses[name].append(
                f"writes {key} {count / elapsed_s:.0f} times a second, more than anybody needs: end what does"
            )
        sentences = {name: f"{name} {' and '.join(told)}" for name, told in sorted(clauses.items())}
        if sentence := self._strangers.pop_summary():
            sentences[""] = sentence
        rates: Counter[str] = Counter()
        keys: dict[str, set[str]] = defaultdict(set)
        for line, count in self._written.items():
            who = self._who(_connection(line))
            rates[who] += count
            keys[who].add(_without(line.partition(WRITES)[2]))
        self.keys = {name: frozenset(own) for name, own in keys.items()}
        self.rates_hz = {name: count / elapsed_s for name, count in rates.items()}
        for counted in (self._attempts, self._written):
            counted.clear()
        return sentences

    def _take_let_in(self, line: str) -> None:
        """Count what is written; without regular expressions, for this is done for every message."""
        at = line.find(WRITES)
        if at < 0:
            return
        written = line[max(at - ID_LENGTH, 0) : at + len(WRITES) + LONGEST_KEY]
        if written not in self._written:
            self._read(line)
            if len(self._written) >= MOST_WRITTEN:
                return
        self._written[written] += 1

    def _take_other(self, line: str, where: str, before: str) -> None:
        plain = COLOR.sub("", line)
        if before and plain.endswith(DROPPED):
            self._count(before, TOO_LONG_VERBS)
        elif self._strangers.take(plain, where):
            self.total += 1

    def _read(self, line: str) -> tuple[str, str, str] | None:
        """Return connection, kind of message and key of a decision on what came in; none of any other."""
        body = line[line.rfind(PLAIN, 0, line.find(DECISION)) + len(PLAIN) :]
        found = DECIDED.match(body)
        if found is None:
            return None
        connection, properties, message, key = found.groups()
        if properties and (known := KNOWN.search(properties)):
            # Who connects chooses the name of the connection: it may be one that somebody else had before.
            if connection not in self._names and len(self._names) >= MOST_NAMES:
                self._names.pop(next(iter(self._names)))
            self._names[connection] = known[1]
        return connection, message.removeprefix("Declare/Undeclare ").removeprefix("Declare "), key

    def _who(self, connection: str) -> str:
        name = self._names.get(connection, f"connection {connection[:8]}")
        return name.rpartition("/")[0] or name

    def _count(self, line: str, verbs: dict[str, str]) -> None:
        read = self._read(line)
        verb = verbs.get(read[1]) if read is not None else None
        if read is None or verb is None:
            return
        connection, _, key = read
        self.total += 1
        who = self._who(connection)
        if who not in self._attempts and len(self._attempts) >= MOST_NAMES:
            return
        attempts, attempt = self._attempts[who], (verb, _without(key))
        if attempt in attempts or len(attempts) < MOST_NAMES:
            attempts[attempt] += 1

    def _floods(self, elapsed_s: float) -> dict[str, Counter[str]]:
        floods: dict[str, Counter[str]] = defaultdict(Counter)
        for line, count in self._written.items():
            if count > FLOOD_HZ * elapsed_s:
                floods[self._who(_connection(line))][_without(line.partition(WRITES)[2])] += count
        return floods


def _connection(written: str) -> str:
    """Return the connection in the end of a line."""
    return re.split(r"\W", written.partition(WRITES)[0])[-1]


def _listed(attempts: Counter[tuple[str, str]]) -> str:
    """Return what somebody may not, by verb: `write map (2 times), users/ben/imu and 4 more, ask leds/x`."""
    by_verb: dict[str, list[str]] = defaultdict(list)
    for (verb, key), count in attempts.most_common():
        by_verb[verb].append(key + (f" ({count} times)" if count > 1 else ""))
    return ", ".join(
        f"{verb} {', '.join(keys[:MOST_KEYS])}"
        + (f" and {len(keys) - MOST_KEYS} more" if len(keys) > MOST_KEYS else "")
        for verb, keys in by_verb.items()
    )


def _without(key: str) -> str:
    """Return a key without the site's namespace and without what an identity tests its rights by."""
    plain = key.partition("/@")[0]
    plain = plain.split("/", 2)[2] if plain.startswith("pointit/") and plain.count("/") > 1 else plain
    shown = "".join(letter if letter.isprintable() else "?" for letter in plain[:LONGEST_KEY])
    return shown + ("…" if len(plain) > LONGEST_KEY else "")
