"""Rejected connections, read from a router's log, which alone has them. Its text: see `zenoh_trace`.

On a site with certificates, TLS reports them. On a site with passwords, TLS accepts all clients, and Zenoh's
own handshake reports: first the address, then, in the same thread, the reason.
"""

import re
from collections import Counter

from pointit.schemas.text import first_of

REJECTION_FILTER = (
    "zenoh_link_tls=warn,zenoh_link_quic=warn"
    ",zenoh_transport::unicast::establishment::accept=trace,zenoh_transport::unicast::manager=debug"
)
"""Log filter with which Zenoh tells who is rejected: a few lines for each connection."""
HANDSHAKE_TARGET = "\x1b[2mzenoh_transport::"
"""Text after the thread in lines of Zenoh's own handshake, none of which contains keys of messages."""
MAX_SHOWN = 3
MAX_REASONS = 1000
"""Limit of distinct reasons at a time, as unknown peers choose their names."""
THREAD_PATTERN = r"(?:\S+ )?ThreadId\(\d+\) "
BEGINS = rf"^\S+ +\w+ +{THREAD_PATTERN}"
"""Start of a line: time, level, thread. Zenoh's text follows its target, with words of an unknown peer."""
HANDSHAKE = re.compile(
    rf"^\S+ +WARN +{THREAD_PATTERN}zenoh_link_(?:tls|quic)\S*: "
    r"(.+?)(?:: verification time .*)?(?:\. Hint: .*)?\.?$"
)
PLAIN_TCP = "received corrupt message of type InvalidContentType"
"""TLS's message if a first message was not TLS."""
WITHOUT_TLS = "came without credentials, by plain TCP instead of TLS"
ACCEPTS = rf"{BEGINS}zenoh_transport::unicast::establishment::accept: "
CONNECTION_ATTEMPT = re.compile(
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


class RejectedConnections:
    """Counts rejected connections by reason."""

    def __init__(self) -> None:
        self._reasons: Counter[str] = Counter()
        self._connection_attempts: dict[str, str] = {}
        """By thread: address of its last unknown peer."""

    def take(self, line: str, thread: str) -> bool:
        """Process a line without colours of `thread`. Return True if it reports a rejection."""
        attempt = CONNECTION_ATTEMPT.match(line)
        if attempt is not None:
            self._connection_attempts[thread] = attempt[1]
            return False
        reason = self._reason(line, thread)
        if not reason:
            return False
        # Unknown peers choose texts in reasons, so their number is limited
        if reason in self._reasons or len(self._reasons) < MAX_REASONS:
            self._reasons[reason] += 1
        return True

    def pop(self) -> Counter[str]:
        """Return and reset the number of rejections by reason."""
        reasons = self._reasons
        self._reasons = Counter()
        return reasons

    def _reason(self, line: str, thread: str) -> str:
        # By password: Zenoh has reported the address before, in the same thread
        password = PASSWORD.match(line)
        if password is not None:
            address = self._connection_attempts.pop(thread, "")
            reason = REASONS.get(password[1], password[1])
            return f"{reason} from {address}" if address else reason

        # By TLS: its clients may speak anything, or nothing
        no_zenoh = NO_ZENOH.match(line)
        if no_zenoh is not None:
            return f"came by TLS and spoke no Zenoh from {no_zenoh[1]}"
        if SILENT.match(line):
            return "came by TLS and said nothing"

        # By certificate
        handshake = HANDSHAKE.match(line)
        if handshake is None:
            return ""
        if handshake[1].startswith(PLAIN_TCP):
            return WITHOUT_TLS
        return handshake[1]


def rejection_summary(reasons: Counter[str]) -> str:
    """Return one sentence on rejections by reason, `""` if there were none."""
    if not reasons:
        return ""
    shown: list[str] = []
    for reason, count in reasons.most_common():
        times = f" ({count} times)" if count > 1 else ""
        shown.append(reason + times)
    return f"a connection was refused: {first_of(shown, MAX_SHOWN)}"
