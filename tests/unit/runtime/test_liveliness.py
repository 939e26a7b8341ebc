"""Tokens that come and go while the loop is busy."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

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


class Network:
    """Stands for the session, its liveliness, the callback's declaration and the loop."""

    def __init__(self) -> None:
        self.waiting: list[LivelinessSubscriber] = []
        self.callback: Any = None

    def liveliness(self) -> "Network":
        return self

    def declare_subscriber(self, _pattern: str, callback: Any, *, history: bool) -> "Network":
        assert history
        self.callback = callback
        return self

    def undeclare(self) -> None: ...

    def schedule(self, subscriber: LivelinessSubscriber) -> None:
        self.waiting.append(subscriber)

    def handle(self) -> None:
        while self.waiting:
            self.waiting.pop().drain()


TOKENS = st.sampled_from(["a", "b", LONG])
CHANGES = st.lists(st.one_of(st.none(), st.tuples(TOKENS, st.booleans())), max_size=20)


@given(CHANGES)
def test_the_loop_learns_what_is_present_each_change_once(changes: list[tuple[str, bool] | None]) -> None:
    network, present, told = Network(), set[str](), set[str]()

    def tell(reported: Mapping[str, bool]) -> None:
        assert reported
        for token, is_present in reported.items():
            assert is_present != (token in told)
            (told.add if is_present else told.discard)(token)

    reader = LivelinessSubscriber(cast("zenoh.Session", network), "*", tell, cast("Dispatcher", network))
    for change in changes:
        if change is None:  # the loop has time
            network.handle()
            assert told == present
        else:
            token, is_present = change
            network.callback(Change(token, zenoh.SampleKind.PUT if is_present else zenoh.SampleKind.DELETE))
            (present.add if is_present else present.discard)(token[:MAX_TOKEN_CHARACTERS])
            assert len(network.waiting) <= 1, "one wake-up for all"
    network.handle()
    assert told == present
    network.callback(Change("c", zenoh.SampleKind.PUT))
    reader.close()
    network.handle()
    assert "c" not in told
