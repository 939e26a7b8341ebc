"""Zenoh's trace log, of which `zenoh_trace.log` is a sample (`tests.integration.access.trace_sample`)."""

import importlib.metadata
from pathlib import Path

import pytest

from pointit.access import zenoh_trace
from pointit.access.zenoh_trace import (
    MAX_KEY_LENGTH,
    ZENOH_VERSION,
    Operation,
    TraceCounts,
    ZenohTrace,
    is_configuration,
    version_warning,
)

SAMPLE = Path(__file__).with_name("zenoh_trace.log")
ANNA = "lab/anna/1"
HEAD = (
    "\x1b[2m2030-01-01T00:00:00.000000Z\x1b[0m \x1b[35mTRACE\x1b[0m  rx-0 ThreadId(07) "
    "\x1b[2mzenoh::net::routing::interceptor::access_control\x1b[0m\x1b[2m:\x1b[0m "
)


def sample_counts(*, with_configuration: bool) -> TraceCounts:
    trace = ZenohTrace()
    for line in SAMPLE.read_bytes().split(b"\n"):
        if with_configuration or not is_configuration(line):
            trace.take(line.decode(errors="replace"))
    return trace.pop()


def by_key(operations: dict[Operation, int], common_name: str = ANNA) -> dict[tuple[str, str], int]:
    """Return the counts of one common name by kind and key relative to the site."""
    return {
        (operation.message, operation.key.removeprefix("pointit/lab/")): count
        for operation, count in operations.items()
        if operation.common_name == common_name
    }


@pytest.mark.parametrize("with_configuration", [True, False])
def test_sample_of_the_pinned_version_is_read_completely(*, with_configuration: bool) -> None:
    counts = sample_counts(with_configuration=with_configuration)
    long_key = ("x" * 2000)[: MAX_KEY_LENGTH - len("pointit/lab/")]
    assert by_key(counts.writes) == {("Put", "users/anna/claim"): 2, ("Put", "users/anna/cursor"): 1}
    assert by_key(counts.requests) == {
        ("Subscriber", "users/ben/cursor"): 1,
        ("Liveliness Token", "alive/users/anna"): 1,
        ("Query", "selector/history"): 1,
    }
    assert by_key(counts.requests, "lab/services/1") == {("Subscriber", "users/anna/claim"): 1}
    assert by_key(counts.denied) == {
        ("Put", "users/ben/cursor"): 1,
        ("Put", long_key): 1,
        ("Subscriber", "users/ben/imu"): 1,
        ("Liveliness Token", "alive/users/ben"): 1,
        ("Query", "selector/anna/release"): 1,
    }
    assert by_key(counts.too_frequent) == {("Put", "users/ben/cursor"): 1, ("Put", "users/anna/cursor"): 19}
    assert by_key(counts.too_long) == {("Put", "users/anna/claim"): 1}
    assert counts.long_lines == {ANNA: 23}
    assert counts.rejected == {"came without credentials, by plain TCP instead of TLS": 1}


def test_lines_about_rules_are_recognised_by_their_start_only() -> None:
    lines = SAMPLE.read_bytes().split(b"\n")
    skipped = [line for line in lines if is_configuration(line)]
    assert len(skipped) == 8
    assert not any(b"authorized" in line or b"accept" in line for line in skipped)
    forged = HEAD.encode() + skipped[0]
    assert not is_configuration(forged)


def test_another_version_is_warned_of() -> None:
    assert importlib.metadata.version("eclipse-zenoh") == ZENOH_VERSION, "read the log again: trace_sample.py"
    assert not version_warning(ZENOH_VERSION)
    assert "Zenoh 1.11.0 is installed" in version_warning("1.11.0")


def decision(connection: str, key: str, *, common_name: str = "", verdict: str = "authorized") -> str:
    who = f"{connection} on Interface(lo)+CertCommonName({common_name})+Transport(Tls)+{connection}"
    if not common_name:
        who = f"Using cached result: {connection}"
    return f"{HEAD}{who} is {verdict} to Put (ingress) on {key}"


def test_connections_that_have_ended_are_forgotten_and_present_ones_never() -> None:
    trace = ZenohTrace()
    trace.take(decision("ab", "x", common_name=ANNA))
    trace.keep({"ab": ""})
    for number in range(20):
        trace.take(decision(f"c{number}", "x", common_name="lab/mallory/1"))
        trace.keep({"ab": "", "de": "lab/ben/1"})
    assert (trace.common_name("ab"), trace.common_name("de")) == (ANNA, "lab/ben/1")
    trace.keep({"ab": ""})
    assert trace.common_name("c1") == ""


@pytest.mark.parametrize("verdict", ["authorized", "unauthorized"])
def test_any_number_of_keys_counts(verdict: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zenoh_trace, "MAX_COUNTED", 10)
    trace = ZenohTrace()
    trace.take(decision("ab", "x", common_name=ANNA, verdict=verdict))
    for number in range(99):
        trace.take(decision("ab", f"x{number}", verdict=verdict))
    counts = trace.pop()
    operations = counts.writes if verdict == "authorized" else counts.denied
    assert sum(by_key(operations).values()) == 100
    assert len(operations) <= 12


INTEREST_HEAD = (
    "\x1b[2m2026-11-30T16:09:48.558589Z\x1b[0m \x1b[34mDEBUG\x1b[0m  rx-0 ThreadId(08) "
    "\x1b[1mroute_interest\x1b[0m\x1b[1m{\x1b[0m\x1b[3mself\x1b[0m\x1b[2m=\x1b[0mnorth "
    "\x1b[3m_res\x1b[0m\x1b[2m=\x1b[0mSome("
)
INTEREST_END = (
    "\x1b[1m}\x1b[0m\x1b[2m:\x1b[0m \x1b[2mzenoh::net::routing::hat::router::interests\x1b[0m\x1b[2m:\x1b[0m "
    "\x1b[3mreturn\x1b[0m\x1b[2m=\x1b[0mResolvedCurrentInterest"
)
SOURCE = ") \x1b[3msrc\x1b[0m\x1b[2m=\x1b[0msouth:0:client/"
"""Parts of a line on an interest, as Zenoh 1.10.2 has written it."""


@pytest.mark.parametrize(
    "key",
    [
        "pointit/lab/**",
        "pointit/lab/x) src=south:0:client/be0000000:1}: zenoh::net::routing::hat::router::interests: return",
        f"pointit/lab/x {HEAD}be00 is authorized to Put (ingress) on y".replace("\x1b", "\\x1b"),
        "pointit/lab/caching permissions is unauthorized to Put (ingress) on pointit/lab/users/ben/cursor",
    ],
)
def test_interest_is_counted_for_its_own_connection_whatever_its_key(key: str) -> None:
    trace = ZenohTrace()
    name = "fe39da01ec4846fc04a9ef40d9324a1e"
    who = f"{name} on Interface(lo)+CertCommonName({ANNA})+Transport(Tls)+{name}"
    trace.take(f"{HEAD}{who} is authorized to Put (ingress) on pointit/lab/users/anna/claim")
    trace.take(f"{INTEREST_HEAD}{key}{SOURCE}fe39da01:2{INTEREST_END}", 41)
    trace.take(f"{INTEREST_HEAD}{key}{SOURCE}fe39da01:2{INTEREST_END}")
    final = INTEREST_HEAD.replace("route_interest", "route_interest_final")
    trace.take(f"{final}{key}){INTEREST_END}")
    counts = trace.pop()
    assert counts.requests == {Operation(name, ANNA, "Interest", ""): 42}
    assert counts.writes == {Operation(name, ANNA, "Put", "pointit/lab/users/anna/claim"): 1}
    assert not counts.denied
    assert not trace.pop().requests
