"""Limits of one identity at a router, in connections and messages, and stuck readers. Pure.

Zenoh has no such limits. Its `downsampling` sets a minimum time between two messages of a key, so it would
drop all but the first of what an honest sensor sends after its link stalled.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

LIMITED = frozenset({"user", "dashboard"})
"""Roles with limits. Identities of other roles serve all people, like a site's services."""
MAX_CONNECTIONS = 16
"""Maximum connections of one identity: a person's five services as processes, and some commands."""
MAX_HZ = 5000.0
"""Maximum rate of messages of one identity. An IMU of 200 Hz, with all derived messages, makes 1400."""
PATIENCE = 3
"""Number of consecutive checks, one per second, above `MAX_HZ` before an identity is cut off, or without
reading before a connection is reported. A stalled link delivers at most a lease (3 s) of messages at once."""
HOLD_S = 30.0
"""Time for which a flooding identity stays cut off, s."""
MIN_UNREAD = 16 * 1024
"""Minimum number of waiting bytes of a stuck reader. Fewer may have just been sent."""


@dataclass(frozen=True, kw_only=True)
class Connection:
    """One session at the router."""

    identity: str
    """`SITE/NAME`, or `""` if unknown."""
    session: str
    """Zenoh's name of the session."""
    address: str
    """Source address, `tls/192.168.1.5:40001`."""

    @property
    def can_be_cut(self) -> bool:
        """Return True if it has a socket of its own to close. QUIC connections share the listener's."""
        return not self.address.startswith("quic/")


class Limits:
    """Decides at each check which connections to cut."""

    def __init__(self, most_connections: int = MAX_CONNECTIONS) -> None:
        self._most = most_connections
        self._seen: dict[tuple[str, str], Connection] = {}
        """Connections by session and address, in order of arrival. Their identity may be known later."""
        self._floods: dict[str, int] = {}
        """Number of consecutive checks at which an identity has flooded."""
        self._held: dict[str, float] = {}
        """Identities that are cut off, and the end of that time."""
        self._unread: dict[Connection, tuple[int, int]] = {}
        """Waiting bytes of a connection, and number of consecutive checks with the same value."""

    def excess(
        self,
        connections: Sequence[Connection],
        roles: Mapping[str, str],
        rates_hz: Mapping[str, float],
        now_s: float,
    ) -> tuple[list[Connection], dict[str, str]]:
        """Return the connections to cut, and a message by identity.

        Args:
            connections: current connections.
            roles: roles by identity.
            rates_hz: messages per second since the last check, by identity.
            now_s: time of a monotonic clock.
        """
        there = {(each.session, each.address): each for each in connections}
        self._seen = {key: there[key] for key in (*self._seen, *there) if key in there}
        by_identity: dict[str, list[Connection]] = {}
        for each in self._seen.values():
            if roles.get(each.identity) in LIMITED:
                by_identity.setdefault(each.identity, []).append(each)
        self._hold({name: rate for name, rate in rates_hz.items() if roles.get(name) in LIMITED}, now_s)
        cut: list[Connection] = []
        messages: dict[str, str] = {}
        for name in self._held:
            own = by_identity.pop(name, [])
            cut += own
            messages[name] = (
                f"{name} has written more than {MAX_HZ:.0f} messages a second for {PATIENCE} s and "
                + (
                    f"is cut off for {HOLD_S:.0f} s: end the process that does"
                    if all(each.can_be_cut for each in own)
                    else _stays(name)
                )
            )
        for name, own in by_identity.items():
            if len(own) > self._most:
                newest = own[self._most :]
                cut += newest
                messages[name] = (
                    f"{name} has {len(own)} connections, at most {self._most} are let in "
                    f"(--most-connections), the newest are cut: what opens so many? If its certificate is in "
                    f"other hands: `pointit site renew {_short(name)}`"
                    if all(each.can_be_cut for each in newest)
                    else f"{name} has {len(own)} connections, more than {self._most} "
                    f"(--most-connections), and {_stays(name)}"
                )
        return [each for each in cut if each.can_be_cut], messages

    def stuck(self, unread: Mapping[Connection, int]) -> dict[str, str]:
        """Return a message by identity on readers that accept none of the waiting data.

        Args:
            unread: waiting bytes by connection. For slow readers they change from check to check.
        """
        looks = {
            each: (count, before[1] + 1 if (before := self._unread.get(each, (0, 0)))[0] == count else 1)
            for each, count in unread.items()
            if count >= MIN_UNREAD
        }
        self._unread = looks
        return {
            each.identity: f"{each.identity} reads nothing of what it has asked for (from {each.address}, "
            f"{count / 1000:.0f} kB wait): is it stopped, or stuck? What comes for it is dropped"
            for each, (count, times) in looks.items()
            if times >= PATIENCE and each.identity
        }

    def _hold(self, rates_hz: Mapping[str, float], now_s: float) -> None:
        self._held = {name: held for name, held in self._held.items() if held > now_s}
        flooding = {name for name, rate in rates_hz.items() if rate > MAX_HZ}
        self._floods = {name: self._floods.get(name, 0) + 1 for name in flooding}
        for name, looks in self._floods.items():
            if looks >= PATIENCE:
                self._held[name] = now_s + HOLD_S


def _stays(identity: str) -> str:
    return f"cannot be cut (QUIC): revoke it: `pointit site revoke {_short(identity)}`"


def _short(identity: str) -> str:
    return identity.rpartition("/")[2]
