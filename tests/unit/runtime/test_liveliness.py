"""Presence as Zenoh reports it: each change is told once, also if the reports are out of order."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from pointit.runtime.bus.mailbox import Dispatcher
from pointit.runtime.zenoh.liveliness import MAX_TOKEN_CHARACTERS, LivelinessSubscriber

LONG = "x" * (MAX_TOKEN_CHARACTERS + 1)


@dataclass(frozen=True)
class Change:
    """A sample, as far as it is looked at."""

    key_expr: str
    kind: zenoh.SampleKind


@dataclass(frozen=True)
class Answer:
    ok: bool = True


class Network:
    """Stands for the session, its liveliness, the callback's declaration and the loop."""

    def __init__(self) -> None:
        self.present: set[str] = set()
        self.waiting: list[LivelinessSubscriber] = []
        self.callback: Any = None

    def liveliness(self) -> "Network":
        return self

    def declare_subscriber(self, _pattern: str, callback: Any, *, history: bool) -> "Network":
        assert history
        self.callback = callback
        return self

    def get(self, token: str, answers: Any) -> None:
        if token in self.present:
            answers(Answer())
        answers.drop()

    def undeclare(self) -> None: ...

    def report(self, token: str, *, is_present: bool) -> None:
        self.callback(Change(token, zenoh.SampleKind.PUT if is_present else zenoh.SampleKind.DELETE))

    def schedule(self, subscriber: LivelinessSubscriber) -> None:
        self.waiting.append(subscriber)

    def handle(self) -> None:
        while self.waiting:
            self.waiting.pop().drain()


TOKENS = st.sampled_from(["a", "b", LONG])
CHANGES = st.lists(st.one_of(st.none(), TOKENS), max_size=20)


def told_by(network: Network) -> tuple[set[str], LivelinessSubscriber]:
    """Return the set of tokens that a new subscriber has reported as present, and the subscriber."""
    told = set[str]()

    def tell(reported: Mapping[str, bool]) -> None:
        assert reported
        for token, is_present in reported.items():
            assert is_present != (token in told)
            (told.add if is_present else told.discard)(token)

    return told, LivelinessSubscriber(cast("zenoh.Session", network), "*", tell, cast("Dispatcher", network))


@given(CHANGES)
def test_the_loop_learns_what_is_present_each_change_once(changes: list[str | None]) -> None:
    network = Network()
    told, reader = told_by(network)
    for token in changes:
        if token is None:  # the loop has time
            network.handle()
            assert told == network.present
        else:
            network.present ^= {token[:MAX_TOKEN_CHARACTERS]}
            network.report(token, is_present=token[:MAX_TOKEN_CHARACTERS] in network.present)
            assert len(network.waiting) <= 1, "one wake-up for all"

    network.handle()
    assert told == network.present
    network.report("c", is_present=True)
    reader.close()
    network.handle()
    assert "c" not in told


@given(st.lists(st.tuples(st.sampled_from(["a", "b"]), st.booleans(), st.booleans()), max_size=20))
def test_presence_is_known_although_changes_are_reported_in_reverse(
    pairs: list[tuple[str, bool, bool]],
) -> None:
    network = Network()
    told, _ = told_by(network)
    for token, is_present, has_time in pairs:
        if is_present != (token in network.present):
            network.present ^= {token}
            network.report(token, is_present=is_present)
        # its process is killed and followed by another, or the other way round
        network.report(token, is_present=is_present)
        if has_time:
            network.handle()
        network.report(token, is_present=not is_present)
        network.handle()
        assert told == network.present


@pytest.mark.parametrize("is_present", [True, False])
def test_a_change_reported_twice_does_not_hide_the_next(is_present: bool) -> None:
    network = Network()
    told, _ = told_by(network)
    for present in (not is_present, is_present):
        network.present = {"a"} if present else set()
        network.report("a", is_present=present)
    network.report("a", is_present=is_present)
    network.present ^= {"a"}
    network.report("a", is_present=not is_present)
    network.handle()
    assert told == network.present
