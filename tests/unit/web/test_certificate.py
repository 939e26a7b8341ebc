"""The certificate that is made on demand: kept, covered, secret, renewed."""

import datetime as dt
import hashlib
import os
import ssl
import stat
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtensionOID

from pointit.bridges.web.server.certificate import LEFT, VALID, Certificate, obtain
from pointit.runtime.errors import ConfigError

NOW = dt.datetime(2030, 1, 1, tzinfo=dt.UTC)
HERE = ["192.168.1.20", "fd00::5"]


def made(folder: Path, addresses: list[str] | None = None, now: dt.datetime = NOW) -> Certificate:
    return obtain(folder, HERE if addresses is None else addresses, "bench.example", now)


def parsed(found: Certificate) -> x509.Certificate:
    return x509.load_pem_x509_certificate(found.certificate.read_bytes())


def test_it_names_this_machine_and_is_taken_by_browsers(tmp_path: Path) -> None:
    certificate = parsed(made(tmp_path / "web"))
    other = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert set(other.get_values_for_type(x509.DNSName)) == {"localhost", "bench.local"}
    addresses = {str(address) for address in other.get_values_for_type(x509.IPAddress)}
    assert addresses == {"127.0.0.1", "::1", *HERE}
    assert certificate.not_valid_after_utc - certificate.not_valid_before_utc <= dt.timedelta(days=397)
    assert certificate.not_valid_before_utc <= NOW - dt.timedelta(minutes=30)


def test_the_fingerprint_is_what_browsers_show(tmp_path: Path) -> None:
    found = made(tmp_path)
    digest = hashlib.sha256(ssl.PEM_cert_to_DER_cert(found.certificate.read_text())).hexdigest().upper()
    assert found.fingerprint.replace(":", "") == digest
    assert found.fingerprint.count(":") == 31


def test_the_key_is_its_owners_alone_from_the_beginning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    modes: list[int] = []
    chmod = Path.chmod

    def seen(path: Path, mode: int) -> None:
        modes.append(stat.S_IMODE(path.stat().st_mode))
        chmod(path, mode)

    monkeypatch.setattr(Path, "chmod", seen)
    umask = os.umask(0)
    try:
        found = made(tmp_path / "web")
    finally:
        os.umask(umask)
    assert modes == [0o600, 0o600]
    assert stat.S_IMODE(found.key.stat().st_mode) == 0o600
    assert sorted(path.name for path in (tmp_path / "web").iterdir()) == ["certificate.pem", "key.pem"]


def test_what_is_kept_is_used_while_it_covers_and_lasts(tmp_path: Path) -> None:
    first = made(tmp_path)
    assert made(tmp_path) == first
    assert made(tmp_path, HERE[:1]) == first
    assert made(tmp_path, now=NOW + VALID - LEFT - dt.timedelta(hours=2)) == first
    wider = made(tmp_path, [*HERE, "10.0.0.7"])
    assert wider.fingerprint != first.fingerprint
    assert wider.warning == ""
    aged = made(tmp_path, [*HERE, "10.0.0.7"], now=NOW + VALID - LEFT + dt.timedelta(hours=2))
    assert aged.fingerprint != wider.fingerprint
    assert made(tmp_path, now=NOW - dt.timedelta(days=30)).fingerprint != aged.fingerprint


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("certificate.pem", b"-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n"),
        ("certificate.pem", b"\xff\x00"),
        ("key.pem", b"no key"),
        ("key.pem", b""),
    ],
)
def test_a_damaged_file_is_made_anew_and_said(tmp_path: Path, name: str, content: bytes) -> None:
    first = made(tmp_path)
    (tmp_path / name).write_bytes(content)
    again = made(tmp_path)
    assert again.fingerprint != first.fingerprint
    assert str(tmp_path) in again.warning
    assert made(tmp_path).warning == ""


def test_what_only_openssl_finds_is_damage_too(tmp_path: Path) -> None:
    first = made(tmp_path)
    with first.certificate.open("ab") as file:
        file.write(b"-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n")
    again = made(tmp_path)
    assert "damaged" in again.warning
    ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(again.certificate, again.key)


def test_names_that_cannot_be_read_are_damage_too(tmp_path: Path) -> None:
    first = made(tmp_path)
    key = serialization.load_pem_private_key(first.key.read_bytes(), None)
    assert isinstance(key, ec.EllipticCurvePrivateKey)
    name = x509.Name([])
    spoiled = (
        x509.CertificateBuilder(name, name, key.public_key(), 1, NOW, NOW + VALID)
        .add_extension(
            x509.UnrecognizedExtension(ExtensionOID.SUBJECT_ALTERNATIVE_NAME, b"\5\0"), critical=False
        )
        .sign(key, hashes.SHA256())
    )
    first.certificate.write_bytes(spoiled.public_bytes(serialization.Encoding.PEM))
    assert "damaged" in made(tmp_path).warning


@pytest.mark.skipif(os.name != "posix", reason="pipes in the file system are POSIX's")
def test_a_pipe_in_its_place_is_not_waited_for(tmp_path: Path) -> None:
    first = made(tmp_path)
    first.certificate.unlink()
    os.mkfifo(first.certificate)
    assert made(tmp_path).warning != ""
    assert first.certificate.is_file()


def test_another_ones_key_or_one_that_others_read_is_not_used(tmp_path: Path) -> None:
    first, other = made(tmp_path / "a"), made(tmp_path / "b")
    first.key.write_bytes(other.key.read_bytes())
    second = made(tmp_path / "a")
    assert second.warning != ""
    second.key.chmod(0o644)
    third = made(tmp_path / "a")
    assert "others" not in first.warning
    assert third.warning != ""
    assert third.fingerprint != second.fingerprint


def test_where_it_cannot_be_kept_one_sentence_says_so(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match=r"file.*cannot be written"):
        made(tmp_path / "file" / "web")


@pytest.mark.parametrize("host", ["", "größe", "x" * 80, "a b"])
def test_a_host_that_is_no_name_is_left_out(tmp_path: Path, host: str) -> None:
    found = parsed(obtain(tmp_path, [], host, NOW))
    other = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert other.get_values_for_type(x509.DNSName) == ["localhost"]
