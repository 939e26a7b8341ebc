"""Who takes more of a router than one identity may, in connections or messages, and who reads nothing; pure.

Zenoh has no such limits. Its `downsampling` asks for a time between two messages of a key, so it would drop
all but the first of what an honest sensor sends after its link stood still.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

LIMITED = frozenset({"user", "dashboard"})
"""Roles that have limits. An identity of the others serves all, as a site's services do."""
MOST_CONNECTIONS = 16
"""Connections of one identity: a person's five services as processes, and some commands beside them."""
MOST_HZ = 5000.0
"""Messages that one identity writes. An IMU of 200 Hz, with all that follows from it, makes 1400."""
PATIENCE = 3
"""Looks, one a second, at which an identity is above `MOST_HZ` before it is cut off, or a connection reads
nothing before that is said. What a stalled link has held up comes at once: at most a lease (3 s) of it."""
MOST_KEYS = 1024
"""Keys that one identity writes within `KEYS_S`: a person's topics, and the lamps that they are shown,
several hundred in a large room. A reader takes four times as many names of lamps (`runtime.names`)."""
KEYS_S = 60.0
"""How long readers keep a place for a name (`runtime.names`)."""
HOLD_S = 30.0
"""How long a flooding identity stays cut off."""
LEAST_UNREAD = 16 * 1024
"""Bytes that wait for a reader which takes none of them; fewer may be what has just been sent."""


@dataclass(frozen=True, kw_only=True)
class Connection:
    """One session at the router."""

    identity: str
    """`SITE/NAME`; empty if nobody knows it."""
    session: str
    """Zenoh's own name of it."""
    address: str
    """From where it comes, `tls/192.168.1.5:40001`."""

    @property
    def can_be_cut(self) -> bool:
        """Return True if there is a socket of its own to shut: connections by QUIC share the listener's."""
        return not self.address.startswith("quic/")


class Limits:
    """Decides at each look which connections are cut."""

    def __init__(self, most_connections: int = MOST_CONNECTIONS) -> None:
        self._most = most_connections
        self._seen: dict[tuple[str, str], Connection] = {}
        """Connections by session and address, in the order of their coming: who it is may be known later."""
        self._floods: dict[str, int] = {}
        """Looks in a row at which an identity has flooded."""
        self._held: dict[str, tuple[float, str]] = {}
        """Identities that are cut off: until when, and for what."""
        self._keys: dict[str, dict[str, float]] = {}
        """By identity: its keys, and when each was written last."""
        self._unread: dict[Connection, tuple[int, int]] = {}
        """Bytes that wait for a connection, and looks in a row at which they were the same."""

    def excess(
        self,
        connections: Sequence[Connection],
        roles: Mapping[str, str],
        rates_hz: Mapping[str, float],
        now_s: float,
        keys: Mapping[str, Collection[str]] | None = None,
    ) -> tuple[list[Connection], dict[str, str]]:
        """Return the connections to be cut, and a sentence by identity.

        Args:
            connections: those that there are.
            roles: by identity.
            rates_hz: messages a second since the last look, by identity.
            now_s: of a monotonic clock.
            keys: written since the last look, by identity.
        """
        there = {(each.session, each.address): each for each in connections}
        self._seen = {key: there[key] for key in (*self._seen, *there) if key in there}
        by_identity: dict[str, list[Connection]] = {}
        for each in self._seen.values():
            if roles.get(each.identity) in LIMITED:
                by_identity.setdefault(each.identity, []).append(each)
        self._hold({name: rate for name, rate in rates_hz.items() if roles.get(name) in LIMITED}, now_s)
        written = {name: own for name, own in (keys or {}).items() if roles.get(name) in LIMITED}
        self._count_keys(written, now_s)
        cut: list[Connection] = []
        told: dict[str, str] = {}
        for name, (_, what) in self._held.items():
            own = by_identity.pop(name, [])
            cut += own
            told[name] = f"{name} has written {what} and " + (
                f"is cut off for {HOLD_S:.0f} s: end what does"
                if all(each.can_be_cut for each in own)
                else _stays(name)
            )
        for name, own in by_identity.items():
            if len(own) > self._most:
                newest = own[self._most :]
                cut += newest
                told[name] = (
                    f"{name} has {len(own)} connections, at most {self._most} are let in "
                    f"(--most-connections), the newest are cut: what opens so many? If its certificate is in "
                    f"other hands: `pointit site renew {_short(name)}`"
                    if all(each.can_be_cut for each in newest)
                    else f"{name} has {len(own)} connections, more than {self._most} "
                    f"(--most-connections), and {_stays(name)}"
                )
        return [each for each in cut if each.can_be_cut], told

    def stuck(self, unread: Mapping[Connection, int]) -> dict[str, str]:
        """Return a sentence by identity on readers that take nothing of what waits for them.

        Args:
            unread: bytes that wait, by connection. Of who reads slowly they change from look to look.
        """
        looks = {
            each: (count, before[1] + 1 if (before := self._unread.get(each, (0, 0)))[0] == count else 1)
            for each, count in unread.items()
            if count >= LEAST_UNREAD
        }
        self._unread = looks
        return {
            each.identity: f"{each.identity} reads nothing of what it has asked for (from {each.address}, "
            f"{count / 1000:.0f} kB wait): is it stopped, or stuck? What comes for it is dropped"
            for each, (count, times) in looks.items()
            if times >= PATIENCE and each.identity
        }

    def _hold(self, rates_hz: Mapping[str, float], now_s: float) -> None:
        self._held = {name: held for name, held in self._held.items() if held[0] > now_s}
        flooding = {name for name, rate in rates_hz.items() if rate > MOST_HZ}
        self._floods = {name: self._floods.get(name, 0) + 1 for name in flooding}
        for name, looks in self._floods.items():
            if looks >= PATIENCE:
                what = f"more than {MOST_HZ:.0f} messages a second for {PATIENCE} s"
                self._held[name] = (now_s + HOLD_S, what)

    def _count_keys(self, keys: Mapping[str, Collection[str]], now_s: float) -> None:
        for name in {*self._keys, *keys}:
            last_s = {key: at for key, at in self._keys.get(name, {}).items() if now_s - at <= KEYS_S}
            last_s |= dict.fromkeys(sorted(keys.get(name, ()))[: MOST_KEYS + 1], now_s)
            if len(last_s) > MOST_KEYS:
                what = f"more than {MOST_KEYS} keys within {KEYS_S:.0f} s, such as {min(last_s)},"
                self._held[name] = (now_s + HOLD_S, what)
                last_s.clear()
            self._keys[name] = last_s
        self._keys = {name: last_s for name, last_s in self._keys.items() if last_s}


def _stays(identity: str) -> str:
    return f"cannot be cut (QUIC): revoke it: `pointit site revoke {_short(identity)}`"


def _short(identity: str) -> str:
    return identity.rpartition("/")[2]
