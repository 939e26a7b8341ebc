"""Who was refused what, read from a router's own log: the only place where Zenoh tells of it.

At level TRACE its access control writes a line for every decision. Those that it works out beforehand for a
key it hears of (`caching permissions`, then one line for each kind of message) are nobody's attempts.
"""

import re
from collections import Counter, defaultdict

KINDS = 9
"""Kinds of messages, each a line after `caching permissions`."""
MOST_KEYS = 3
MOST_NAMES = 1000
"""Connections and identities remembered; somebody may come again and again."""

COLOR = re.compile(r"\x1b\[[0-9;]*m")
THREAD = re.compile(r"ThreadId\((\d+)\)")
KNOWN = re.compile(r"(\w+) on \S*?(?:CertCommonName|Username)\(([^)]+)\)")
DENIED = re.compile(r"(\w+)(?: on \S+)? is unauthorized to (.+?) \(ingress\) on (\S+)")
HANDSHAKE = re.compile(r"WARN .*zenoh_link_(?:tls|quic)\S*: (.+?)(?:\. Hint: .*)?\.?$")

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

FILTER = "off,zenoh::net::routing::interceptor::access_control=trace,zenoh_link_tls=warn,zenoh_link_quic=warn"
"""What of its log Zenoh has to write for this."""


class Refused:
    """Counts attempts that a router has refused."""

    def __init__(self) -> None:
        self._attempts: dict[str, Counter[tuple[str, str]]] = defaultdict(Counter)
        self._handshakes: Counter[str] = Counter()
        self._names: dict[str, str] = {}
        """Identity by connection."""
        self._working_out: dict[str, int] = {}
        """By thread: lines still to come that are no attempts."""

    def take(self, line: str) -> None:
        """Take one line of the log."""
        if "Using cached" in line and "unauthorized" not in line:
            return
        line = COLOR.sub("", line)
        if "access_control" not in line:
            if found := HANDSHAKE.search(line):
                self._handshakes[found[1]] += 1
            return
        thread = THREAD.search(line)
        where = thread[1] if thread else ""
        if "caching permissions" in line:
            self._working_out[where] = KINDS
            return
        if (known := KNOWN.search(line)) and len(self._names) < MOST_NAMES:
            self._names[known[1]] = known[2]
        if "Using cached" not in line and self._working_out.get(where, 0):
            self._working_out[where] -= 1
            return
        if found := DENIED.search(line):
            self._count(*found.groups())

    def take_sentences(self) -> list[str]:
        """Return what has been refused since the last time, a sentence for each identity, and forget it."""
        sentences: list[str] = []
        for name, attempts in sorted(self._attempts.items()):
            told = [
                f"{verb} {key}" + (f" ({count} times)" if count > 1 else "")
                for (verb, key), count in attempts.most_common(MOST_KEYS)
            ]
            more = f" and {len(attempts) - MOST_KEYS} more" if len(attempts) > MOST_KEYS else ""
            sentences.append(f"{name} may not {', '.join(told)}{more}: refused")
        for reason, count in self._handshakes.most_common(MOST_KEYS):
            times = f" ({count} times)" if count > 1 else ""
            sentences.append(f"somebody was not let in{times}: {reason}")
        self._attempts.clear()
        self._handshakes.clear()
        return sentences

    def _count(self, connection: str, message: str, key: str) -> None:
        verb = VERBS.get(message.removeprefix("Declare/Undeclare ").removeprefix("Declare "))
        if (
            verb is None
            or "/@adv" in key
            or (len(self._attempts) >= MOST_NAMES and connection not in self._names)
        ):
            return  # what goes with a key that is counted itself
        name = self._names.get(connection, f"connection {connection[:8]}")
        who = name.rpartition("/")[0] or name
        attempts, attempt = self._attempts[who], (verb, _without(key))
        if attempt in attempts or len(attempts) < MOST_NAMES:
            attempts[attempt] += 1


def _without(key: str) -> str:
    """Return a key without the site's namespace and without what an identity tests its rights by."""
    plain = key.partition("/@")[0]
    return plain.split("/", 2)[2] if plain.startswith("pointit/") and plain.count("/") > 1 else plain
