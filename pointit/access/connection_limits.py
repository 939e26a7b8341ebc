"""Identities that are cut off at a router, and connections of an identity beyond its maximum. Pure."""

import functools
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from pointit.access.denied_operations import plain_key
from pointit.access.identity_load import BURST, MAX_HZ, Attack, Decision, IdentityLoad, Load
from pointit.access.rights import MAX_CACHED, UNSLOWED, max_rate_hz
from pointit.access.zenoh_trace import INTERNAL, Operation, TraceCounts, identity_of
from pointit.schemas.topics import topic_of

LIMITED = frozenset({"user", "dashboard"})
"""Roles with limits. Identities of other roles serve all people, like a site's services."""
MAX_CONNECTIONS = 32
"""Maximum connections of one identity: 16 processes, such as a person's services and commands, or viewers.
Each has a second one while it tests its rights, all at once when a router opens again."""


@dataclass(frozen=True, kw_only=True)
class LimitedConnection:
    """One session at the router."""

    account: str
    """See `account_of`."""
    session: str
    """Zenoh's name of the session."""
    address: str
    """Source address, `tls/192.168.1.5:40001`."""

    @property
    def can_be_cut(self) -> bool:
        """Return True if it has a socket of its own to close. QUIC connections share the listener's."""
        return not self.address.startswith("quic/")


def account_of(common_name: str, former: Collection[str]) -> str:
    """Return the name by which a load is counted: the identity, `SITE/NAME`, or `""` if it is unknown.

    A former common name is an account of its own, so that who has a revoked or replaced certificate does not
    cut off the identity's valid one.
    """
    if common_name in former:
        return common_name
    return common_name.rpartition("/")[0]


def loads_of(
    counts: TraceCounts, new_connections: Mapping[str, int], former: Collection[str]
) -> dict[str, Load]:
    """Return the load by account. `new_connections` are by common name."""
    loads: dict[str, Load] = defaultdict(Load)

    def load_of(operation: Operation) -> Load:
        return loads[account_of(operation.common_name, former)]

    for operation, count in counts.writes.items():
        load = load_of(operation)
        load.messages += count
        key = _limited_key(operation.key)
        if key:
            load.by_key[key] += count

    # What was denied or dropped has cost the router as much as what it has permitted
    requests = (counts.requests, counts.denied, counts.too_frequent)
    for operations in requests:
        for operation, count in operations.items():
            load = load_of(operation)
            if operation.message in ("Put", "Delete", "Reply"):
                load.messages += count
            elif operation.is_internal:
                load.internal_requests += count
            else:
                load.requests += count
    for common_name, count in counts.long_lines.items():
        loads[account_of(common_name, former)].messages += count
    for common_name, number in new_connections.items():
        loads[account_of(common_name, former)].connections += number

    # Nobody can be cut off for what an unknown identity does
    loads.pop("", None)
    return dict(loads)


class ConnectionLimits:
    """Decides at each step which identities are cut off, and which connections are too many."""

    def __init__(self, max_connections: int = MAX_CONNECTIONS) -> None:
        self._max_connections = max_connections
        self._connections: dict[tuple[str, str], LimitedConnection] = {}
        """Connections by session and address, in order of arrival. Their identity may be known later."""
        self._loads: dict[str, IdentityLoad] = {}
        """By account."""
        self._now_s = 0.0

    def allow_starts(self) -> None:
        """Allow everybody a new start, as the router has opened again."""
        for identity_load in self._loads.values():
            identity_load.allow_start()

    def step(self, loads: Mapping[str, Load], roles: Mapping[str, str], now_s: float) -> list[str]:
        """Update each account's state from its load since the last step. Return the accounts to cut off now.

        `loads` and `roles` are by account.
        """
        self._now_s = now_s
        # A new dictionary, since other threads may read the present one
        self._loads = {account: load for account, load in self._loads.items() if account in roles}
        cut_off: list[str] = []
        for account in {*self._loads, *loads}:
            if roles.get(account) not in LIMITED:
                continue
            identity_load = self._loads.setdefault(account, IdentityLoad(now_s))
            # Without load its excess decreases, so it has a step, too
            decision = identity_load.step(now_s, loads.get(account, Load()))
            if decision is Decision.CUT_OFF:
                cut_off.append(account)
        return cut_off

    def is_held(self, account: str) -> bool:
        """Return True if an account is cut off. May be called in other threads."""
        identity_load = self._loads.get(account)
        return identity_load is not None and identity_load.is_held(self._now_s)

    @property
    def has_held(self) -> bool:
        """Return True if an account is cut off."""
        return any(map(self.is_held, self._loads))

    def excess(
        self, connections: Sequence[LimitedConnection], roles: Mapping[str, str]
    ) -> tuple[list[LimitedConnection], dict[str, str]]:
        """Return the connections that are too many, and a message by identity on these and who is cut off.

        `roles` are by account.
        """
        # The order of arrival stays, whatever the order in which Zenoh lists them.
        present = {(connection.session, connection.address): connection for connection in connections}
        ordered = {**self._connections, **present}
        self._connections = {key: present[key] for key in ordered if key in present}
        by_account: dict[str, list[LimitedConnection]] = defaultdict(list)
        for connection in self._connections.values():
            if roles.get(connection.account) in LIMITED:
                by_account[connection.account].append(connection)

        # The connections of an identity that is cut off are held elsewhere: they get a message only
        to_close: list[LimitedConnection] = []
        messages: dict[str, str] = {}
        for account, identity_load in self._loads.items():
            if not identity_load.is_held(self._now_s):
                continue
            own = by_account.pop(account, [])
            messages[identity_of_account(account)] = self._held_message(account, identity_load, own)

        # The newest are closed, so that a newcomer cannot push out the processes that run
        for account, own in by_account.items():
            newest = own[self._max_connections :]
            if newest:
                to_close += newest
                messages[identity_of_account(account)] = self._too_many_message(account, len(own), newest)
        return [connection for connection in to_close if connection.can_be_cut], messages

    def pop_ended_attacks(self) -> dict[str, str]:
        """Return a sentence on the size of each attack that has ended, once, by account."""
        sentences: dict[str, str] = {}
        for account, identity_load in self._loads.items():
            attack = identity_load.pop_ended_attack(self._now_s)
            if attack is not None:
                label = _label(account)
                sentences[account] = f"the flood of {label} has ended: {_size(attack)}"
        return sentences

    def _held_message(
        self, account: str, identity_load: IdentityLoad, connections: Sequence[LimitedConnection]
    ) -> str:
        attack = identity_load.attack
        key = "" if attack is None else attack.flooded_key
        label = _label(account)
        excess = f"has written or asked {BURST:.0f} messages more than {MAX_HZ:.0f} a second"
        if key:
            limit_hz = max_rate_hz(key)
            excess = f"has written {key} more than {limit_hz:.0f} times a second, by several connections"
        if not all(connection.can_be_cut for connection in connections):
            return f"{label} {excess} and {_stays(account)}"
        hold_s = identity_load.hold_s
        return f"{label} {excess} and is cut off for {hold_s:.0f} s: end the process that does"

    def _too_many_message(self, account: str, count: int, newest: Sequence[LimitedConnection]) -> str:
        label = _label(account)
        if not all(connection.can_be_cut for connection in newest):
            return (
                f"{label} has {count} connections, more than {self._max_connections} "
                f"(--most-connections), and {_stays(account)}"
            )
        return (
            f"{label} has {count} connections, at most {self._max_connections} are let in "
            f"(--most-connections), the newest are cut: find the program that opens them. If "
            f"its certificate is in other hands: `pointit site renew {_name(account)}`"
        )


@functools.lru_cache(maxsize=MAX_CACHED)
def _limited_key(key: str) -> str:
    """Return a key relative to the site if it has a maximum rate, else `""`."""
    plain = plain_key(key)
    topic = topic_of(plain)
    if topic is None or topic in UNSLOWED:
        return ""
    return "" if INTERNAL in key else plain


def full_message(account: str) -> str:
    """Return a sentence on a client that does not read what the router sends it."""
    return (
        f"{_label(account)} does not read what it is sent, and others would wait for it: its connection is "
        "ended; look whether its process is stopped or busy"
    )


def identity_of_account(account: str) -> str:
    """Return the identity, `SITE/NAME`, of an account."""
    is_former = account.count("/") > 1
    return identity_of(account) if is_former else account


def _name(account: str) -> str:
    return identity_of_account(account).rpartition("/")[2]


def _label(account: str) -> str:
    identity = identity_of_account(account)
    if account == identity:
        return identity
    return f"{identity}, by a revoked or replaced certificate,"


def _stays(account: str) -> str:
    return f"cannot be cut (QUIC): revoke it: `pointit site revoke {_name(account)}`"


def _size(attack: Attack) -> str:
    times = "once" if attack.times_cut == 1 else f"{attack.times_cut} times"
    duration_s = attack.ended_s - attack.began_s
    counts = f"{attack.messages:.0f} messages and {attack.connections} new connections"
    return f"{counts} in {duration_s:.0f} s, cut off {times}"
