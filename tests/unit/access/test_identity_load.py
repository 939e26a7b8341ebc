"""Load of one identity by random histories, in virtual time: who is cut off, and who never is."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.access.identity_load import (
    BURST,
    CONNECTION_COST,
    FORGIVEN_S,
    HOLD_S,
    INTERNAL_COST,
    KEY_BURST_S,
    MAX_HOLD_S,
    MAX_HZ,
    QUIET_S,
    REQUEST_COST,
    START_PERIOD_S,
    Decision,
    IdentityLoad,
    Load,
)
from pointit.access.rights import LATEST_HZ, MAX_RATE_HZ

STEP_S = 0.1
LEASE_S = 3.0
"""Time for which a link may stall without ending."""
FLOOD_HZ = 3.0 * MAX_HZ
"""Rate of which 2 s are more than what is allowed in them, `2 * MAX_HZ + BURST`."""
CUT_OFF_S = 5.0
VIEWERS = 16
VIEWER_START = 1600.0
"""Load of the declarations of a viewer of all topics."""


def load_of(size: float, kind: str) -> Load:
    """Return a load of `size` messages by operations of one kind."""
    if kind == "requests":
        return Load(requests=size / REQUEST_COST)
    if kind == "internal requests":
        return Load(internal_requests=size / INTERNAL_COST)
    if kind == "connections":
        return Load(connections=math.ceil(size / CONNECTION_COST))
    return Load(messages=size)


KINDS = ("messages", "requests", "internal requests", "connections")


def mixed(size: float, shares: Sequence[float]) -> Load:
    """Return a load of `size` at least, of which each kind has its share."""
    load = Load()
    for kind, share in zip(KINDS, shares, strict=True):
        part = load_of(size * share / sum(shares), kind)
        load.messages += part.messages
        load.requests += part.requests
        load.internal_requests += part.internal_requests
        load.connections += part.connections
    return load


def cut_off_s(loads: Iterable[Load], identity_load: IdentityLoad | None = None) -> float:
    """Return the time at which an identity with these loads, one each `STEP_S`, is cut off, or infinity."""
    identity_load = identity_load or IdentityLoad(0.0)
    for number, load in enumerate(loads, 1):
        if identity_load.step(number * STEP_S, load) is Decision.CUT_OFF:
            return number * STEP_S
    return math.inf


@dataclass(frozen=True, kw_only=True)
class Second:
    """Operations of an identity in one second."""

    rate_hz: float
    shares: tuple[float, ...]
    """Weight of each of `KINDS` in the load, 0 to 1. The sum is not normalized."""


SHARES = st.tuples(*[st.floats(0.0, 1.0)] * len(KINDS)).filter(lambda shares: sum(shares) > 0.1)


def seconds(rates_hz: st.SearchStrategy[float]) -> st.SearchStrategy[Second]:
    return st.builds(Second, rate_hz=rates_hz, shares=SHARES)


def steps(history: Sequence[Second]) -> list[Load]:
    """Return loads of the rates of `history` at least, as a connection is a whole one."""
    count = round(1.0 / STEP_S)
    return [mixed(second.rate_hz * STEP_S, second.shares) for second in history for _ in range(count)]


def steps_below(history: Sequence[Second]) -> list[Load]:
    """Return loads of the rates of `history` at most."""
    loads = steps(history)
    for load in loads:
        load.connections = max(0, load.connections - 1)
    return loads


HISTORIES = st.lists(seconds(st.floats(0.0, MAX_HZ)), max_size=40)


@given(before=HISTORIES, flood=st.lists(seconds(st.floats(FLOOD_HZ, 50 * FLOOD_HZ)), min_size=5, max_size=5))
def test_flood_of_any_mixture_is_cut_off_within_five_seconds(
    before: list[Second], flood: list[Second]
) -> None:
    identity_load = IdentityLoad(0.0)
    quiet_s = cut_off_s(steps_below(before), identity_load)
    assert quiet_s == math.inf
    assert cut_off_s(steps(flood), _later(identity_load, len(before))) <= CUT_OFF_S


def _later(identity_load: IdentityLoad, elapsed_s: float) -> IdentityLoad:
    """Return it as one whose clock begins at 0 again."""

    class Later(IdentityLoad):
        def step(self, now_s: float, load: Load) -> Decision:
            return identity_load.step(elapsed_s + now_s, load)

    return Later(0.0)


@given(rate_hz=st.floats(FLOOD_HZ, 50 * FLOOD_HZ))
def test_flood_of_writes_is_cut_off_after_two_seconds(rate_hz: float) -> None:
    history = [Second(rate_hz=rate_hz, shares=(1.0, 0.0, 0.0, 0.0))] * 3
    assert cut_off_s(steps(history)) <= 2.0 + STEP_S


@given(
    rates_hz=st.lists(st.floats(0.0, MAX_HZ), min_size=1, max_size=60),
    stalls_s=st.lists(st.floats(0.0, LEASE_S), min_size=1, max_size=60),
    kind=st.sampled_from(["messages", "requests", "internal requests"]),
)
def test_identity_below_the_limit_stays_when_its_link_stalls(
    rates_hz: list[float], stalls_s: list[float], kind: str
) -> None:
    """A stall delivers late, and at once, what was sent meanwhile."""
    loads: list[Load] = []
    waiting = 0.0
    stall_left_s = 0.0
    stalls = iter(stalls_s)
    for rate_hz in rates_hz:
        for _ in range(round(1.0 / STEP_S)):
            waiting += rate_hz * STEP_S
            stall_left_s -= STEP_S
            if stall_left_s > 0.0:
                loads.append(Load())
                continue
            loads.append(load_of(waiting, kind))
            waiting = 0.0
            stall_left_s = next(stalls, 0.0)

    assert cut_off_s(loads) == math.inf


@given(
    spread_s=st.floats(STEP_S, 20.0),
    returns=st.integers(1, 5),
    period_s=st.floats(START_PERIOD_S + 1.0, 60.0),
    rate_hz=st.floats(0.0, 200.0),
)
def test_sixteen_viewers_who_return_at_once_are_never_cut_off(
    spread_s: float, returns: int, period_s: float, rate_hz: float
) -> None:
    count = max(1, round(spread_s / STEP_S))
    loads: list[Load] = []
    for _ in range(returns):
        for number in range(count):
            connections = math.ceil(VIEWERS * (number + 1) / count) - math.ceil(VIEWERS * number / count)
            declared = VIEWERS * VIEWER_START / count
            load = Load(messages=rate_hz * STEP_S, requests=declared / REQUEST_COST, connections=connections)
            loads.append(load)
        loads += [Load(messages=rate_hz * STEP_S)] * max(0, round(period_s / STEP_S) - count)
    assert cut_off_s(loads) == math.inf


def test_viewers_may_return_at_once_after_each_router_start() -> None:
    identity_load = IdentityLoad(0.0)
    for second in range(1, 6):
        identity_load.allow_start()
        load = Load(requests=VIEWERS * VIEWER_START / REQUEST_COST, connections=VIEWERS)
        assert identity_load.step(float(second), load) is Decision.ALLOW


def test_start_is_not_for_writes_and_used_up_in_seconds() -> None:
    assert cut_off_s([Load(messages=BURST + MAX_HZ)]) == pytest.approx(STEP_S)
    declared = [load_of(2 * MAX_HZ * STEP_S, "requests")] * 200
    assert 2.0 < cut_off_s(declared) < 10.0


@given(st.lists(st.integers(1, 40), min_size=1, max_size=50))
def test_connections_that_are_closed_and_opened_again_forgive_nothing(opened: list[int]) -> None:
    """The load has no input for the end of a connection; one that opens costs."""
    flood = Load(messages=FLOOD_HZ * STEP_S)
    steady_s = cut_off_s([flood] * 100)
    numbers = (opened * 100)[:100]
    reopening = [Load(messages=flood.messages, connections=number) for number in numbers]
    assert cut_off_s(reopening) <= steady_s


@pytest.mark.parametrize(("rate_hz", "cut_s"), [(3000.0, 19.5), (4900.0, 4.0), (10_000.0, 1.3)])
def test_flood_is_cut_off_by_rate_and_time(rate_hz: float, cut_s: float) -> None:
    assert cut_off_s([Load(messages=rate_hz * STEP_S)] * 400) == pytest.approx(cut_s, abs=0.15)


def test_burst_after_a_link_stood_still_is_not_cut_off() -> None:
    """An IMU of 200 Hz and all that follows from it, 7 topics, held up for a lease again and again."""
    identity_load = IdentityLoad(0.0)
    for second in range(60):
        burst = 3 * 1400.0 if second % 4 == 0 else 0.0
        assert identity_load.step(second + 1.0, Load(messages=burst + 1400.0)) is Decision.ALLOW
    for step in range(600, 1200):  # within a second, twice what can be
        factor = 2 * 4 if step % 100 < 10 else 1
        load = Load(messages=factor * 1400.0 * STEP_S)
        assert identity_load.step((step + 11) * STEP_S, load) is Decision.ALLOW


def test_flood_that_pauses_for_a_second_is_cut_off() -> None:
    loads = [Load(messages=0.0 if second % 4 == 3 else MAX_HZ + BURST / 4) for second in range(20)]
    identity_load = IdentityLoad(0.0)
    decisions = [identity_load.step(second + 1.0, load) for second, load in enumerate(loads)]
    assert Decision.CUT_OFF in decisions


@pytest.mark.parametrize(
    ("key", "rate_hz"), [("users/anna/cursor", LATEST_HZ), ("users/anna/claim", MAX_RATE_HZ)]
)
@pytest.mark.parametrize("connections", [1, 2, 8])
def test_rate_of_a_key_holds_for_all_connections_together(key: str, rate_hz: float, connections: int) -> None:
    count = connections * rate_hz * STEP_S
    loads = [Load(messages=count, by_key=Counter({key: round(count)}))] * 100
    cut_s = cut_off_s(loads)
    if connections == 1:
        assert cut_s == math.inf
    else:
        assert cut_s <= KEY_BURST_S / (connections - 1) + 1.0


def flooded(identity_load: IdentityLoad, now_s: float) -> None:
    assert identity_load.step(now_s, Load(messages=BURST + MAX_HZ * FORGIVEN_S)) is Decision.CUT_OFF


def test_identity_stays_out_longer_each_time_until_it_is_forgiven() -> None:
    identity_load = IdentityLoad(0.0)
    now_s = 1.0
    holds_s: list[float] = []
    for _ in range(8):
        flooded(identity_load, now_s)
        holds_s.append(identity_load.hold_s)
        assert identity_load.step(now_s + identity_load.hold_s - 0.1, Load(messages=1e6)) is Decision.HOLD
        now_s += identity_load.hold_s
        assert not identity_load.is_held(now_s)
    assert holds_s == [min(HOLD_S * 2**number, MAX_HOLD_S) for number in range(8)]
    flooded(identity_load, now_s + FORGIVEN_S)
    assert identity_load.hold_s == HOLD_S


def test_identity_that_has_ended_its_flood_is_let_in_again() -> None:
    identity_load = IdentityLoad(0.0)
    flooded(identity_load, 1.0)
    for second in range(2, 200):
        load = Load(messages=MAX_HZ / 2)
        decision = identity_load.step(float(second), load)
        assert decision is (Decision.HOLD if second < 1.0 + HOLD_S else Decision.ALLOW)


def test_attack_is_reported_once_with_its_size_at_its_end() -> None:
    identity_load = IdentityLoad(0.0)
    identity_load.step(1.0, Load(messages=1400.0))
    for number in range(1, 21):
        identity_load.step(2.0 + number * STEP_S, Load(messages=1000.0, connections=1))
    identity_load.step(5.0, Load(messages=500.0))
    assert identity_load.pop_ended_attack(5.0 + HOLD_S) is None

    for second in range(40, 60):
        identity_load.step(float(second), Load(messages=1400.0))
    attack = identity_load.pop_ended_attack(5.0 + HOLD_S + QUIET_S)
    assert attack is not None
    assert (attack.messages, attack.connections, attack.times_cut) == (
        20 * (1000.0 + CONNECTION_COST) + 500.0,
        20,
        1,
    )
    assert attack.ended_s == 5.0
    assert identity_load.pop_ended_attack(1000.0) is None
