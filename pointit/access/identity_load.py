"""Load of one identity at a router, and what follows from it. Pure: time and counts in, a decision out.

The load is one sum over all connections, keys and kinds of operations of an identity, permitted or denied.
It is a leaky bucket: `MAX_HZ` leak, and `BURST` is the most that it holds. Nothing but time empties it, so
connections that are closed and opened again do not.

Who sends `MAX_HZ` at most is never cut off: a link that stalled for a lease (3 s) delivers 7500 messages at
once. Who sends three times as much is cut off within 5 s, and in 2 s if those are writes.
"""

from collections import Counter
from dataclasses import dataclass, field
from enum import Enum

from pointit.access.rights import max_rate_hz

MAX_HZ = 2500.0
"""Rate of messages of one identity that is allowed for good. An IMU of 200 Hz, with all derived messages,
makes 1400. A question or a declaration counts as `REQUEST_COST` of them, below `@` as `INTERNAL_COST`."""
REQUEST_COST = 25
"""Messages whose load is that of a question or a declaration, which goes to all clients."""
INTERNAL_COST = 5
"""The same of those below `@`, which are of late subscribers and of tests of rights: many at a start."""
CONNECTION_COST = 300
"""Messages whose load is that of a new connection: checking certificates takes a router 4 to 8 ms."""
BURST = 10_000.0
"""Number of messages beyond `MAX_HZ` at which an identity is cut off. A stalled link delivers at most a
lease (3 s) of messages at once."""

START_LOAD = 56_000.0
"""Load of declarations and new connections that a start may have in addition: two of each of 16 viewers of
all topics, who declare 1600 each time."""
START_S = 2.0
"""Time for which a start may last, from when a second's worth of messages has come at once, s."""
START_PERIOD_S = 30.0
"""Time from one start to the next, s. A router that opens again begins a new one."""

KEY_BURST_S = 4.0
"""Time in whose messages, at its maximum rate, a key may be ahead of that rate over all connections, s. A
router holds each connection to the rate, so only several connections can be ahead for longer than a lease."""

HOLD_S = 30.0
"""Time for which an identity is cut off the first time, s. It doubles each time that it floods again."""
MAX_HOLD_S = 960.0
QUIET_S = 30.0
"""Time without excess after which an identity that was let in again has ended its attack, s."""
FORGIVEN_S = 600.0
"""Time without excess after which the next time is the first one again, s."""


class Decision(Enum):
    """Decision of a router about the connections of an identity."""

    ALLOW = "allow"
    CUT_OFF = "cut off"
    """Close its connections, and name it."""
    HOLD = "hold"
    """It stays cut off: its new connections are closed."""


@dataclass(kw_only=True)
class Load:
    """Counts of the operations of one identity between two steps, whether permitted or denied."""

    messages: float = 0.0
    """Number of writes, with a further one for each 100 characters of a key of 1000 or more."""
    requests: float = 0.0
    """Number of questions and declarations."""
    internal_requests: float = 0.0
    """Number of those below `@`."""
    connections: int = 0
    """Number of new connections."""
    by_key: Counter[str] = field(default_factory=Counter[str])
    """Number of writes that have passed the maximum rate of their key, by key relative to the site. Part of
    `messages`. Keys without such a rate are left out."""

    @property
    def started(self) -> float:
        """Return the load of connections, questions and declarations, as at a start, in messages."""
        questions = self.requests * REQUEST_COST + self.internal_requests * INTERNAL_COST
        return questions + self.connections * CONNECTION_COST


@dataclass(kw_only=True)
class Attack:
    """Size of an attack: what an identity has sent from its first excess on."""

    began_s: float
    ended_s: float
    """Time of the last operation or attempt to connect."""
    messages: float = 0.0
    """Load, in messages."""
    connections: int = 0
    """Number of connections that were opened."""
    times_cut: int = 0
    flooded_key: str = ""
    """Key whose rate was exceeded. `""` if the load was."""

    def add(self, messages: float, connections: int, now_s: float) -> None:
        """Add what came until now."""
        self.messages += messages
        self.connections += connections
        self.ended_s = now_s


class IdentityLoad:
    """Decides on one identity of a secured site by its load: allow it, or cut it off for a while.

    A person's wrist and services need some hundred messages a second. Who sends many times more takes the
    router from all others, on purpose or by a mistake in a loop. The excess over `MAX_HZ` is summed up and
    forgotten at that rate, so a short burst passes and a flood does not, and starts are counted apart, since
    a run that joins declares everything at once.

        load = IdentityLoad(now_s)
        decision = load.step(now_s, Load(messages=40_000, ...))     # each second, from the router's log
        if decision is Decision.CUT_OFF:
            ...                                                     # for `load.hold_s`, longer each time

    It knows no connections and no keys of certificates: who an identity is, is known before.
    """

    def __init__(self, now_s: float) -> None:
        """Begin with nothing used. `now_s`: on any monotonic clock, like all times here."""
        self._step_s = now_s
        self._excess = 0.0
        """Number of messages beyond `MAX_HZ`."""
        self._wave = Attack(began_s=now_s, ended_s=now_s)
        """Operations since the excess was 0, which an attack begins with."""
        self._key_excess: dict[str, float] = {}
        """The same of each key beyond its rate."""
        self._next_start_s = now_s
        self._start_ends_s = now_s
        self._start_left = 0.0
        self._held_until_s = now_s
        self._hold_s = 0.0
        """Duration of the last time that it was cut off, 0 if there was none."""
        self.attack: Attack | None = None
        """Present attack, which goes on until `pop_ended_attack` returns it."""

    @property
    def hold_s(self) -> float:
        """Return the duration for which it is or was cut off, s. 0 if it never was."""
        return self._hold_s

    def is_held(self, now_s: float) -> bool:
        """Return True if it is cut off at this time."""
        return now_s < self._held_until_s

    def allow_start(self) -> None:
        """Allow for a new start from now on, as the router has opened again, and all return at once."""
        self._next_start_s = self._step_s
        self._start_ends_s = self._step_s

    def step(self, now_s: float, load: Load) -> Decision:
        """Update the state from the operations since the last step. Return the decision."""
        elapsed_s = max(0.0, now_s - self._step_s)
        self._step_s = max(now_s, self._step_s)
        size = load.messages + load.started

        # What comes while it is cut off was on its way, or is denied at the door. Only its size counts.
        if self.is_held(now_s):
            if self.attack is not None and size:
                self.attack.add(size, load.connections, now_s)
            return Decision.HOLD

        self._excess = max(0.0, self._excess - MAX_HZ * elapsed_s)
        if not self._excess:
            self._wave = Attack(began_s=now_s, ended_s=now_s)
        self._wave.add(size, load.connections, now_s)
        self._add_to_keys(elapsed_s, load.by_key)
        self._excess += load.messages + self._beyond_start(load.started, now_s)
        flooded_key = self._flooded_key()
        if self._excess < BURST and not flooded_key:
            return Decision.ALLOW
        self._cut_off(now_s, flooded_key)
        return Decision.CUT_OFF

    def pop_ended_attack(self, now_s: float) -> Attack | None:
        """Return the size of an attack that has ended, once. None if there is none."""
        attack = self.attack
        if attack is None or now_s < self._held_until_s + QUIET_S:
            return None
        self.attack = None
        return attack

    def _beyond_start(self, started: float, now_s: float) -> float:
        """Return the part of the load of a start that exceeds the allowance for one."""
        is_start = self._excess + started > MAX_HZ
        if is_start and now_s >= self._next_start_s:
            self._next_start_s = now_s + START_PERIOD_S
            self._start_ends_s = now_s + START_S
            self._start_left = START_LOAD
        if now_s > self._start_ends_s:
            return started
        allowed = min(started, self._start_left)
        self._start_left -= allowed
        return started - allowed

    def _add_to_keys(self, elapsed_s: float, by_key: Counter[str]) -> None:
        excess_by_key: dict[str, float] = {}
        for key in {*self._key_excess, *by_key}:
            drained = max_rate_hz(key) * elapsed_s
            previous = max(0.0, self._key_excess.get(key, 0.0) - drained)
            excess = previous + by_key[key]
            if excess > 0.0:
                excess_by_key[key] = excess
        self._key_excess = excess_by_key

    def _flooded_key(self) -> str:
        for key, excess in self._key_excess.items():
            if excess >= KEY_BURST_S * max_rate_hz(key):
                return key
        return ""

    def _cut_off(self, now_s: float, flooded_key: str) -> None:
        is_first = self._hold_s == 0.0 or now_s >= self._held_until_s + FORGIVEN_S
        self._hold_s = HOLD_S if is_first else min(2.0 * self._hold_s, MAX_HOLD_S)
        self._held_until_s = now_s + self._hold_s
        if self.attack is None:
            self.attack = self._wave
        else:
            self.attack.add(self._wave.messages, self._wave.connections, now_s)
        self.attack.times_cut += 1
        self.attack.flooded_key = flooded_key
        # Everything that it did is paid for by the time for which it is cut off.
        self._excess = 0.0
        self._key_excess.clear()
