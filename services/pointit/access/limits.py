"""Limits of one identity at a router, in connections and messages, and stuck readers. Pure.

Zenoh limits only the rate of each key of a connection (`max_rate_hz`), at once; `pointit router` the messages
of an identity, over all its keys and connections, within seconds.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pointit.schemas.topics import Delivery, topic_of

LIMITED = frozenset({"user", "dashboard"})
"""Roles with limits. Identities of other roles serve all people, like a site's services."""
MAX_CONNECTIONS = 16
"""Maximum connections of one identity: a person's five services as processes, and some commands."""
LATEST_HZ = 500.0
"""Maximum rate of a key of which only the newest message counts. Wrists send 200 Hz at most."""
MAX_RATE_HZ = 100.0
"""Maximum rate of a key with states or events, of which each has to be handled."""
MAX_HZ = 2500.0
"""Rate of messages of one identity that is allowed for good. An IMU of 200 Hz, with all derived messages,
makes 1400."""
BURST = 10_000.0
"""Number of messages beyond `MAX_HZ` at which an identity is cut off. A stalled link delivers at most a
lease (3 s) of messages at once."""
TIMEOUT = 3
"""Number of consecutive checks, one per second, without reading before a connection is reported."""
HOLD_S = 30.0
"""Time for which a flooding identity stays cut off, s."""
MIN_UNREAD = 16 * 1024
"""Minimum number of waiting bytes of a stuck reader. Fewer may have just been sent."""


@dataclass(frozen=True, kw_only=True)
class LimitedConnection:
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


def max_rate_hz(key: str) -> float:
    """Return the maximum rate of a key, relative to the site, on each connection of a person."""
    topic = topic_of(key)
    return MAX_RATE_HZ if topic is not None and topic.delivery is not Delivery.LATEST else LATEST_HZ


class ConnectionLimits:
    """Decides at each check which connections to cut."""

    def __init__(self, max_connections: int = MAX_CONNECTIONS) -> None:
        self._max_connections = max_connections
        self._seen: dict[tuple[str, str], LimitedConnection] = {}
        """Connections by session and address, in order of arrival. Their identity may be known later."""
        self._excess: dict[str, float] = {}
        """Number of messages beyond `MAX_HZ` by identity, which shrinks again at lower rates."""
        self.held: dict[str, float] = {}
        """Identities that are cut off, and the end of that time."""
        self._unread: dict[LimitedConnection, tuple[int, int]] = {}
        """Waiting bytes of a connection, and number of consecutive checks with the same value."""

    def excess(
        self,
        connections: Sequence[LimitedConnection],
        roles: Mapping[str, str],
        rates_hz: Mapping[str, float],
        now_s: float,
    ) -> tuple[list[LimitedConnection], dict[str, str]]:
        """Return the connections to cut, and a message by identity; roles and rates are by identity, too."""
        there = {(each.session, each.address): each for each in connections}
        self._seen = {key: there[key] for key in (*self._seen, *there) if key in there}
        by_identity: dict[str, list[LimitedConnection]] = {}
        for each in self._seen.values():
            if roles.get(each.identity) in LIMITED:
                by_identity.setdefault(each.identity, []).append(each)
        self._hold({name: rate for name, rate in rates_hz.items() if roles.get(name) in LIMITED}, now_s)
        closed_connections: list[LimitedConnection] = []
        messages: dict[str, str] = {}
        for name in self.held:
            own = by_identity.pop(name, [])
            closed_connections += own
            messages[name] = (
                f"{name} has written {BURST:.0f} messages more than {MAX_HZ:.0f} messages a second and "
                + (
                    f"is cut off for {HOLD_S:.0f} s: end the process that does"
                    if all(each.can_be_cut for each in own)
                    else _stays(name)
                )
            )
        for name, own in by_identity.items():
            if len(own) > self._max_connections:
                newest = own[self._max_connections :]
                closed_connections += newest
                messages[name] = (
                    f"{name} has {len(own)} connections, at most {self._max_connections} are let in "
                    f"(--most-connections), the newest are cut: find the program that opens them. If "
                    f"its certificate is in other hands: `pointit site renew {_short(name)}`"
                    if all(each.can_be_cut for each in newest)
                    else f"{name} has {len(own)} connections, more than {self._max_connections} "
                    f"(--most-connections), and {_stays(name)}"
                )
        return [each for each in closed_connections if each.can_be_cut], messages

    def stuck(self, unread: Mapping[LimitedConnection, int]) -> dict[str, str]:
        """Return a message by identity on readers that accept none of the waiting data.

        `unread`: waiting bytes by connection. For slow readers they change from check to check.
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
            if times >= TIMEOUT and each.identity
        }

    def _hold(self, rates_hz: Mapping[str, float], now_s: float) -> None:
        self.held = {name: held for name, held in self.held.items() if held > now_s}
        for name in {*self._excess, *rates_hz}:
            messages = self._excess.get(name, 0.0) + rates_hz.get(name, 0.0) - MAX_HZ
            self._excess[name] = max(0.0, min(BURST, messages))
            if messages >= BURST:
                self.held[name] = now_s + HOLD_S
        self._excess = {name: messages for name, messages in self._excess.items() if messages}


def _stays(identity: str) -> str:
    return f"cannot be cut (QUIC): revoke it: `pointit site revoke {_short(identity)}`"


def _short(identity: str) -> str:
    return identity.rpartition("/")[2]
