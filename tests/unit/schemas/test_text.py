"""Numbers and lists of names in sentences."""

import socket
import ssl
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas.text import all_of, few_of, first_of, first_problem, round_beyond, system_reason


@pytest.mark.parametrize(
    ("value", "limit", "digits", "text"),
    [
        (0.52, 0.5, 1, "0.6"),
        (0.6003, 0.5, 1, "0.6"),
        (0.02, 0.0, 1, "0.1"),
        (1.96, 2.0, 1, "1.9"),
        (-0.04, 0.0, 1, "-0.1"),
        (44.6, 45.0, 0, "44"),
        (float("inf"), 0.5, 1, "inf"),
        (float("nan"), 0.5, 1, "nan"),
    ],
)
def test_number_is_rounded_away_from_its_limit(value: float, limit: float, digits: int, text: str) -> None:
    assert round_beyond(value, limit, digits) == text


@given(
    value=st.floats(-1e6, 1e6), limit=st.decimals(-1000, 1000, places=1).map(float), digits=st.integers(1, 3)
)
def test_stated_comparison_stays_true(value: float, limit: float, digits: int) -> None:
    shown = float(round_beyond(value, limit, digits))
    assert shown >= limit if value > limit else shown <= limit
    assert abs(shown - value) <= 1.001 * 10**-digits
    assert shown != limit or value == limit


@pytest.mark.parametrize(
    ("names", "all_names", "few", "first_two"),
    [
        ("", "", "", ""),
        ("a", "a", "a", "a"),
        ("ab", "a and b", "a and b", "a, b"),
        ("abcd", "a, b, c and d", "a, b, c and d", "a, b and 2 more"),
        ("abcdef", "a, b, c, d, e and f", "a, b, c and 3 more", "a, b and 4 more"),
    ],
)
def test_names_are_listed_in_words(names: str, all_names: str, few: str, first_two: str) -> None:
    assert all_of(names) == all_names
    assert few_of(names) == few
    assert first_of(names, 2) == first_two


@pytest.mark.parametrize(
    ("problems", "text"),
    [([], ""), (["it is dark"], "it is dark"), (["it is dark", "b", "c"], "it is dark (2 more)")],
)
def test_first_problem_counts_the_others(problems: list[str], text: str) -> None:
    assert first_problem(problems) == text


def test_reason_of_the_system_has_no_error_number() -> None:
    assert (
        system_reason(ConnectionRefusedError(111, "Connect call failed ('127.0.0.1', 9)"))
        == "connection refused"
    )
    both = OSError("Multiple exceptions: [Errno 111] Connect call failed, [Errno 101] unreachable")
    assert system_reason(both) == "Multiple exceptions: Connect call failed, unreachable"
    assert system_reason(TimeoutError()) == "no answer"


def test_reason_of_a_name_or_of_tls_is_their_own(tmp_path: Path) -> None:
    assert (
        system_reason(socket.gaierror(8, "nodename nor servname provided"))
        == "nodename nor servname provided"
    )
    closed = ssl.SSLEOFError(8, "EOF occurred in violation of protocol (_ssl.c:1007)")
    assert system_reason(closed) == "EOF occurred in violation of protocol"

    certificates = tmp_path / "ca.pem"
    certificates.write_text("no certificate")
    with pytest.raises(ssl.SSLError) as raised:
        ssl.create_default_context(cafile=certificates)
    assert system_reason(raised.value) == "no certificate or crl found"
