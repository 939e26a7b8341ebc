"""Who was not let in at a router's door, read from its own log: the only place where Zenoh tells of it.

Where a site goes by certificates, that is told by TLS. Where it goes by passwords, TLS lets everybody in, and
Zenoh's own handshake tells: first who came from where and says to be whom, then, in the same thread, why not.
A name that somebody says to have is no proof; it helps to find the machine that has an old password.
"""

import re
from collections import Counter

FILTER = (
    "zenoh_link_tls=warn,zenoh_link_quic=warn"
    ",zenoh_transport::unicast::establishment::accept=trace,zenoh_transport::unicast::manager=debug"
)
"""What of its log Zenoh has to write for this: a few lines for each connection."""
TARGET = "\x1b[2mzenoh_transport::"
"""With what lines of Zenoh's own handshake go on after the thread; keys of messages are in none of them."""

MOST_SHOWN = 3
MOST_REASONS = 1000
"""That are told apart at a time: who knocks chooses names."""
LONGEST_NAME = 100

THREAD = r"(?:\S+ )?ThreadId\(\d+\) "
BEGINS = rf"^\S+ +\w+ +{THREAD}"
"""Of a line: time, level, thread. What Zenoh says follows its target: there a stranger's words may stand."""
HANDSHAKE = re.compile(
    rf"^\S+ +WARN +{THREAD}zenoh_link_(?:tls|quic)\S*: (.+?)(?:: verification time .*)?(?:\. Hint: .*)?\.?$"
)
PLAIN_TCP = "received corrupt message of type InvalidContentType"
"""Of TLS's first message: it was none."""
WITHOUT = "came without credentials, by plain TCP instead of TLS"

ACCEPTS = rf"{BEGINS}zenoh_transport::unicast::establishment::accept: "
KNOCKS = re.compile(rf"{ACCEPTS}Establishment Accept (?:Init|Open)Syn: \S+ => \w+/(\S+):\d+\. Received: ")
MOST_CLAIMED = 300
"""Bytes that are looked at of what a stranger says; a name and its lengths are shorter."""
CLAIMS = re.compile(rf"ext_auth: Some\(.{{0,100}}?slices: \[\[42, ((?:[0-9a-f]{{2}}, ){{1,{MOST_CLAIMED}}})")
"""Length of the rest, length of the name, name, and the proof of the password; 42: by name and password."""
PASSWORD = re.compile(rf"{ACCEPTS}UsrPwd extension - Recv \w+\. ([\w ]+)\.")
NO_ZENOH = re.compile(rf"{ACCEPTS}(?:Decode error on|Read error from) link: \S+ => \w+/(\S+?):\d+:")
SILENT = re.compile(rf"{BEGINS}zenoh_transport::unicast::manager: Failed to accept link before deadline")

REASONS = {
    "Invalid password": "a wrong password{of}",
    "Invalid user": "an unknown or former password{of}",
    "Expected extension": "came without a password",
}
"""By what Zenoh says of a password; of whom, where that is known."""
MORE = 0x80
"""Of a byte of a length: the next one belongs to it."""
LONGEST_LENGTH = 9
"""Bytes of a length, of 64 bits at most."""


class RejectedConnections:
    """Counts who was not let in, by reason."""

    def __init__(self) -> None:
        self._reasons: Counter[str] = Counter()
        self._knocks: dict[str, tuple[str, str]] = {}
        """By thread: from where its last newcomer came, and who they say they are."""

    def take(self, line: str, where: str) -> bool:
        """Take a line of the log, without colours, of the thread `where`. Return True if it tells of one."""
        if knock := KNOCKS.match(line):
            self._knocks[where] = knock[1], _claimed(line)
            return False
        reason = self._reason(line, where)
        if reason and (reason in self._reasons or len(self._reasons) < MOST_REASONS):
            self._reasons[reason] += 1
        return bool(reason)

    def pop_summary(self) -> str:
        """Return who was not let in since the last time, and forget it; empty when nobody was."""
        if not self._reasons:
            return ""
        shown = [
            reason + (f" ({count} times)" if count > 1 else "")
            for reason, count in self._reasons.most_common(MOST_SHOWN)
        ]
        more = len(self._reasons) - len(shown)
        self._reasons.clear()
        return f"somebody was not let in: {', '.join(shown)}" + (f" and {more} more" if more else "")

    def _reason(self, line: str, where: str) -> str:
        if found := PASSWORD.match(line):
            address, name = self._knocks.pop(where, ("", ""))
            reason = REASONS.get(found[1], found[1]).format(of=f" for {name}" if name else "")
            return f"{reason} from {address}" if address else reason
        if found := NO_ZENOH.match(line):
            return f"came by TLS and spoke no Zenoh from {found[1]}"
        if SILENT.match(line):
            return "came by TLS and said nothing"
        if found := HANDSHAKE.match(line):
            return WITHOUT if found[1].startswith(PLAIN_TCP) else found[1]
        return ""


def _claimed(line: str) -> str:
    """Return who a newcomer says to be, without the number of the password; empty when they do not say."""
    found = CLAIMS.search(line)
    if found is None:
        return ""
    _, rest = _length(bytes.fromhex(found[1].replace(",", "")))
    length, rest = _length(rest)
    user = rest[:length].decode(errors="replace")
    if length <= len(rest):  # else the number is cut off, and what is before a slash is somebody else
        user = user.rpartition("/")[0] or user
    name = re.sub(r"[^\w./-]", "?", user, flags=re.ASCII)
    return name[:LONGEST_NAME] + ("…" if len(name) > LONGEST_NAME else "")


def _length(raw: bytes) -> tuple[int, bytes]:
    """Return the number that `raw` begins with, seven bits in each byte, and what comes after it."""
    number = at = 0
    for at, byte in enumerate(raw[:LONGEST_LENGTH]):
        number |= (byte & ~MORE) << (7 * at)
        if not byte & MORE:
            break
    return number, raw[at + 1 :]
