"""Access for viewing and for control; the certificate that is made on demand."""

import datetime as dt
import stat
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtensionOID

from pointit.bridges.web.server import access
from pointit.bridges.web.server.access import GUESSES_S, MAX_ADDRESSES, MAX_GUESSES, Access, RequestInfo
from pointit.bridges.web.server.certificate import LEFT, VALID, Certificate, obtain
from pointit.runtime.errors import ConfigError

OPERATOR, VIEWER = "operator token; with = and ü", "viewer-token"


def asked(**fields: Any) -> RequestInfo:
    usual: dict[str, Any] = {"scheme": "http", "host": "127.0.0.1:8090", "address": "127.0.0.1"}
    return RequestInfo(**(usual | fields))


HERE = asked()


@pytest.fixture
def doors() -> Access:
    return Access(OPERATOR, VIEWER)


def with_cookie(token: str) -> RequestInfo:
    return asked(cookies={access.cookie_name(HERE): access.cookie_value(token)})


@pytest.mark.parametrize(
    ("token", "role"), [(OPERATOR, "operator"), (VIEWER, "viewer"), ("else", None), ("", None)]
)
def test_token_and_its_cookie_give_the_same_role(doors: Access, token: str, role: str | None) -> None:
    assert doors.enter(token, HERE, 0.0) == role
    assert doors.admit(with_cookie(token), 0.0) == role


def test_missing_cookie_gives_no_role_and_is_no_guess(doors: Access) -> None:
    for _ in range(2 * MAX_GUESSES):
        assert doors.admit(HERE, 0.0) is None
    assert not doors.is_rate_limited("127.0.0.1", 0.0)


def test_right_token_enters_after_any_number_of_guesses(doors: Access) -> None:
    for guess in range(10 * MAX_GUESSES):
        assert doors.enter(f"guess {guess}", HERE, 0.0) is None
    assert doors.is_rate_limited("127.0.0.1", 0.0)
    assert doors.enter(OPERATOR, HERE, 0.0) == "operator"
    assert doors.admit(with_cookie(VIEWER), 0.0) == "viewer"
    assert doors.enter("wrong", HERE, 0.0) is None
    assert not doors.is_rate_limited("10.0.0.7", 0.0)
    assert len(doors._guesses["127.0.0.1"]) == MAX_GUESSES
    assert not doors.is_rate_limited("127.0.0.1", GUESSES_S + 0.1)


def test_repeated_old_cookie_counts_as_one_guess(doors: Access) -> None:
    for second in range(100):
        assert doors.admit(with_cookie("of the run before"), float(second)) is None
        assert not doors.is_rate_limited("127.0.0.1", float(second))


@pytest.mark.parametrize("destination", ["image", "iframe", "script", "empty"])
def test_embedded_page_cannot_guess_tokens(doors: Access, destination: str) -> None:
    embedded = asked(destination=destination)
    for guess in range(2 * MAX_GUESSES):
        assert doors.enter(f"guess {guess}", embedded, 0.0) is None
    assert doors.enter(OPERATOR, embedded, 0.0) is None
    assert doors.enter(OPERATOR, asked(destination="document"), 0.0) == "operator"


def test_number_of_remembered_addresses_is_bounded(doors: Access) -> None:
    for number in range(2 * MAX_ADDRESSES):
        doors.enter("wrong", asked(address=f"10.0.{number // 256}.{number % 256}"), 0.0)
    assert len(doors._guesses) <= MAX_ADDRESSES


@pytest.mark.parametrize(
    ("host", "known"),
    [
        ("127.0.0.1:8090", True),
        ("LOCALHOST", True),
        ("[::1]:8090", True),
        ("localhost:9000", True),  # an ssh tunnel
        ("192.168.1.20:8443", True),
        ("[fd00::1]:8443", True),
        ("evil.example:8090", False),
        ("127.0.0.1.evil.example:8090", False),
        ("192.168.1.21:8443", False),
        ("", False),
        ("[::1", False),
        ("user@localhost", False),
    ],
)
def test_host_is_known_only_when_it_names_this_server(doors: Access, host: str, known: bool) -> None:
    doors.know_hosts(["192.168.1.20", "fd00::1"])
    assert doors.is_known_host(host) == known


@pytest.mark.parametrize(
    ("scheme", "host", "origin", "own"),
    [
        ("http", "127.0.0.1:8090", "http://127.0.0.1:8090", True),
        ("https", "10.0.0.7:8443", "https://10.0.0.7:8443", True),
        ("http", "127.0.0.1:8090", "", False),
        ("http", "127.0.0.1:8090", "null", False),
        ("http", "127.0.0.1:8090", "http://127.0.0.1:9000", False),
        ("http", "127.0.0.1:8090", "http://localhost:8090", False),
        ("http", "127.0.0.1:8090", "https://127.0.0.1:8090", False),
        ("https", "127.0.0.1:8090", "http://127.0.0.1:8090", False),
        ("http", "127.0.0.1:8090", "http://127.0.0.1:8090.evil.example", False),
    ],
)
def test_origin_is_own_only_when_scheme_and_host_match(
    doors: Access, scheme: str, host: str, origin: str, own: bool
) -> None:
    assert doors.is_own_origin(asked(scheme=scheme, host=host, origin=origin)) == own


def test_cookie_is_strict_and_holds_no_token() -> None:
    cookie = access.cookie(HERE, OPERATOR)
    assert "; HttpOnly; SameSite=Strict" in cookie
    assert "Secure" not in cookie
    assert OPERATOR not in cookie
    assert access.cookie(asked(scheme="https"), OPERATOR).endswith("; Secure")


def test_cookies_of_two_servers_on_one_host_do_not_clash() -> None:
    names = {
        access.cookie_name(asked(scheme=scheme, host=host))
        for scheme in ("http", "https")
        for host in ("localhost:8090", "localhost:8091", "localhost")
    }
    assert len(names) == 6
    assert all(name.replace("-", "").isalnum() for name in names)


def test_headers_allow_no_foreign_content() -> None:
    headers = access.headers(asked(scheme="https", host="10.0.0.7:8443"))
    policy = dict(part.split(" ", 1) for part in headers["Content-Security-Policy"].split("; "))
    assert policy["default-src"] == policy["frame-ancestors"] == policy["base-uri"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == "'self'"
    assert policy["connect-src"] == "'self' wss://10.0.0.7:8443"
    assert "unsafe" not in headers["Content-Security-Policy"]
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert "gyroscope=(self)" in headers["Permissions-Policy"]


NOW = dt.datetime(2030, 1, 1, tzinfo=dt.UTC)
ADDRESSES = ["192.168.1.20", "fd00::5"]


def made(folder: Path, addresses: list[str] | None = None, now: dt.datetime = NOW) -> Certificate:
    return obtain(folder, ADDRESSES if addresses is None else addresses, "bench.example", now)


def parsed(found: Certificate) -> x509.Certificate:
    return x509.load_pem_x509_certificate(found.certificate.read_bytes())


def test_certificate_names_this_machine_and_is_valid_for_browsers(tmp_path: Path) -> None:
    files = made(tmp_path / "web")
    assert stat.S_IMODE(files.key.stat().st_mode) == 0o600
    certificate = parsed(files)
    other = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert set(other.get_values_for_type(x509.DNSName)) == {"localhost", "bench.local"}
    addresses = {str(address) for address in other.get_values_for_type(x509.IPAddress)}
    assert addresses == {"127.0.0.1", "::1", *ADDRESSES}
    assert certificate.not_valid_after_utc - certificate.not_valid_before_utc <= dt.timedelta(days=397)
    assert certificate.not_valid_before_utc <= NOW - dt.timedelta(minutes=30)


def test_stored_certificate_is_used_while_it_covers_and_lasts(tmp_path: Path) -> None:
    first = made(tmp_path)
    assert made(tmp_path) == first
    assert made(tmp_path, ADDRESSES[:1]) == first
    assert made(tmp_path, now=NOW + VALID - LEFT - dt.timedelta(hours=2)) == first
    wider = made(tmp_path, [*ADDRESSES, "10.0.0.7"])
    assert wider.fingerprint != first.fingerprint
    assert wider.warning == ""
    aged = made(tmp_path, [*ADDRESSES, "10.0.0.7"], now=NOW + VALID - LEFT + dt.timedelta(hours=2))
    assert aged.fingerprint != wider.fingerprint
    assert made(tmp_path, now=NOW - dt.timedelta(days=30)).fingerprint != aged.fingerprint


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("certificate.pem", b"-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n"),
        ("key.pem", b""),
    ],
)
def test_damaged_certificate_is_replaced_with_a_warning(tmp_path: Path, name: str, content: bytes) -> None:
    first = made(tmp_path)
    (tmp_path / name).write_bytes(content)
    again = made(tmp_path)
    assert again.fingerprint != first.fingerprint
    assert str(tmp_path) in again.warning
    assert made(tmp_path).warning == ""


def test_certificate_is_damaged_when_its_names_cannot_be_read(tmp_path: Path) -> None:
    first = made(tmp_path)
    key = serialization.load_pem_private_key(first.key.read_bytes(), None)
    assert isinstance(key, ec.EllipticCurvePrivateKey)
    name = x509.Name([])
    builder = x509.CertificateBuilder(name, name, key.public_key(), 1, NOW, NOW + VALID)
    unreadable = x509.UnrecognizedExtension(ExtensionOID.SUBJECT_ALTERNATIVE_NAME, b"\5\0")
    spoiled = builder.add_extension(unreadable, critical=False).sign(key, hashes.SHA256())
    first.certificate.write_bytes(spoiled.public_bytes(serialization.Encoding.PEM))
    assert "damaged" in made(tmp_path).warning


def test_foreign_key_or_one_readable_by_others_is_not_used(tmp_path: Path) -> None:
    first = made(tmp_path / "a")
    other = made(tmp_path / "b")
    first.key.write_bytes(other.key.read_bytes())
    second = made(tmp_path / "a")
    assert second.warning != ""
    second.key.chmod(0o644)
    third = made(tmp_path / "a")
    assert "others" not in first.warning
    assert third.warning != ""
    assert third.fingerprint != second.fingerprint


def test_unstorable_certificate_is_an_error_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match=r"file.*cannot be written"):
        made(tmp_path / "file" / "web")


@pytest.mark.parametrize("host", ["", "größe", "x" * 80, "a b"])
def test_host_that_is_no_name_is_omitted_from_the_certificate(tmp_path: Path, host: str) -> None:
    found = parsed(obtain(tmp_path, [], host, NOW))
    other = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert other.get_values_for_type(x509.DNSName) == ["localhost"]
