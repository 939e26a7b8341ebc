"""Denied operations and rejected connections, read from a router's log, which alone has them.

On a site with certificates, TLS reports them. On a site with passwords, TLS accepts all clients, and Zenoh's
own handshake reports: first the address, then, in the same thread, the reason.

At level TRACE its access control writes a line for every decision. Decisions that it caches for a new key
(`caching permissions`, then one line for each kind of message) are not attempts. A message that is allowed
and dropped right after is too long for its key, or one of its readers has just left: then it goes out to
others, if there are any. The only reader of a self-test is its second session, and its messages are short.
Writers with excessive rates are reported, too.

A key may hold anything but the first bytes of colours, which Zenoh writes as text. So a line that does not
begin with a colour is the rest of a key, forged to blame another identity.
"""

import re
import threading
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Mapping

from pointit.access.rights import INTERNAL_COST, REQUEST_COST, max_rate_hz
from pointit.runtime.link.link import ROOM
from pointit.schemas.problems import DENIED, Problem
from pointit.schemas.text import first_of

REJECTION_FILTER = (
    "zenoh_link_tls=warn,zenoh_link_quic=warn"
    ",zenoh_transport::unicast::establishment::accept=trace,zenoh_transport::unicast::manager=debug"
)
"""Log filter with which Zenoh tells who is rejected: a few lines for each connection."""
TARGET = "\x1b[2mzenoh_transport::"
"""Text after the thread in lines of Zenoh's own handshake, none of which contains keys of messages."""
MAX_SHOWN = 3
MAX_REASONS = 1000
"""Limit of distinct reasons at a time, as unknown peers choose their names."""
REJECTION_THREAD = r"(?:\S+ )?ThreadId\(\d+\) "
BEGINS = rf"^\S+ +\w+ +{REJECTION_THREAD}"
"""Start of a line: time, level, thread. Zenoh's text follows its target, with words of an unknown peer."""
HANDSHAKE = re.compile(
    rf"^\S+ +WARN +{REJECTION_THREAD}zenoh_link_(?:tls|quic)\S*: "
    r"(.+?)(?:: verification time .*)?(?:\. Hint: .*)?\.?$"
)
PLAIN_TCP = "received corrupt message of type InvalidContentType"
"""TLS's message if a first message was not TLS."""
WITHOUT = "came without credentials, by plain TCP instead of TLS"
ACCEPTS = rf"{BEGINS}zenoh_transport::unicast::establishment::accept: "
CONNECTION_ATTEMPTS = re.compile(
    rf"{ACCEPTS}Establishment Accept (?:Init|Open)Syn: \S+ => \w+/(\S+):\d+\. Received: "
)
PASSWORD = re.compile(rf"{ACCEPTS}UsrPwd extension - Recv \w+\. ([\w ]+)\.")
NO_ZENOH = re.compile(rf"{ACCEPTS}(?:Decode error on|Read error from) link: \S+ => \w+/(\S+?):\d+:")
SILENT = re.compile(rf"{BEGINS}zenoh_transport::unicast::manager: Failed to accept link before deadline")

REASONS = {
    "Invalid password": "a wrong password",
    "Invalid user": "an unknown or former password",
    "Expected extension": "came without a password",
}
"""Reasons by Zenoh's text on a password."""

RECENT_S = 20.0
"""Time for which a message is shown after it was last true, s."""
MAX_MESSAGES = 20

KINDS = 9
"""Number of kinds of messages, each a line after `caching permissions`."""
MAX_KEYS = 3
MAX_NAMES = 1000
"""Limit of remembered connections and identities, as clients may reconnect any number of times."""
MAX_WRITTEN = 10_000
"""Limit of keys that are counted at a time."""
FLOOD_HZ = 1000.0
"""Rate above which a key is flooded. Wrists send 200 Hz at most, and of most keys only the newest counts."""
SLOWED = 2.0
"""The same for a key of which some were dropped as too frequent (`router_configuration`), as a multiple of
its maximum rate: what waited on a link that stalled comes at once, too."""
ID_LENGTH = 32
"""Maximum number of characters of a connection's name."""
OWN = "\x1b["
"""First characters of each of Zenoh's own lines."""
PLAIN = "\x1b[0m "
"""Characters after the coloured part of a line, before its message."""
MAX_KEY = 100
"""Maximum number of characters of a key that are kept and shown."""
COLOR = re.compile(r"\x1b\[[0-9;]*m")
THREAD = "ThreadId("
DECIDED = re.compile(
    r"(?:Using cached result: )?(\w+)(?: on (\S+))? is (?:un)?authorized to (.+?) \(ingress\) on (\S+)"
)
"""Connection, its properties, kind of message, key. Anchored, as the rest of a line may be anything."""
KNOWN = re.compile(r"(?:CertCommonName|Username)\(([^)]+)\)")
DECISION = "authorized to "
WORKS_OUT = "caching permissions"
WRITES = " is authorized to Put (ingress) on "
ANSWERS = " is authorized to Reply (ingress) on "
INGRESS = " (ingress) on "
EGRESS = " (egress) on "
DROPPED = "interceptor: Msg intercepted!"
SLOWED_TARGET = "\x1b[2mzenoh::net::routing::interceptor::downsampling\x1b"
DROP = "interceptor: "
FROM = ") from:"
TOO_FREQUENT = re.compile(r"interceptor: (Push|Request)\((.+)\) from:\S*/(\w+):\d+$", re.DOTALL)
"""Write or question, its key, and the first characters of the connection's name."""

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
"""Verbs by the name of the message, without `Declare`. Undeclaring a denied key is not an attempt."""
LATE_VERBS = {
    message: "write" if verb in ("write", "answer", "be present as") else "read"
    for message, verb in VERBS.items()
}
"""Verbs for the retained data of publishers, below `@adv` of their key."""
TOO_LONG_VERBS = {
    "Put": "write such long messages to",
    "Query": "ask such long questions of",
    "Reply": "give such long answers to",
}

REVOCATION = (
    "{identity} may not {attempts}: refused, as it was revoked or its certificate replaced; end its "
    "processes, or make it valid with `pointit site renew {name}`, copy its folder there again, "
    "and restart them"
)
SELF_TEST = f"/{ROOM}/"
"""Text in the keys of `PermissionProbe`."""
MARKS = (b"is unauthorized to ", b"+CertCommonName(", b"+Username(")
"""Marks of lines on denials and on identities of connections, which take priority."""
FILTER = (
    "off,zenoh::net::routing::interceptor=trace,zenoh::net::routing::interceptor::qos_overwrite=off"
    f",{REJECTION_FILTER}"
)
"""Log filter with which Zenoh tells what is denied and who is rejected."""


class RejectedConnections:
    """Counts rejected connections by reason."""

    def __init__(self) -> None:
        self._reasons: Counter[str] = Counter()
        self._connection_attempts: dict[str, str] = {}
        """By thread: address of its last unknown peer."""

    def take(self, line: str, where: str) -> bool:
        """Process a line without colours of the thread `where`. Return True if it reports a rejection."""
        if knock := CONNECTION_ATTEMPTS.match(line):
            self._connection_attempts[where] = knock[1]
            return False
        reason = self._reason(line, where)
        if reason and (reason in self._reasons or len(self._reasons) < MAX_REASONS):
            self._reasons[reason] += 1
        return bool(reason)

    def pop_summary(self) -> str:
        """Return and reset the summary of the rejections since the last call, `""` if there were none."""
        if not self._reasons:
            return ""
        shown = [
            reason + (f" ({count} times)" if count > 1 else "")
            for reason, count in self._reasons.most_common()
        ]
        self._reasons.clear()
        return f"somebody was not let in: {first_of(shown, MAX_SHOWN)}"

    def _reason(self, line: str, where: str) -> str:
        if found := PASSWORD.match(line):
            address = self._connection_attempts.pop(where, "")
            reason = REASONS.get(found[1], found[1])
            return f"{reason} from {address}" if address else reason
        if found := NO_ZENOH.match(line):
            return f"came by TLS and spoke no Zenoh from {found[1]}"
        if SILENT.match(line):
            return "came by TLS and said nothing"
        if found := HANDSHAKE.match(line):
            return WITHOUT if found[1].startswith(PLAIN_TCP) else found[1]
        return ""


class RecentDenials:
    """Keeps the newest message of each identity and kind."""

    def __init__(self) -> None:
        self._messages: dict[tuple[str, str], tuple[str, float]] = {}
        """By identity (`SITE/NAME`) and kind, the oldest first: message, and time at which it was true, s."""

    def add(self, sentences: Mapping[str, str], now_s: float, kind: str = DENIED) -> None:
        """Add messages by identity and forget old ones.

        Each replaces the earlier one of the same identity and kind: a repeated message, such as that an
        identity is cut off, does not hide others. `now_s`: on any monotonic clock.
        """
        for name, sentence in sentences.items():
            self._messages.pop((name, kind), None)
            self._messages[name, kind] = (sentence, now_s)
        self._messages = {key: entry for key, entry in self._messages.items() if now_s - entry[1] <= RECENT_S}

    def of(self, site: str) -> tuple[Problem, ...]:
        """Return the problems for `site`, the newest first: those of its identities and of unknown ones."""
        there = [
            Problem(code=kind, sentence=sentence, subject=name.rpartition("/")[2])
            for (name, kind), (sentence, _) in reversed(self._messages.items())
            if name.startswith(f"{site}/") or "/" not in name
        ]
        return tuple(there[:MAX_MESSAGES])


class DeniedOperations:
    """Counts operations that a router has denied, and excessive writes. Thread-safe."""

    def __init__(self, on_identity: Callable[[], object] = bool) -> None:
        """Count from now on. `on_identity` is called in the thread of `take` when one becomes known."""
        self._on_identity = on_identity
        self._lock = threading.Lock()
        """Needed as the log is read in a separate thread."""
        self.total = 0
        """Number of attempts so far."""
        self._attempts: dict[str, Counter[tuple[str, str]]] = defaultdict(Counter)
        """By common name."""
        self.revoked: dict[str, str] = {}
        """Messages on the denials of former common names in the last interval, by identity."""
        self.rates_hz: dict[str, float] = {}
        """Load by identity in the last interval, messages per second, a lower bound if there are many keys.

        A question or a declaration counts as several messages. Answers are of those who ask.
        """
        self._rejected_connections = RejectedConnections()
        self._written: Counter[str] = Counter()
        """Counts by the end of the line: connection and key."""
        self._requests: Counter[tuple[str, int]] = Counter()
        """Counts of questions and declarations by the begin of the line and the cost of one."""
        self._slowed: Counter[str] = Counter()
        """Counts of messages dropped as too frequent, by the end of the line."""
        self._names: dict[str, str] = {}
        """Identity by connection."""
        self._working_out: dict[str, int] = {}
        """By thread: number of following lines that are not attempts."""
        self._let_in: dict[str, str] = {}
        """By thread: its last line, if that allows something."""
        self._dropped: dict[str, str] = {}
        """By thread: the line that allows the message which its last line drops."""

    def take(self, line: str, times: int = 0) -> None:
        """Process one line of the log, or one that came `times` times among others that are left out."""
        if line.startswith(OWN):
            with self._lock:
                if times:  # lines in between are missing
                    self._let_in.clear()
                    self._dropped.clear()
                self._take(line, max(times, 1), in_order=not times)

    def take_sentences(self, elapsed_s: float, former: Collection[str] = ()) -> dict[str, str]:
        """Return the denials and excessive writes of the last `elapsed_s`, and reset them.

        The denials of `former` common names go to `revoked`: those of an identity's valid certificate differ.

        Returns:
            Messages by identity, `SITE/NAME`, or by an empty name if it is unknown.
        """
        with self._lock:
            return self._take_sentences(elapsed_s, former)

    def loads(self) -> Counter[str]:
        """Return the load of questions and declarations by identity, since `take_sentences`."""
        with self._lock:
            return self._request_loads()

    def identity(self, connection: str) -> str:
        """Return the identity of a connection, or `""` if it has not done anything yet."""
        return self._names.get(connection, "").rpartition("/")[0]

    def _take(self, line: str, times: int, *, in_order: bool) -> None:
        at = line.find(THREAD) + len(THREAD)
        end = line.find(")", at)
        where = line[at:end]
        before = self._let_in.pop(where, "")
        if where in self._dropped:
            self._decide_dropped(line, where)
        if line.startswith(TARGET, end + 2):  # a newcomer controls parts of the rest
            self._take_other(line, where, "")
            return
        decision = line.find(DECISION)
        works_out = line.find(WORKS_OUT)
        if works_out >= 0 and (decision < 0 or works_out < decision):  # the key that follows may be any text
            self._working_out[where] = KINDS
        elif line.startswith(SLOWED_TARGET, end + 2):
            slowed = line[line.find(DROP) :]
            if FROM in slowed and (slowed in self._slowed or len(self._slowed) < MAX_WRITTEN):
                self._slowed[slowed] += times
        elif decision < 0:
            self._take_other(line, where, before)
        elif self._working_out.get(where, 0) and "Using cached" not in line[:decision]:
            self._working_out[where] -= 1
            self._read(line)
        elif line.startswith("un", decision - 2):
            self._count(line, LATE_VERBS if "/@adv" in line else VERBS, times)
        else:
            if in_order:
                self._let_in[where] = line
            self._take_let_in(line, times)

    def _take_sentences(self, elapsed_s: float, former: Collection[str]) -> dict[str, str]:
        for line in self._dropped.values():
            self._count(line, TOO_LONG_VERBS, 1)
        self._dropped.clear()
        slowed = self._take_slowed()
        clauses: dict[str, list[str]] = defaultdict(list)
        revoked: dict[str, Counter[tuple[str, str]]] = defaultdict(Counter)
        for common_name, attempts in self._attempts.items():
            name = _identity(common_name)
            if common_name in former:
                revoked[name] += attempts
            else:
                clauses[name].append(f"may not {_listed(attempts)}: refused")
        self.revoked = {
            name: REVOCATION.format(identity=name, attempts=_listed(attempts), name=name.rpartition("/")[2])
            for name, attempts in revoked.items()
        }
        for name, floods in self._floods(elapsed_s, slowed).items():
            key, count = floods.most_common(1)[0]
            clauses[name].append(
                f"writes {key} {count / elapsed_s:.0f} times a second, more than anybody needs: end what does"
            )
        loads = self._request_loads()
        for line, count in self._written.items():
            loads[self._identity_of(_connection(line))] += count
        self.rates_hz = {name: load / elapsed_s for name, load in loads.items()}
        sentences = {name: f"{name} {' and '.join(told)}" for name, told in sorted(clauses.items())}
        if sentence := self._rejected_connections.pop_summary():
            sentences[""] = sentence
        for counted in (self._attempts, self._written, self._requests, self._slowed):
            counted.clear()
        return sentences

    def _request_loads(self) -> Counter[str]:
        loads = Counter[str]()
        for (line, cost), count in self._requests.items():
            if decision := DECIDED.match(line):
                loads[self._identity_of(decision[1])] += count * cost
        for line, count in self._slowed.items():
            if (found := TOO_FREQUENT.match(line)) and found[1] == "Request":
                loads[self._identity_of(self._connection_of(found[3]))] += count * REQUEST_COST
        return loads

    def _take_let_in(self, line: str, times: int) -> None:
        """Count writes, without regular expressions since this runs for every message, and requests."""
        at = line.find(WRITES)
        if at < 0:
            if INGRESS in line and ANSWERS not in line:
                self._take_request(line, times)
            return
        written = line[max(at - ID_LENGTH, 0) : at + len(WRITES) + MAX_KEY]
        if written not in self._written:
            self._read(line)
            if len(self._written) >= MAX_WRITTEN:
                return
        self._written[written] += times

    def _take_request(self, line: str, times: int) -> None:
        start = line.rfind(PLAIN, 0, line.find(DECISION)) + len(PLAIN)
        begin = line[start : line.find(INGRESS) + len(INGRESS) + MAX_KEY]
        request = begin, INTERNAL_COST if "/@" in line else REQUEST_COST
        if request not in self._requests:
            self._read(line)
            if len(self._requests) >= MAX_WRITTEN:
                return
        self._requests[request] += times

    def _decide_dropped(self, line: str, where: str) -> None:
        """Count the last dropped message of a thread as too long, unless `line` is on its further readers."""
        if INGRESS in line or EGRESS in line:
            dropped = self._dropped.pop(where)
            if not line.endswith(f"{EGRESS}{dropped.partition(INGRESS)[2]}"):
                self._count(dropped, TOO_LONG_VERBS, 1)

    def _take_other(self, line: str, where: str, before: str) -> None:
        plain = COLOR.sub("", line)
        if before and plain.endswith(DROPPED):
            if INGRESS in before and SELF_TEST not in before:
                self._dropped[where] = before
        elif self._rejected_connections.take(plain, where):
            self.total += 1

    def _read(self, line: str) -> tuple[str, str, str] | None:
        """Return connection, kind of message and key of an ingress decision. None for other lines."""
        body = line[line.rfind(PLAIN, 0, line.find(DECISION)) + len(PLAIN) :]
        found = DECIDED.match(body)
        if found is None:
            return None
        connection, properties, message, key = found.groups()
        if properties and (known := KNOWN.search(properties)):
            # The client chooses the name of the connection, possibly one that another client had before.
            if connection not in self._names and len(self._names) >= MAX_NAMES:
                self._names.pop(next(iter(self._names)))
            if self._names.get(connection) != known[1]:
                self._names[connection] = known[1]
                self._on_identity()
        return connection, message.removeprefix("Declare/Undeclare ").removeprefix("Declare "), key

    def _identity_of(self, connection: str) -> str:
        return _identity(self._name_of(connection))

    def _name_of(self, connection: str) -> str:
        return self._names.get(connection, f"connection {connection[:8]}")

    def _connection_of(self, start: str) -> str:
        """Return the connection whose name begins so, or `start` if those of several identities do.

        Who takes the first characters of the name of another's connection blames nobody.
        """
        owners = {self._identity_of(each): each for each in self._names if each.startswith(start)}
        return next(iter(owners.values())) if len(owners) == 1 else start

    def _count(self, line: str, verbs: dict[str, str], times: int) -> None:
        read = self._read(line)
        verb = verbs.get(read[1]) if read is not None else None
        if read is None or verb is None:
            return
        connection, _, key = read
        self.total += times
        who = self._name_of(connection)
        if who not in self._attempts and len(self._attempts) >= MAX_NAMES:
            return
        attempts = self._attempts[who]
        attempt = (verb, _without(key))
        if attempt in attempts or len(attempts) < MAX_NAMES:
            attempts[attempt] += times

    def _take_slowed(self) -> set[str]:
        """Count what was dropped as too frequent as written, or as denied where the others of its key were.

        Returns:
            The ends of the lines on writes of which some were dropped.
        """
        slowed: set[str] = set()
        for line, count in self._slowed.items():
            if (found := TOO_FREQUENT.match(line)) is None or found[1] != "Push":
                continue
            connection = self._connection_of(found[3])
            denied = self._attempts.get(self._name_of(connection), Counter())
            if (attempt := ("write", _without(found[2]))) in denied:
                denied[attempt] += count
                self.total += count
                continue
            written = f"{connection}{WRITES}{found[2][:MAX_KEY]}"
            self._written[written] += count
            slowed.add(written)
        return slowed

    def _floods(self, elapsed_s: float, slowed: set[str]) -> dict[str, Counter[str]]:
        floods: dict[str, Counter[str]] = defaultdict(Counter)
        for line, count in self._written.items():
            key = _without(line.partition(WRITES)[2])
            if count > (SLOWED * max_rate_hz(key) if line in slowed else FLOOD_HZ) * elapsed_s:
                floods[self._identity_of(_connection(line))][key] += count
        return floods


def _identity(common_name: str) -> str:
    return common_name.rpartition("/")[0] or common_name


def _connection(written: str) -> str:
    return re.split(r"\W", written.partition(WRITES)[0])[-1]


def _listed(attempts: Counter[tuple[str, str]]) -> str:
    """Return the denied attempts by verb: `write map (2 times), users/ben/imu and 4 more, ask leds/x`."""
    by_verb: dict[str, list[str]] = defaultdict(list)
    for (verb, key), count in attempts.most_common():
        by_verb[verb].append(key + (f" ({count} times)" if count > 1 else ""))
    return ", ".join(f"{verb} {first_of(keys, MAX_KEYS)}" for verb, keys in by_verb.items())


def _without(key: str) -> str:
    """Return a key without the site's namespace and without the suffix of permission tests."""
    plain = key.partition("/@")[0]
    plain = plain.split("/", 2)[2] if plain.startswith("pointit/") and plain.count("/") > 1 else plain
    shown = "".join(letter if letter.isprintable() else "?" for letter in plain[:MAX_KEY])
    return shown + ("…" if len(plain) > MAX_KEY else "")
