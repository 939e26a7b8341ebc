"""Connections that are cut off at a router, and identities that are only reported."""

import dataclasses

import pytest

from pointit.access.rights import (
    BURST,
    HOLD_S,
    MAX_CONNECTIONS,
    MAX_HZ,
    START_LOAD,
    ConnectionLimits,
    LimitedConnection,
)

ROLES = {"lab/anna": "user", "lab/ben": "user", "lab/services": "services", "lab/operator": "operator"}


def connections(identity: str, count: int, first: int = 0) -> list[LimitedConnection]:
    return [
        LimitedConnection(identity=identity, session=f"{number:x}", address=f"tls/10.0.0.7:{40_000 + number}")
        for number in range(first, first + count)
    ]


def test_newest_connections_of_an_identity_that_has_too_many_are_cut_and_named() -> None:
    limits = ConnectionLimits()
    old = connections("lab/anna", MAX_CONNECTIONS)
    ben = connections("lab/ben", 3, 5000)
    assert limits.excess([*old, *ben], ROLES, {}, 0.0) == ([], {})
    new = connections("lab/anna", 1000, 100)
    cut, told = limits.excess([*new, *ben, *old], ROLES, {}, 1.0)  # in whatever order Zenoh lists them
    assert set(cut) == set(new)
    assert list(told) == ["lab/anna"]
    assert "has 1032 connections, at most 32 are let in" in told["lab/anna"]
    assert "`pointit site renew anna`" in told["lab/anna"]
    assert limits.excess([*old, *ben], ROLES, {}, 2.0) == ([], {})


@pytest.mark.parametrize("identity", ["lab/services", "lab/operator", "", "lab/nobody"])
def test_identities_that_serve_all_and_unknown_ones_have_no_limit(identity: str) -> None:
    limits = ConnectionLimits(1)
    rates = {identity: 100 * MAX_HZ}
    for now_s in range(6):
        assert limits.excess(connections(identity, 50), ROLES, rates, float(now_s)) == ([], {})


def test_connection_whose_identity_becomes_known_late_is_as_old_as_it_is() -> None:
    """On sites by passwords the name is known after the first decision on a connection."""
    limits, (first, second) = ConnectionLimits(1), connections("lab/anna", 2)
    unknown = dataclasses.replace(first, identity="")
    assert limits.excess([unknown], ROLES, {}, 0.0) == ([], {})
    assert limits.excess([unknown, second], ROLES, {}, 1.0) == ([], {})
    assert limits.excess([first, second], ROLES, {}, 2.0)[0] == [second]


def test_connections_by_quic_are_named_with_what_ends_them_and_not_said_to_be_cut() -> None:
    limits = ConnectionLimits(1)
    roles = {"lab/dashboard1": "dashboard"}
    own = [
        dataclasses.replace(each, address=each.address.replace("tls/", "quic/"))
        for each in connections("lab/dashboard1", 2)
    ]
    for now_s, rates in enumerate(({}, {"lab/dashboard1": MAX_HZ + BURST + 2 * START_LOAD})):
        cut, told = limits.excess(own, roles, rates, float(now_s))
        assert not cut
        remedy = "cannot be cut (QUIC): revoke it: `pointit site revoke dashboard1`"
        assert told["lab/dashboard1"].endswith(remedy)
        assert ("2500 a second" in told["lab/dashboard1"]) == bool(rates)


def test_flood_is_cut_off_for_a_while_and_only_that_identity() -> None:
    limits = ConnectionLimits()
    own = connections("lab/anna", 2)
    everybody = [*own, *connections("lab/ben", 2, 50)]
    looks = 4
    rates = {"lab/anna": MAX_HZ + (BURST + 2 * START_LOAD) / looks, "lab/ben": 1400.0}
    for now_s in range(looks - 1):
        assert limits.excess(everybody, ROLES, rates, float(now_s)) == ([], {})
    flooded_s = float(looks - 1)
    cut, told = limits.excess(everybody, ROLES, rates, flooded_s)
    assert (cut, list(told)) == (own, ["lab/anna"])
    assert "cut off for 30 s" in told["lab/anna"]
    assert limits.excess(everybody, ROLES, {}, flooded_s + HOLD_S - 1.0)[0] == own, "it came back"
    assert limits.excess(everybody, ROLES, {}, flooded_s + HOLD_S) == ([], {})


def test_burst_after_a_link_stood_still_is_not_cut_off() -> None:
    """An IMU of 200 Hz and all that follows from it, 7 topics, held up for a lease again and again."""
    limits = ConnectionLimits()
    own = connections("lab/anna", 1)
    for now_s in range(60):
        rate_hz = 3 * 1400.0 + 1400.0 if now_s % 4 == 0 else 1400.0
        assert limits.excess(own, ROLES, {"lab/anna": rate_hz}, float(now_s)) == ([], {})
    for now_s in range(60, 120):  # all at once, twice what can be
        rate_hz = 2 * (3 * 1400.0 + 1400.0) if now_s % 10 == 0 else 1400.0
        assert limits.excess(own, ROLES, {"lab/anna": rate_hz}, float(now_s)) == ([], {})


@pytest.mark.parametrize(("rate_hz", "cut_after"), [(3000.0, 27), (4900.0, 6), (10_000.0, 2)])
def test_flood_counts_by_rate_and_time(rate_hz: float, cut_after: int) -> None:
    limits = ConnectionLimits()
    own = connections("lab/anna", 1)
    looks = [bool(limits.excess(own, ROLES, {"lab/anna": rate_hz}, now_s)[0]) for now_s in range(cut_after)]
    assert looks == [False] * (cut_after - 1) + [True]


def test_sixteen_viewers_may_declare_all_at_once_and_a_flood_is_cut_before_the_second_is_over() -> None:
    limits = ConnectionLimits()
    own = connections("lab/anna", 16)
    start = {"lab/anna": 16 * 1600.0}
    limits.hold(own, ROLES, start, 0.5)
    assert not limits.held
    for now_s, each in enumerate([own, own, [], []]):  # the router opens again, and all leave
        assert limits.excess(each, ROLES, start if each else {}, float(now_s)) == ([], {}), now_s
        limits.hold(each, ROLES, {"lab/anna": 1600.0}, now_s + 0.5)
        assert not limits.held, now_s
    limits.hold([], ROLES, {"lab/anna": 2 * BURST, "lab/services": 2 * BURST}, 5.5)
    assert list(limits.held) == ["lab/anna"]


def test_flood_that_pauses_for_a_second_is_cut_off() -> None:
    limits = ConnectionLimits()
    own = connections("lab/anna", 1)
    rates = [{} if now_s % 4 == 3 else {"lab/anna": MAX_HZ + BURST / 4} for now_s in range(20)]
    assert any(limits.excess(own, ROLES, rate, float(now_s))[0] for now_s, rate in enumerate(rates))


ANNA = LimitedConnection(identity="lab/anna", session="a1", address="tls/10.0.0.7:40000")
ONE_ROLE = {"lab/anna": "user"}


def look(limits: ConnectionLimits, now_s: float, rate_hz: float = 0.0) -> bool:
    """Look once. Return True if the connection is cut."""
    cut, told = limits.excess([ANNA], ONE_ROLE, {"lab/anna": rate_hz}, now_s)
    assert (cut, list(told)) in (([], []), ([ANNA], ["lab/anna"]))
    return bool(cut)


def test_identity_that_flooded_is_let_in_again_when_it_has_ended_to() -> None:
    limits = ConnectionLimits()
    assert look(limits, 0.0, MAX_HZ + 10 * BURST)
    for second in range(1, int(HOLD_S)):
        assert look(limits, float(second))
    for second in range(int(HOLD_S), 200):
        assert not look(limits, float(second), MAX_HZ / 2.0)
