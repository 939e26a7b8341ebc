"""What a router's log says of attempts, and what of it is none."""

from hypothesis import given
from hypothesis import strategies as st

from pointit.access.refused import KINDS, Refused

HEAD = "\x1b[2m2030-01-01T00:00:00Z\x1b[0m TRACE rx-0 ThreadId(07) zenoh::net::interceptor::access_control: "
ANNA = "12ab on Interface(lo)+CertCommonName(lab/anna/2)+Transport(Tls)+12ab"


def sentences(*lines: str) -> list[str]:
    refused = Refused()
    for line in lines:
        refused.take(line if line.startswith("20") else HEAD + line)
    return refused.take_sentences()


def test_attempts_are_counted_by_identity_and_key() -> None:
    assert sentences(
        f"{ANNA} is unauthorized to Put (ingress) on pointit/lab/users/ben/imu",
        "Using cached result: 12ab is unauthorized to Put (ingress) on pointit/lab/users/ben/imu",
        "Using cached result: 12ab is unauthorized to Declare Subscriber (ingress) on pointit/lab/objects/*",
        "Using cached result: 12ab is authorized to Put (ingress) on pointit/lab/users/anna/imu",
    ) == ["lab/anna may not write users/ben/imu (2 times), read objects/*: refused"]


def test_what_is_worked_out_beforehand_is_no_attempt() -> None:
    worked_out = [f"{ANNA} is unauthorized to Put (ingress) on pointit/lab/map"] * KINDS
    attempt = f"{ANNA} is unauthorized to Query (ingress) on pointit/lab/leds/brightness"
    lines = ["ACL (ingress): caching permissions for `pointit/lab/map` ...", *worked_out]
    assert sentences(*lines) == []
    assert sentences(*lines, attempt) == ["lab/anna may not ask leds/brightness: refused"]


def test_undeclaring_and_what_goes_with_a_key_are_no_attempts() -> None:
    assert (
        sentences(
            f"{ANNA} is unauthorized to Undeclare Subscriber (ingress) on pointit/lab/users/ben/imu",
            f"{ANNA} is unauthorized to Liveliness Query (ingress) on pointit/lab/users/ben/pose/@adv/pub/**",
            f"{ANNA} is unauthorized to Put (egress) on pointit/lab/users/ben/imu",
        )
        == []
    )


def test_a_self_test_is_told_by_its_key() -> None:
    assert sentences(
        f"{ANNA} is unauthorized to Put (ingress) on pointit/lab/users/ben/imu/@may/anna/writes"
    ) == ["lab/anna may not write users/ben/imu: refused"]


def test_handshakes_that_fail_are_told() -> None:
    line = (
        "2030-01-01T00:00:00Z  WARN acc-0 ThreadId(05) zenoh_link_tls::unicast: invalid peer certificate: "
        "UnknownIssuer. Hint: increase the system open file limit."
    )
    assert sentences(line, line) == [
        "somebody was not let in (2 times): invalid peer certificate: UnknownIssuer"
    ]


def test_a_flood_is_one_sentence_and_forgotten() -> None:
    refused = Refused()
    for number in range(5000):
        refused.take(f"{HEAD}{ANNA} is unauthorized to Put (ingress) on pointit/lab/x{number}")
    (sentence,) = refused.take_sentences()
    assert sentence.endswith(" more: refused")
    assert len(sentence) < 200
    assert refused.take_sentences() == []


@given(st.lists(st.text()))
def test_any_line_is_taken(lines: list[str]) -> None:
    refused = Refused()
    for line in lines:
        refused.take(line)
        refused.take(HEAD + line)
    refused.take_sentences()
