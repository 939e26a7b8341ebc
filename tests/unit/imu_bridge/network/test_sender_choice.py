"""Choice of one sender of datagrams: any datagrams against the rules, and examples."""

from dataclasses import dataclass, field

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pointit.services.imu_bridge.network.datagram_source import SenderChoice
from pointit.services.imu_bridge.network.udp_server import Address

REPLACED = 10.0
"""Silence after which another machine replaces the sender, s."""
RESTARTED = 3.0
"""Silence after which another port of its machine does, s."""
NAMED = 5.0
"""Time for which another sender is named, s."""
MAX_NAMED = 8
ROAMING = 8
"""Number of other ports during a silence that show a machine with a new port for each datagram."""

Datagram = tuple[float, Address]
"""Pause before it, s, and its sender."""

pauses_s = st.sampled_from([0.0, 0.5, 2.9, 3.0, 3.1, 4.9, 5.0, 9.9, 10.0, 10.1])
addresses = st.tuples(st.sampled_from(["10.0.0.1", "10.0.0.2", "10.0.0.3"]), st.integers(5000, 5009))
datagrams = st.lists(st.tuples(pauses_s, addresses), max_size=60)
FIRST = ("10.0.0.1", 5000)
OTHER_PORTS = [(0.1, ("10.0.0.1", 5000 + number)) for number in range(1, 10)]


@dataclass
class Reading:
    """The rules, with all datagrams in memory."""

    wanted: str
    excludes_rivals: bool
    used: Address | None = None
    heard_s: float = 0.0
    """Time at which the sender in use was heard last, s."""
    others_s: dict[Address, float] = field(default_factory=dict)
    ports: set[int] = field(default_factory=set)
    rivals: set[Address] = field(default_factory=set)
    roaming: str = ""

    def identity(self, address: Address) -> Address:
        return (address[0], 0) if address[0] == self.roaming else address

    def takes(self, address: Address, now_s: float) -> bool:
        """Return True if a datagram is used."""
        host, port = address
        is_same_machine = self.used is not None and host == self.used[0]
        is_rival = not self.wanted and (address in self.rivals or (host, 0) in self.rivals)
        if self.used is None or self.identity(address) == self.identity(self.used):
            is_free = True
        else:
            is_free = now_s - self.heard_s > (RESTARTED if is_same_machine else REPLACED)
        if is_free and not is_rival and self.wanted in ("", host):
            return True
        if is_same_machine:
            self.ports.add(port)
            if len(self.ports) == ROAMING:
                self.roaming = host
                self.others_s = {}
                return True
        if address in self.others_s or len(self.others_s) < MAX_NAMED:
            self.others_s[address] = now_s
        return False

    def use(self, address: Address, now_s: float) -> None:
        if self.excludes_rivals and address == self.used:
            for host, port in self.others_s:
                self.rivals.add((host, port if host == address[0] else 0))
        self.used = address
        self.heard_s = now_s
        self.ports = set()
        self.others_s.pop(address, None)

    def named(self, now_s: float) -> list[str]:
        self.others_s = {other: at_s for other, at_s in self.others_s.items() if now_s - at_s < NAMED}
        labels: set[str] = set()
        for host, port in self.others_s:
            is_beside = self.used is not None and host == self.used[0] and host != self.roaming
            labels.add(f"{host}:{port}" if is_beside else host)
        return sorted(labels)


@settings(max_examples=300)
@given(st.sampled_from(["", "10.0.0.2"]), st.booleans(), datagrams)
@example("", True, [(0.0, FIRST), *OTHER_PORTS, (0.1, ("10.0.0.2", 5000)), (0.1, FIRST)])  # a roaming machine
@example("", True, [(0.0, FIRST), *OTHER_PORTS[:7], (0.1, FIRST), *OTHER_PORTS[:3]])  # heard in between
@example(
    "", True, [(0.0, FIRST), (1.0, OTHER_PORTS[0][1]), (1.0, FIRST), (3.1, OTHER_PORTS[0][1])]
)  # a rival
@example("", True, [(0.0, FIRST), (1.0, ("10.0.0.2", 5000)), (1.0, FIRST), (11.0, ("10.0.0.2", 5000))])
def test_any_datagrams_are_used_or_named_as_the_rules_say(
    wanted: str,
    excludes_rivals: bool,
    stream: list[Datagram],
) -> None:
    senders = SenderChoice(wanted, excludes_rivals=excludes_rivals)
    reading = Reading(wanted, excludes_rivals)
    now_s = 0.0
    for pause_s, address in stream:
        now_s += pause_s
        is_used = reading.takes(address, now_s)

        assert senders.may_use(address, now_s) is is_used
        if is_used:
            identity = reading.identity(address)
            assert senders.name(address) == identity
            senders.use(identity, now_s)
            reading.use(identity, now_s)
        assert senders.used == reading.used
        assert senders.others(now_s) == reading.named(now_s)


def used(stream: list[Datagram], wanted: str = "", *, excludes_rivals: bool = False) -> list[bool]:
    """Return for each datagram whether it is used."""
    senders = SenderChoice(wanted, excludes_rivals=True) if excludes_rivals else SenderChoice(wanted)
    now_s = 0.0
    found: list[bool] = []
    for pause_s, address in stream:
        now_s += pause_s
        found.append(senders.may_use(address, now_s))
        if found[-1]:
            senders.use(senders.name(address), now_s)
    return found


NEW_PORT = ("10.0.0.1", 6000)
ANOTHER = ("10.0.0.2", 5000)


@pytest.mark.parametrize(
    ("stream", "expected"),
    [
        ([(0.0, FIRST), (2.9, NEW_PORT)], [True, False]),
        ([(0.0, FIRST), (3.1, NEW_PORT)], [True, True]),  # its program was restarted
        ([(0.0, FIRST), (9.9, ANOTHER)], [True, False]),
        ([(0.0, FIRST), (10.1, ANOTHER)], [True, True]),
        ([(0.0, FIRST), *OTHER_PORTS], [True, *[False] * 7, True, True]),  # a new port for each datagram
    ],
)
def test_sender_is_replaced_after_a_silence(stream: list[Datagram], expected: list[bool]) -> None:
    assert used(stream) == expected
    assert used(stream, excludes_rivals=True) == expected  # none was heard side by side


def test_wanted_sender_is_the_only_one_used() -> None:
    assert used([(0.0, FIRST), (99.0, ANOTHER), (99.0, FIRST)], wanted="10.0.0.2") == [False, True, False]


def test_rival_heard_beside_the_sender_never_replaces_it() -> None:
    stream = [(0.0, FIRST), (1.0, ANOTHER), (1.0, FIRST), (99.0, ANOTHER), (1.0, ("10.0.0.3", 5000))]

    assert used(stream, excludes_rivals=True) == [True, False, True, False, True]
    assert used(stream) == [True, False, True, True, False]


def test_senders_beyond_the_limit_are_not_named() -> None:
    senders = SenderChoice()
    senders.use(FIRST, 0.0)
    for number in range(2, 30):
        senders.may_use((f"10.0.0.{number}", 5000), 1.0)

    assert senders.others(1.0) == sorted(f"10.0.0.{number}" for number in range(2, 2 + MAX_NAMED))
    assert senders.others(7.0) == []
