"""Lines of a router's log that are denied attempts, and lines that are not."""

import pkgutil
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.access.denied_operations import FLOOD_HZ, MAX_KEY, MAX_MESSAGES, RECENT_S, SLOWED, RecentDenials
from pointit.access.identity_load import INTERNAL_COST, REQUEST_COST
from pointit.access.rejected_connections import MAX_REASONS, MAX_SHOWN
from pointit.access.rights import LATEST_HZ, MAX_RATE_HZ
from pointit.access.zenoh_trace import KINDS
from pointit.schemas.problems import DENIED
from tests.unit.access.traced import TracedOperations

TARGET = "\x1b[2mzenoh::net::routing::interceptor::access_control\x1b[0m\x1b[2m:\x1b[0m "
HEAD = f"\x1b[2m2030-01-01T00:00:00Z\x1b[0m \x1b[35mTRACE\x1b[0m  rx-0 ThreadId(07) {TARGET}"
MEANWHILE_S = 0.5
"""For so long a thread may take a line that nothing keeps it from."""
ANNA = "12ab on Interface(lo)+CertCommonName(lab/anna/2)+Transport(Tls)+12ab"
THINNED = "Message dropped by the downsampling interceptor"
MANY = "lab/anna writes users/anna/{} times a second, more than anybody needs: end what does"


def sentences(*lines: str) -> list[str]:
    refused = TracedOperations()
    for line in lines:
        refused.take(line if line.startswith("\x1b") else HEAD + line)
    return list(refused.take_sentences(1.0).values())


AGAIN = "Using cached result: 12ab is"
LATE = "(ingress) on pointit/lab/users/ben/pose/@adv/pub/1/2/_"
WORKED_OUT = [f"{ANNA} is unauthorized to Put (ingress) on pointit/lab/map"] * KINDS
WORKS_OUT = ["ACL (ingress): caching permissions for `pointit/lab/map` ...", *WORKED_OUT]


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        pytest.param(
            [
                f"{ANNA} is unauthorized to Put (ingress) on pointit/lab/users/ben/imu",
                f"{AGAIN} unauthorized to Put (ingress) on pointit/lab/users/ben/imu",
                f"{AGAIN} unauthorized to Declare Subscriber (ingress) on pointit/lab/objects/*",
                f"{AGAIN} authorized to Put (ingress) on pointit/lab/users/anna/imu",
            ],
            ["lab/anna may not write users/ben/imu (2 times), read objects/*: refused"],
            id="attempts are counted by identity and key",
        ),
        pytest.param(
            [
                f"{ANNA} is authorized to Put (ingress) on pointit/lab/users/anna/imu",
                f"{ANNA.replace('lab/anna', 'lab/mallory')} is authorized to Put (ingress) on pointit/lab/x",
                f"{AGAIN} unauthorized to Put (ingress) on pointit/lab/map",
            ],
            ["lab/mallory may not write map: refused"],
            id="who takes the name of another's connection is named themselves",
        ),
        pytest.param(WORKS_OUT, [], id="what is worked out beforehand is no attempt"),
        pytest.param(
            [*WORKS_OUT, f"{ANNA} is unauthorized to Query (ingress) on pointit/lab/leds/brightness"],
            ["lab/anna may not ask leds/brightness: refused"],
            id="what follows is one",
        ),
        pytest.param(
            [
                f"{ANNA} is unauthorized to Undeclare Subscriber (ingress) on pointit/lab/users/ben/imu",
                f"{ANNA} is unauthorized to Put (egress) on pointit/lab/users/ben/imu",
            ],
            [],
            id="undeclaring and what goes out are no attempts",
        ),
        pytest.param(
            [
                f"{ANNA} is unauthorized to Put {LATE}",
                f"{ANNA} is unauthorized to Declare/Undeclare Queryable {LATE}",
                f"{ANNA} is unauthorized to Liveliness Query {LATE}",
            ],
            ["lab/anna may not write users/ben/pose (2 times), read users/ben/pose: refused"],
            id="what is kept for late joiners is of its key",
        ),
        pytest.param(
            [f"{ANNA} is unauthorized to Put (ingress) on pointit/lab/\u202e{'x' * 5000}"],
            [f"lab/anna may not write ?{'x' * (MAX_KEY - 1)}…: refused"],
            id="a key of any length and script is shown short",
        ),
        pytest.param(
            [f"{ANNA} is unauthorized to Put (ingress) on pointit/lab/users/ben/imu/@may/anna/writes"],
            ["lab/anna may not write users/ben/imu: refused"],
            id="a self-test is told by its key",
        ),
    ],
)
def test_attempts(lines: list[str], told: list[str]) -> None:
    assert sentences(*lines) == told


def test_operation_that_is_allowed_and_dropped_is_too_long() -> None:
    let_in = "Using cached result: 12ab is authorized to Put (ingress) on pointit/lab/users/anna/imu"
    known = f"{ANNA} is authorized to Put (ingress) on pointit/lab/users/anna/imu"
    dropped = HEAD.replace("::access_control", "") + "Msg intercepted!"
    thinned = HEAD.replace("access_control", "downsampling") + THINNED
    elsewhere = dropped.replace("ThreadId(07)", "ThreadId(08)")
    assert sentences(known, let_in, dropped) == [
        "lab/anna may not write such long messages to users/anna/imu: refused"
    ]
    assert sentences(known, let_in, thinned, dropped) == []
    assert sentences(known, let_in, elsewhere) == []
    assert sentences(dropped) == []

    self_test = known.replace("users/anna/imu", "users/anna/imu/@may/anna/writes")
    assert sentences(self_test, dropped) == [], "its reader has left"
    goes_out = (
        f"{ANNA.replace('lab/anna', 'lab/ben')} is authorized to Put (egress) on pointit/lab/users/anna/imu"
    )
    assert sentences(known, dropped, goes_out) == [], "one of its readers has left"
    assert len(sentences(known, dropped, known, goes_out)) == 1, "that is another message"


def test_dropped_message_is_not_too_long_when_lines_are_missing() -> None:
    let_in = f"{HEAD}{ANNA} is authorized to Put (ingress) on pointit/lab/users/anna/imu"
    denied = TracedOperations()
    denied.take(let_in)
    denied.take(let_in, 3000)
    dropped = HEAD.replace("::access_control", "") + "Msg intercepted!"
    denied.take(dropped)
    assert denied.take_sentences(10.0) == {}
    denied.take(let_in)
    denied.take(dropped)
    denied.take(let_in.replace("imu", "cursor"), 3000)  # the line on its further readers may be missing
    assert denied.take_sentences(10.0) == {}


def test_lines_with_a_count_are_counted_that_often() -> None:
    refused = TracedOperations()
    count = 7000
    write = f"{HEAD}{ANNA} is authorized to Put (ingress) on pointit/lab/users/anna/imu"
    refused.take(write)
    refused.take(f"{HEAD}{AGAIN} unauthorized to Put (ingress) on pointit/lab/map", count)
    refused.take(write, count)
    refused.take(HEAD.replace("::access_control", "") + "Msg intercepted!", count)  # after any other line
    (sentence,) = refused.take_sentences(1.0).values()
    assert (
        f"may not write map ({count} times): refused and writes users/anna/imu {count + 1} times" in sentence
    )
    assert "long" not in sentence
    assert (refused.denied.total, refused.sizes()) == (count, {"lab/anna": 2 * count + 1})


def test_identity_of_a_new_connection_is_reported_once_at_once() -> None:
    """Only the log names those of a site by passwords."""
    refused = TracedOperations()
    for connection in ("12ab", "12ab", "34cd"):
        user = f"{connection} on Interface(lo)+Username(lab/anna/2)+Transport(Tls)+{connection}"
        refused.take(f"{HEAD}{user} is authorized to Put (ingress) on pointit/lab/users/anna/imu")
    assert refused.known == 2
    assert refused.trace.common_name("34cd") == "lab/anna/2"


def test_identity_that_writes_too_often_is_named() -> None:
    let_in = f"{ANNA} is authorized to Put (ingress) on pointit/lab/users/anna/imu"
    assert sentences(*[let_in] * int(FLOOD_HZ)) == []
    cached = "Using cached result: 12ab is authorized to Put (ingress) on pointit/lab/users/anna/button"
    (told,) = sentences(let_in, *[cached] * int(FLOOD_HZ + 1))
    assert told == MANY.format("button 1001")


def test_queries_with_long_names_are_one_entry_and_all_counted() -> None:
    denied = TracedOperations()
    for number in range(300):
        key = f"pointit/lab/{'x' * 200}{number}"
        denied.take(f"{HEAD}{ANNA} is authorized to Query (ingress) on {key}")
    assert len(denied.trace._requests) == 1
    denied.take_sentences(1.0)
    assert denied.sizes() == {"lab/anna": 300.0 * REQUEST_COST}


@pytest.mark.parametrize(
    ("request_line", "cost"),
    [
        ("Declare/Undeclare Liveliness Token (ingress) on pointit/lab/alive/users/anna", REQUEST_COST),
        ("Declare Subscriber (ingress) on pointit/lab/users/anna/cursor", REQUEST_COST),
        ("Query (ingress) on pointit/lab/selector/history", REQUEST_COST),
        ("Query (ingress) on pointit/lab/users/anna/cursor/@adv/pub/1/2/_", INTERNAL_COST),
        ("Reply (ingress) on pointit/lab/selector/history", 0),
        ("Query (egress) on pointit/lab/selector/history", 0),
    ],
)
def test_questions_and_declarations_count_as_several_messages(request_line: str, cost: int) -> None:
    denied = TracedOperations()
    count = 200
    for _ in range(count):
        denied.take(f"{HEAD}{ANNA} is authorized to {request_line}")
    assert denied.take_sentences(1.0) == {}
    assert denied.sizes().get("lab/anna", 0.0) == cost * count
    denied.take_sentences(1.0)
    assert not denied.sizes()


def slowed(connection: str, key: str = "users/anna/claim", flow: str = "from") -> str:
    head = HEAD.replace("access_control", "downsampling")
    return f"{head}{THINNED}: Push(pointit/lab/{key}) {flow}:south:0:client/{connection}:1"


def test_writes_dropped_as_too_frequent_are_counted_and_named() -> None:
    name = "12ab34cd" * 4
    known = f"{ANNA.replace('12ab', name)} is authorized to Put (ingress) on pointit/lab/users/anna/claim"
    refused = TracedOperations()
    for line in (HEAD + known, *[slowed("12ab34cd")] * int(SLOWED * MAX_RATE_HZ)):
        refused.take(line)
    (told,) = refused.take_sentences(1.0).values()
    assert told == MANY.format("claim 201")
    assert refused.sizes() == {"lab/anna": 201.0}
    assert refused.take_sentences(1.0) == {}
    burst = [slowed("12ab34cd")] * int(SLOWED * MAX_RATE_HZ - 1)
    assert sentences(known, *burst) == [], "of a burst, some is fetched again"
    stalled = [slowed("12ab34cd", "users/anna/imu")] * int(SLOWED * LATEST_HZ)
    assert sentences(known, *stalled) == [], "a wrist behind a link that stalls and goes on"
    assert sentences(known, *[slowed("12ab34cd", flow="to")] * 5000) == [], "a dashboard's"


def test_questions_that_are_dropped_as_too_frequent_count_as_questions() -> None:
    name = "12ab34cd" * 4
    known = f"{ANNA.replace('12ab', name)} is authorized to Query (ingress) on pointit/lab/selector/history"
    refused = TracedOperations()
    for line in (HEAD + known, *[slowed("12ab34cd", "selector/history").replace("Push", "Request")] * 9):
        refused.take(line)
    assert refused.take_sentences(1.0) == {}
    assert refused.sizes() == {"lab/anna": 10.0 * REQUEST_COST}


def test_attempts_that_are_dropped_as_too_frequent_count() -> None:
    claim = "users/ben/claim"
    denied = f"{HEAD}{ANNA} is unauthorized to Put (ingress) on pointit/lab/{claim}"
    refused = TracedOperations()
    for line in (denied, *[slowed("12ab", claim)] * 200):
        refused.take(line)
    assert refused.take_sentences(1.0) == {"lab/anna": f"lab/anna may not write {claim} (201 times): refused"}
    assert refused.denied.total == 201


def test_denials_of_revoked_certificates_hide_none_of_valid_ones() -> None:
    former = ANNA
    valid = ANNA.replace("12ab", "34cd").replace("anna/2", "anna/3")
    refused = TracedOperations()
    for who, key in ((former, "users/anna/imu"), (valid, "map")):
        refused.take(f"{HEAD}{who} is unauthorized to Put (ingress) on pointit/lab/{key}")
    assert refused.take_sentences(1.0, {"lab/anna/2"}) == {"lab/anna": "lab/anna may not write map: refused"}
    assert refused.denied.revoked.keys() == {"lab/anna"}
    assert "may not write users/anna/imu: refused, as it was revoked" in refused.denied.revoked["lab/anna"]

    refused.take(f"{HEAD}{valid} is unauthorized to Put (ingress) on pointit/lab/map")
    assert refused.take_sentences(1.0, {"lab/anna/2"}) == {"lab/anna": "lab/anna may not write map: refused"}
    assert refused.denied.revoked == {}, "the former one was connected, and does nothing now"


def test_ambiguous_start_of_a_connection_is_resolved_by_other_decisions() -> None:
    verdict = "is authorized to Put (ingress) on pointit/lab/users/anna/claim"
    known = [
        f"{ANNA.replace('12ab', connection)} {verdict}".replace("anna", person)
        for person, connection in (("anna", "12ab34cd56"), ("ben", "12ab34cd78"))
    ]
    denied = known[0].replace("is authorized", "is unauthorized").replace("users/anna", "users/ben")
    own = [slowed("12ab34cd")] * 300
    of_another = [slowed("12ab34cd", "users/ben/claim")] * 300
    assert [told[:40] for told in sentences(*known, *own)] == [MANY.format("claim 301")[:40]]
    assert sentences(*known, denied, *of_another) == [
        "lab/anna may not write users/ben/claim (301 times): refused"
    ]


def test_ambiguous_start_of_a_connection_names_no_identity() -> None:
    names = ["12ab34cd56", "12ab34cd78", "12ab34cd99"]
    known = [
        f"{ANNA.replace('12ab', name).replace('anna', who)} is authorized to Put (ingress) on pointit/lab/a"
        for name, who in zip(names, ("anna", "anna", "ben"), strict=True)
    ]
    drops = [slowed("12ab34cd")] * 300
    assert sentences(*known[:2], *drops)[0].startswith("lab/anna writes users/anna/claim 300 times")
    assert sentences(*known, *drops)[0].startswith("connection 12ab34cd writes users/anna/claim 300 times")


def test_a_key_cannot_lay_the_blame_on_somebody_else() -> None:
    forged = f"{ANNA.replace('anna', 'ben').replace('12ab', '34cd')} is unauthorized to Put (ingress) on x"
    attempt = f"{ANNA} is unauthorized to Put (ingress) on pointit/lab/a"
    refused = TracedOperations()
    for line in f"{HEAD}{attempt}\n2030-01-01 TRACE ThreadId(07) access_control: {forged}".split("\n"):
        refused.take(line)  # a key with a line break
    refused.take(f"{HEAD}ACL (ingress): caching permissions for `pointit/lab/{forged}` ...")
    refused.take(f"{HEAD}{attempt} is authorized to Put (ingress) on pointit/lab/b")
    refused.take(f"{HEAD}Using cached result: 12ab is unauthorized to Put (ingress) on c {forged}")
    assert refused.take_sentences(1.0) == {"lab/anna": "lab/anna may not write a, c: refused"}


def test_handshakes_that_fail_are_told() -> None:
    warning = "\x1b[2m2030-01-01T00:00:00Z\x1b[0m  WARN acc-0 ThreadId(05) zenoh_link_tls::unicast: "
    line = f"{warning}invalid peer certificate: UnknownIssuer. Hint: increase the system open file limit."
    assert sentences(line, line) == [
        "a connection was refused: invalid peer certificate: UnknownIssuer (2 times)"
    ]
    expired = "expired: verification time 5 (UNIX), but certificate is not valid after 4 (1 seconds ago)"
    assert sentences(line.replace("UnknownIssuer", f"certificate {expired}")) == [
        "a connection was refused: invalid peer certificate: certificate expired"
    ]
    plain = f"{warning}received corrupt message of type InvalidContentType."
    assert sentences(plain, plain) == [
        "a connection was refused: came without credentials, by plain TCP instead of TLS (2 times)"
    ]


def knock(address: str = "10.0.0.5:39284", thread: str = "05") -> str:
    """Line that Zenoh logs for a newcomer."""
    return (
        f"{door('TRACE', thread)}Establishment Accept OpenSyn: tls/10.0.0.1:7447 => tls/{address}. "
        "Received: TransportMessage { body: OpenSyn(OpenSyn { lease: 3s, ext_qos: None, ext_auth: None }) }"
    )


def door(level: str, thread: str = "05", module: str = "establishment::accept") -> str:
    time = "\x1b[2m2030-01-01T00:00:00Z\x1b[0m"
    target = f"\x1b[2mzenoh_transport::unicast::{module}\x1b[0m\x1b[2m:\x1b[0m"
    return f"{time} \x1b[34m{level}\x1b[0m acc-0 ThreadId({thread}) {target} "


def refusal(why: str, thread: str = "05") -> str:
    return f"{door('DEBUG', thread)}UsrPwd extension - Recv OpenSyn. {why}. at /root/usrpwd.rs:424."


def test_rejected_password_is_reported_with_the_address() -> None:
    wrong = refusal("Invalid password")
    unknown = refusal("Invalid user")
    link = "tls/10.0.0.1:7447 => quic/[fd00::5]:1"
    bare = f"{door('TRACE')}Establishment Accept InitSyn: {link}. Received: T {{}}"
    assert sentences(knock(), wrong, knock(), wrong) == [
        "a connection was refused: a wrong password from 10.0.0.5 (2 times)"
    ]
    assert sentences(knock(), unknown) == [
        "a connection was refused: an unknown or former password from 10.0.0.5"
    ]
    assert sentences(bare, refusal("Expected extension")) == [
        "a connection was refused: came without a password from [fd00::5]"
    ]


def test_rejection_is_not_attributed_to_an_accepted_connection() -> None:
    """Newcomers are told apart by threads, and one reason is of one of them."""
    wrong = refusal("Invalid password")
    assert sentences(knock(), knock("10.0.0.6:1", thread="06"), wrong, wrong) == [
        "a connection was refused: a wrong password from 10.0.0.5, a wrong password"
    ]
    assert sentences(knock(), f"{door('DEBUG')}New transport link accepted from 12 to 34") == []


def test_text_of_an_unknown_peer_is_no_log_line() -> None:
    for forged in (
        f"{ANNA} is unauthorized to Put (ingress) on pointit/lab/map",
        "zenoh_transport::unicast::manager: Failed to accept link before deadline (3000ms)",
        "WARN acc-0 ThreadId(05) zenoh_link_tls::unicast: invalid peer certificate: UnknownIssuer.",
        "ThreadId(05) zenoh_transport::unicast::establishment::accept: UsrPwd extension - Recv x. Invalid.",
    ):
        assert sentences(f"{door('TRACE')}Establishment Accept InitSyn: {forged}") == []
        assert sentences(f"{HEAD}Something of {forged}") == []


def test_peer_without_zenoh_behind_tls_is_reported() -> None:
    link = "tls/10.0.0.1:7447 => tls/10.0.0.5:3926:TransportLinkUnicastConfig { direction: Inbound }"
    (told,) = sentences(
        f"{door('DEBUG')}Decode error on link: {link} at /root/link.rs:1.",
        f"{door('DEBUG')}Read error from link: {link}. Invalid batch length or buffer at /root/link.rs:1.",
        f"{door('DEBUG', module='manager')}Failed to accept link before deadline (3000ms)",
    )
    assert told == (
        "a connection was refused: came by TLS and spoke no Zenoh from 10.0.0.5 (2 times), "
        "came by TLS and said nothing"
    )


def test_many_strangers_are_one_sentence() -> None:
    lines = [
        line
        for number in range(MAX_REASONS + 50)
        for line in (knock(f"10.0.{number // 256}.{number % 256}:1"), refusal("Invalid user"))
    ]
    (told,) = sentences(*lines)
    assert told.endswith(f" and {MAX_REASONS - MAX_SHOWN} more")
    assert told.count("10.0.") == MAX_SHOWN


def test_a_flood_is_one_sentence_and_forgotten() -> None:
    refused = TracedOperations()
    for number in range(5000):
        refused.take(f"{HEAD}{ANNA} is unauthorized to Put (ingress) on pointit/lab/x{number}")
    (sentence,) = refused.take_sentences(1.0).values()
    assert refused.denied.total == 5000
    assert sentence == "lab/anna may not write x0, x1, x2 and 997 more: refused"
    assert len(sentence) < 200
    assert refused.take_sentences(1.0) == {}


@pytest.mark.parametrize(
    "during",
    ["pointit.access.denied_operations._listed", "pointit.access.denied_operations.rejection_summary"],
)
def test_operations_during_a_report_are_in_the_next_one(during: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The log is read in a thread of its own."""
    refused = TracedOperations()
    attempt = f"{HEAD}{ANNA} is unauthorized to Put (ingress) on pointit/lab/map"
    another = attempt.replace("lab/anna", "lab/ben").replace("12ab", "34cd")
    taking = threading.Thread(target=refused.take, args=(another,))
    original = pkgutil.resolve_name(during)

    def interrupted(*arguments: object) -> object:
        if taking.ident is None:
            taking.start()
            taking.join(MEANWHILE_S)
        return original(*arguments)

    monkeypatch.setattr(during, interrupted)
    refused.take(attempt)
    assert refused.take_sentences(1.0) == {"lab/anna": "lab/anna may not write map: refused"}
    taking.join()
    assert refused.take_sentences(1.0) == {"lab/ben": "lab/ben may not write map: refused"}


@given(st.lists(st.text()))
def test_any_line_is_taken(lines: list[str]) -> None:
    refused = TracedOperations()
    for line in lines:
        refused.take(line)
        refused.take(HEAD + line)
        refused.take(door("TRACE") + line)
    refused.take_sentences(1.0)


def shown_to(recent: RecentDenials, site: str) -> tuple[str, ...]:
    return tuple(each.sentence for each in recent.of(site))


def test_newest_denial_of_each_identity_is_shown_for_a_while() -> None:
    recent = RecentDenials()
    recent.add({"lab/anna": "lab/anna may not a", "hall/ben": "hall/ben may not b"}, 0.0)
    recent.add({"": "somebody", "lab/carla": "lab/carla may not c"}, 1.0)
    recent.add({"lab/anna": "lab/anna may not d"}, 2.0)
    assert shown_to(recent, "lab") == ("lab/anna may not d", "lab/carla may not c", "somebody")
    assert shown_to(recent, "hall") == ("somebody", "hall/ben may not b")
    recent.add({}, 1.5 + RECENT_S)
    assert shown_to(recent, "lab") == ("lab/anna may not d",)
    recent.add({f"lab/x{number}": "x" for number in range(100)}, 40.0)
    assert len(recent.of("lab")) == MAX_MESSAGES
    assert {(each.code, each.subject[:1]) for each in recent.of("lab")} == {(DENIED, "x")}


def test_a_repeated_sentence_hides_none_of_another_kind() -> None:
    recent = RecentDenials()
    recent.add({"lab/anna": "lab/anna may not a"}, 0.0, "refused")
    for now_s in range(3):
        recent.add({"lab/anna": "lab/anna is cut off"}, now_s, "excess")
    assert shown_to(recent, "lab") == ("lab/anna is cut off", "lab/anna may not a")
