"""Connections that are closed at a router, identities that are cut off, and what is told of them."""

import dataclasses
from collections import Counter

import pytest

from pointit.access.connection_limits import (
    MAX_CONNECTIONS,
    ConnectionLimits,
    LimitedConnection,
    account_of,
    loads_of,
)
from pointit.access.identity_load import BURST, HOLD_S, KEY_BURST_S, MAX_HZ, QUIET_S, Load
from pointit.access.rights import LATEST_HZ
from pointit.access.zenoh_trace import CHARACTERS_OF_MESSAGE, Operation, TraceCounts

ROLES = {"lab/anna": "user", "lab/ben": "user", "lab/services": "services", "lab/operator": "operator"}
FLOOD = Load(messages=BURST + MAX_HZ)
FORMER = "lab/anna/1"


def connections(account: str, count: int, first: int = 0) -> list[LimitedConnection]:
    return [
        LimitedConnection(account=account, session=f"{number:x}", address=f"tls/10.0.0.7:{40_000 + number}")
        for number in range(first, first + count)
    ]


def test_newest_connections_beyond_the_limit_are_cut_and_named() -> None:
    limits = ConnectionLimits()
    old = connections("lab/anna", MAX_CONNECTIONS)
    ben = connections("lab/ben", 3, 5000)
    assert limits.excess([*old, *ben], ROLES) == ([], {})
    new = connections("lab/anna", 1000, 100)

    cut, messages = limits.excess([*new, *ben, *old], ROLES)  # in whatever order Zenoh lists them

    assert set(cut) == set(new)
    assert list(messages) == ["lab/anna"]
    assert "has 1032 connections, at most 32 are let in" in messages["lab/anna"]
    assert "`pointit site renew anna`" in messages["lab/anna"]
    assert limits.excess([*old, *ben], ROLES) == ([], {})


@pytest.mark.parametrize("account", ["lab/services", "lab/operator", "", "lab/nobody"])
def test_identities_that_serve_all_and_unknown_ones_have_no_limit(account: str) -> None:
    limits = ConnectionLimits(1)
    for now_s in range(6):
        assert limits.step({account: FLOOD}, ROLES, float(now_s)) == []
        assert limits.excess(connections(account, 50), ROLES) == ([], {})


def test_connection_keeps_its_age_when_its_identity_becomes_known_late() -> None:
    """On sites by passwords the name is known after the first decision on a connection."""
    limits = ConnectionLimits(1)
    first, second = connections("lab/anna", 2)
    unknown = dataclasses.replace(first, account="")
    assert limits.excess([unknown], ROLES) == ([], {})
    assert limits.excess([unknown, second], ROLES) == ([], {})
    assert limits.excess([first, second], ROLES)[0] == [second]


def test_quic_connections_beyond_the_limit_are_named_with_a_remedy() -> None:
    roles = {"lab/dashboard1": "dashboard"}
    own = [
        dataclasses.replace(connection, address=connection.address.replace("tls/", "quic/"))
        for connection in connections("lab/dashboard1", 2)
    ]
    remedy = "cannot be cut (QUIC): revoke it: `pointit site revoke dashboard1`"
    limits = ConnectionLimits(1)
    for loads in ({}, {"lab/dashboard1": FLOOD}):
        limits.step(loads, roles, 1.0)
        cut, messages = limits.excess(own, roles)
        assert not cut
        assert messages["lab/dashboard1"].endswith(remedy)
        assert ("2500 a second" in messages["lab/dashboard1"]) == bool(loads)


def test_flood_of_one_identity_is_cut_off_for_a_while() -> None:
    limits = ConnectionLimits()
    everybody = [*connections("lab/anna", 2), *connections("lab/ben", 2, 50)]
    loads = {"lab/anna": FLOOD, "lab/ben": Load(messages=1400.0), "lab/services": FLOOD}

    assert limits.step(loads, ROLES, 1.0) == ["lab/anna"]

    cut, messages = limits.excess(everybody, ROLES)
    assert not cut, "they are cut at the step, and not too many"
    assert list(messages) == ["lab/anna"]
    assert "10000 messages more than 2500 a second and is cut off for 30 s" in messages["lab/anna"]
    for now_s in (2.0, HOLD_S):
        assert limits.step(loads, ROLES, now_s) == []
        assert [account for account in ROLES if limits.is_held(account)] == ["lab/anna"]
    limits.step({}, ROLES, 1.0 + HOLD_S)
    assert not limits.has_held
    assert limits.excess(everybody, ROLES) == ([], {})


def test_key_written_by_several_connections_is_named() -> None:
    limits = ConnectionLimits()
    key = "users/anna/cursor"
    count = round(KEY_BURST_S * LATEST_HZ)
    load = Load(messages=count, by_key=Counter({key: count}))
    assert limits.step({"lab/anna": load}, ROLES, 1.0) == ["lab/anna"]
    _, messages = limits.excess(connections("lab/anna", 2), ROLES)
    assert f"has written {key} more than 500 times a second, by several connections" in messages["lab/anna"]


def test_revoked_certificate_does_not_cut_off_the_valid_one() -> None:
    limits = ConnectionLimits()
    roles = {**ROLES, FORMER: "user"}
    denied = Counter({Operation("ab", FORMER, "Put", "pointit/lab/map"): round(BURST + MAX_HZ)})

    assert limits.step(loads_of(TraceCounts(denied=denied), {}, {FORMER}), roles, 1.0) == [FORMER]

    assert not limits.is_held("lab/anna")
    _, messages = limits.excess(connections(FORMER, 1), roles)
    assert messages["lab/anna"].startswith("lab/anna, by a revoked or replaced certificate, has written")


def test_end_of_a_flood_is_told_once_with_its_size() -> None:
    limits = ConnectionLimits()
    limits.step({"lab/anna": FLOOD}, ROLES, 1.0)
    limits.step({"lab/anna": Load(messages=500.0, connections=3)}, ROLES, 5.0)
    limits.step({}, ROLES, 1.0 + HOLD_S)
    assert limits.pop_ended_attacks() == {}
    limits.step({}, ROLES, 1.0 + HOLD_S + QUIET_S)
    size = "13900 messages and 3 new connections in 4 s, cut off once"
    assert limits.pop_ended_attacks() == {"lab/anna": f"the flood of lab/anna has ended: {size}"}
    assert limits.pop_ended_attacks() == {}


ANNA = "lab/anna/2"
CLAIM = "pointit/lab/users/anna/claim"
IMU = "pointit/lab/users/anna/imu"


@pytest.mark.parametrize(
    ("field", "message", "key", "load"),
    [
        ("writes", "Put", CLAIM, Load(messages=10, by_key=Counter({"users/anna/claim": 10}))),
        ("writes", "Put", IMU, Load(messages=10)),
        ("writes", "Put", f"{CLAIM}/@adv/pub/1/2/_", Load(messages=10)),
        ("too_frequent", "Put", CLAIM, Load(messages=10)),
        ("too_frequent", "Query", CLAIM, Load(requests=10)),
        ("requests", "Subscriber", CLAIM, Load(requests=10)),
        ("denied", "Put", CLAIM, Load(messages=10)),
        ("denied", "Query", CLAIM, Load(requests=10)),
        ("denied", "Subscriber", CLAIM, Load(requests=10)),
        ("denied", "Liveliness Token", CLAIM, Load(requests=10)),
    ],
)
def test_denied_operations_load_as_permitted_ones_do(field: str, message: str, key: str, load: Load) -> None:
    counts = TraceCounts()
    getattr(counts, field)[Operation("ab", ANNA, message, key)] = 10
    assert loads_of(counts, {}, ()) == {"lab/anna": load}


def test_new_connections_and_long_keys_load() -> None:
    counts = TraceCounts(long_lines=Counter({ANNA: 6000 // CHARACTERS_OF_MESSAGE, "": 7}))
    assert loads_of(counts, {ANNA: 3, FORMER: 1, "": 2}, {FORMER}) == {
        "lab/anna": Load(messages=60, connections=3),
        FORMER: Load(connections=1),
    }


def test_account_of_a_former_name_is_its_own() -> None:
    assert account_of(ANNA, {FORMER}) == "lab/anna"
    assert account_of(FORMER, {FORMER}) == FORMER
    assert account_of("", {FORMER}) == ""
