"""Rejected connections, read from a router's own log, the only place where Zenoh reports them.

On a site with certificates, TLS reports them. On a site with passwords, TLS accepts all clients, and Zenoh's
own handshake reports: first address and claimed name, then, in the same thread, the reason. A claimed name is
no proof, but it helps to find the machine with an old password.
"""

import re
from collections import Counter

FILTER = (
    "zenoh_link_tls=warn,zenoh_link_quic=warn"
    ",zenoh_transport::unicast::establishment::accept=trace,zenoh_transport::unicast::manager=debug"
)
"""Log filter that Zenoh needs for this: a few lines for each connection."""
TARGET = "\x1b[2mzenoh_transport::"
"""Text after the thread in lines of Zenoh's own handshake, none of which contains keys of messages."""
MAX_SHOWN = 3
MAX_REASONS = 1000
"""Limit of distinct reasons at a time, as unknown peers choose their names."""
MAX_NAME = 100
THREAD = r"(?:\S+ )?ThreadId\(\d+\) "
BEGINS = rf"^\S+ +\w+ +{THREAD}"
"""Start of a line: time, level, thread. Zenoh's text follows its target, with words of an unknown peer."""
HANDSHAKE = re.compile(
    rf"^\S+ +WARN +{THREAD}zenoh_link_(?:tls|quic)\S*: (.+?)(?:: verification time .*)?(?:\. Hint: .*)?\.?$"
)
PLAIN_TCP = "received corrupt message of type InvalidContentType"
"""TLS's message if a first message was not TLS."""
WITHOUT = "came without credentials, by plain TCP instead of TLS"
ACCEPTS = rf"{BEGINS}zenoh_transport::unicast::establishment::accept: "
CONNECTION_ATTEMPTS = re.compile(
    rf"{ACCEPTS}Establishment Accept (?:Init|Open)Syn: \S+ => \w+/(\S+):\d+\. Received: "
)
MAX_CLAIMED = 300
"""Maximum bytes of an unknown peer's message to read. A name and its lengths are shorter."""
CLAIMS = re.compile(rf"ext_auth: Some\(.{{0,100}}?slices: \[\[42, ((?:[0-9a-f]{{2}}, ){{1,{MAX_CLAIMED}}})")
"""Length of the rest, length of the name, name, and proof of the password. 42: by name and password."""
PASSWORD = re.compile(rf"{ACCEPTS}UsrPwd extension - Recv \w+\. ([\w ]+)\.")
NO_ZENOH = re.compile(rf"{ACCEPTS}(?:Decode error on|Read error from) link: \S+ => \w+/(\S+?):\d+:")
SILENT = re.compile(rf"{BEGINS}zenoh_transport::unicast::manager: Failed to accept link before deadline")

REASONS = {
    "Invalid password": "a wrong password{of}",
    "Invalid user": "an unknown or former password{of}",
    "Expected extension": "came without a password",
}
"""Reasons by Zenoh's text on a password, with the name if known."""
MORE = 0x80
"""Continuation bit of a byte of a length."""
MAX_LENGTH = 9
"""Maximum number of bytes of a length of 64 bits."""


class RejectedConnections:
    """Counts rejected connections by reason."""

    def __init__(self) -> None:
        self._reasons: Counter[str] = Counter()
        self._connection_attempts: dict[str, tuple[str, str]] = {}
        """By thread: address and claimed name of its last unknown peer."""

    def take(self, line: str, where: str) -> bool:
        """Process a line without colours of the thread `where`. Return True if it reports a rejection."""
        if knock := CONNECTION_ATTEMPTS.match(line):
            self._connection_attempts[where] = knock[1], _claimed(line)
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
            for reason, count in self._reasons.most_common(MAX_SHOWN)
        ]
        more = len(self._reasons) - len(shown)
        self._reasons.clear()
        return f"somebody was not let in: {', '.join(shown)}" + (f" and {more} more" if more else "")

    def _reason(self, line: str, where: str) -> str:
        if found := PASSWORD.match(line):
            address, name = self._connection_attempts.pop(where, ("", ""))
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
    found = CLAIMS.search(line)
    if found is None:
        return ""
    _, rest = _length(bytes.fromhex(found[1].replace(",", "")))
    length, rest = _length(rest)
    user = rest[:length].decode(errors="replace")
    if length <= len(rest):  # otherwise the number is cut off, and the part before a slash another name
        user = user.rpartition("/")[0] or user
    name = re.sub(r"[^\w./-]", "?", user, flags=re.ASCII)
    return name[:MAX_NAME] + ("…" if len(name) > MAX_NAME else "")


def _length(raw: bytes) -> tuple[int, bytes]:
    """Return the number at the start of `raw`, seven bits in each byte, and the remaining bytes."""
    number = at = 0
    for at, byte in enumerate(raw[:MAX_LENGTH]):
        number |= (byte & ~MORE) << (7 * at)
        if not byte & MORE:
            break
    return number, raw[at + 1 :]
