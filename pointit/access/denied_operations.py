"""Denied operations, too frequent writes and rejected connections, as sentences for an operator."""

import functools
from collections import Counter, defaultdict
from collections.abc import Collection, Mapping

from pointit.access.rejected_connections import rejection_summary
from pointit.access.rights import MAX_CACHED, max_rate_hz
from pointit.access.zenoh_trace import Operation, TraceCounts, identity_of
from pointit.schemas.problems import DENIED, Problem
from pointit.schemas.text import first_of, one_line

RECENT_S = 20.0
"""Time for which a message is shown after it was last true, s."""
MAX_MESSAGES = 20

MAX_KEYS = 3
MAX_NAMES = 1000
"""Limit of counted identities, and of the attempts of each."""
MAX_WRITTEN = 10_000
"""Limit of keys whose writes are counted at a time."""
FLOOD_HZ = 1000.0
"""Rate above which a key is flooded. Wrists send 200 Hz at most, and of most keys only the newest counts."""
SLOWED = 2.0
"""The same for a key of which some were dropped as too frequent (`router_configuration`), as a multiple of
its maximum rate: what waited on a link that stalled comes at once, too."""
MAX_KEY = 100
"""Maximum number of characters of a key that are shown."""

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

Attempts = Counter[tuple[str, str]]
"""Number of denied attempts by verb and key."""


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
        for key, (_, true_s) in list(self._messages.items()):
            if now_s - true_s > RECENT_S:
                del self._messages[key]

    def of(self, site: str) -> tuple[Problem, ...]:
        """Return the problems for `site`, the newest first: those of its identities and of unknown ones."""
        problems: list[Problem] = []
        for (name, kind), (sentence, _) in reversed(self._messages.items()):
            is_unknown = "/" not in name
            if is_unknown or name.startswith(f"{site}/"):
                subject = name.rpartition("/")[2]
                problems.append(Problem(code=kind, sentence=sentence, subject=subject))
        return tuple(problems[:MAX_MESSAGES])


class DeniedOperations:
    """Collects what a router has denied, and excessive writes of a key, and tells them from time to time."""

    def __init__(self) -> None:
        self.total = 0
        """Number of attempts so far."""
        self._attempts: dict[str, Attempts] = defaultdict(Counter)
        """By common name, or name of an unknown connection."""
        self.revoked: dict[str, str] = {}
        """Messages on the denials of former common names in the last interval, by identity."""
        self._written: Counter[tuple[str, str]] = Counter()
        """Number of writes by connection or common name and key."""
        self._slowed: set[tuple[str, str]] = set()
        """Those of `_written` of which some were dropped as too frequent."""
        self._rejected: Counter[str] = Counter()

    def add(self, counts: TraceCounts) -> None:
        """Add the operations that have been counted since the last call."""
        self._rejected += counts.rejected
        self.total += counts.rejected.total()
        for operation, count in counts.denied.items():
            is_late = operation.is_internal and "/@adv" in operation.key
            self._add_attempt(operation, LATE_VERBS if is_late else VERBS, count)
        for operation, count in counts.too_long.items():
            self._add_attempt(operation, TOO_LONG_VERBS, count)

        # After the denials, which decide how writes count that were too frequent
        for operation, count in counts.writes.items():
            self._add_write(operation, count)
        for operation, count in counts.too_frequent.items():
            if operation.message == "Put":
                self._add_too_frequent(operation, count)

    def take_sentences(self, elapsed_s: float, former: Collection[str] = ()) -> dict[str, str]:
        """Return the denials and excessive writes of the last `elapsed_s`, and reset them.

        The denials of `former` common names go to `revoked`: those of an identity's valid certificate differ.

        Returns:
            Messages by identity, `SITE/NAME`, or by an empty name if it is unknown.
        """
        # Denials, of valid and of former certificates apart: their remedies differ
        clauses: dict[str, list[str]] = defaultdict(list)
        revoked: dict[str, Attempts] = defaultdict(Counter)
        for common_name, attempts in self._attempts.items():
            identity = identity_of(common_name)
            if common_name in former:
                revoked[identity] += attempts
            else:
                clauses[identity].append(f"may not {_listed(attempts)}: refused")
        self.revoked = {}
        for identity, attempts in revoked.items():
            name = identity.rpartition("/")[2]
            self.revoked[identity] = REVOCATION.format(
                identity=identity, attempts=_listed(attempts), name=name
            )

        # Floods: of each identity the key that is written most
        for identity, floods in self._floods(elapsed_s).items():
            key, count = floods.most_common(1)[0]
            rate_hz = count / elapsed_s
            clause = f"writes {key} {rate_hz:.0f} times a second, more than anybody needs: end what does"
            clauses[identity].append(clause)

        # One sentence for each identity, and one for all who were not let in
        sentences: dict[str, str] = {}
        for identity, of_identity in sorted(clauses.items()):
            sentences[identity] = f"{identity} {' and '.join(of_identity)}"
        rejections = rejection_summary(self._rejected)
        if rejections:
            sentences[""] = rejections
        self._attempts.clear()
        self._written.clear()
        self._slowed.clear()
        self._rejected.clear()
        return sentences

    def _add_attempt(self, operation: Operation, verbs: Mapping[str, str], count: int) -> None:
        verb = verbs.get(operation.message)
        if verb is None:
            return
        self.total += count
        name = _name(operation)
        if name not in self._attempts and len(self._attempts) >= MAX_NAMES:
            return
        attempts = self._attempts[name]
        attempt = (verb, plain_key(operation.key))
        if attempt in attempts or len(attempts) < MAX_NAMES:
            attempts[attempt] += count

    def _add_write(self, operation: Operation, count: int) -> None:
        written = (_name(operation), plain_key(operation.key))
        if written in self._written or len(self._written) < MAX_WRITTEN:
            self._written[written] += count

    def _add_too_frequent(self, operation: Operation, count: int) -> None:
        """Add writes as such, or as denied where others of their key were."""
        name = _name(operation)
        key = plain_key(operation.key)
        attempts = self._attempts.get(name, Counter())
        if ("write", key) in attempts:
            attempts["write", key] += count
            self.total += count
            return
        self._add_write(operation, count)
        self._slowed.add((name, key))

    def _floods(self, elapsed_s: float) -> dict[str, Counter[str]]:
        """Return the numbers of writes of flooded keys, by identity."""
        floods: dict[str, Counter[str]] = defaultdict(Counter)
        for (name, key), count in self._written.items():
            limit_hz = FLOOD_HZ
            if (name, key) in self._slowed:
                limit_hz = SLOWED * max_rate_hz(key)
            if count > limit_hz * elapsed_s:
                floods[identity_of(name)][key] += count
        return floods


@functools.lru_cache(maxsize=MAX_CACHED)
def plain_key(key: str) -> str:
    """Return a key without the site's namespace and without the suffix of permission tests, printable."""
    operation_key = key.partition("/@")[0]
    has_namespace = operation_key.startswith("pointit/") and operation_key.count("/") > 1
    if has_namespace:
        operation_key = operation_key.split("/", 2)[2]
    shown = one_line(operation_key[:MAX_KEY])
    if len(operation_key) > MAX_KEY:
        shown += "…"
    return shown


def _name(operation: Operation) -> str:
    return operation.common_name or f"connection {operation.connection[:8]}"


def _listed(attempts: Attempts) -> str:
    """Return the denied attempts by verb: `write map (2 times), users/ben/imu and 4 more, ask leds/x`."""
    keys_by_verb: dict[str, list[str]] = defaultdict(list)
    for (verb, key), count in attempts.most_common():
        times = f" ({count} times)" if count > 1 else ""
        keys_by_verb[verb].append(key + times)
    clauses: list[str] = []
    for verb, keys in keys_by_verb.items():
        clauses.append(f"{verb} {first_of(keys, MAX_KEYS)}")
    return ", ".join(clauses)
