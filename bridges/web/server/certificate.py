"""The page's certificate in the local network: made on demand, stored, renewed in time.

Phones give a page no sensors without TLS. It is self-signed, so browsers warn. Its fingerprint is shown
beside the QR code for comparison.

No core: it writes files.
"""

import datetime as dt
import ipaddress
import os
import ssl
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from pointit.runtime.host.state_file import write_atomically
from pointit.schemas.text import system_reason

VALID = dt.timedelta(days=397)
"""Validity; browsers reject longer ones."""

LEFT = dt.timedelta(days=7)
"""A certificate that is valid for less is renewed."""

BEFORE = dt.timedelta(hours=1)
"""Validity begins earlier by this, for phones whose clocks are behind."""


@dataclass(frozen=True, kw_only=True)
class Certificate:
    """A certificate with its key, as files in PEM."""

    certificate: Path
    key: Path
    """Readable by its owner alone."""
    fingerprint: str
    """SHA-256 of the certificate as browsers show it: `AB:CD:...`."""
    warning: str = ""
    """Reason for replacing the stored certificate, or `""`."""


def obtain(folder: Path, addresses: Sequence[str], host: str, now: dt.datetime) -> Certificate:
    """Return the certificate stored in `folder`, or make and store a new one.

    The stored one is used while it names all `addresses` and this `host`, without domain, and is valid for a
    week from `now`, which has a time zone.

    Raises:
        ConfigError: If it cannot be stored; names the file.
    """
    names = _names(host)
    all_addresses = {"127.0.0.1", "::1", *addresses}
    certificate_file = folder / "certificate.pem"
    key_file = folder / "key.pem"
    warning = ""
    certificate: x509.Certificate | None = None

    # The stored one. Browsers warn of a new one again, so its damage is worth a sentence.
    try:
        stored = _read_certificate(certificate_file, key_file)
        if _fits(stored, names, all_addresses, now):
            certificate = stored
    except FileNotFoundError:
        pass  # the first one
    except (OSError, ValueError, x509.DuplicateExtension) as error:
        is_read = isinstance(error, ssl.SSLError) or not isinstance(error, OSError)
        reason = "it is damaged"
        if not is_read:
            reason = system_reason(error)
        warning = (
            f"{folder}: the page's certificate could not be used ({reason}); a new one was made, "
            "which browsers warn of again"
        )

    # A new one
    if certificate is None:
        key = ec.generate_private_key(ec.SECP256R1())
        certificate = _sign(key, names, all_addresses, now)
        write_atomically(key_file, _pem(key))
        content = certificate.public_bytes(serialization.Encoding.PEM)
        write_atomically(certificate_file, content, mode=0o644)
    digest = certificate.fingerprint(hashes.SHA256()).hex(":").upper()
    return Certificate(certificate=certificate_file, key=key_file, fingerprint=digest, warning=warning)


def _names(host: str) -> set[str]:
    """Return the names of this machine in the local network."""
    name, _, _ = host.partition(".")
    has_label_characters = all(character.isalnum() or character == "-" for character in name)
    if name.isascii() and has_label_characters and 0 < len(name) < 64:
        return {"localhost", f"{name}.local"}
    return {"localhost"}


def _read_certificate(certificate: Path, key: Path) -> x509.Certificate:
    """Return the stored certificate.

    Raises:
        OSError: If it cannot be read; FileNotFoundError: there is none; ssl.SSLError: TLS cannot use it.
        ValueError: If it is no certificate, or others could read its key.
    """
    if os.name == "posix" and key.stat().st_mode & 0o077:
        raise ValueError("others could read the key")
    # without a password, OpenSSL would ask the terminal for that of an encrypted key
    ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, password="")
    return x509.load_pem_x509_certificate(certificate.read_bytes())


def _fits(certificate: x509.Certificate, names: set[str], addresses: set[str], now: dt.datetime) -> bool:
    try:
        extension = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName)
    except x509.ExtensionNotFound:
        return False
    named = set(extension.value.get_values_for_type(x509.DNSName))
    if not names <= named:
        return False
    numbered = set(extension.value.get_values_for_type(x509.IPAddress))
    if not {ipaddress.ip_address(address) for address in addresses} <= numbered:
        return False
    return certificate.not_valid_before_utc <= now <= certificate.not_valid_after_utc - LEFT


def _sign(
    key: ec.EllipticCurvePrivateKey, names: set[str], addresses: set[str], now: dt.datetime
) -> x509.Certificate:
    """Return a self-signed certificate of `key` for a server with these names and addresses."""
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "PointIt")])
    alternatives: list[x509.GeneralName] = [x509.DNSName(name) for name in sorted(names)]
    for address in sorted(addresses):
        alternatives.append(x509.IPAddress(ipaddress.ip_address(address)))
    public = key.public_key()

    # It is its own authority, but may sign no other one: the key serves TLS alone
    usage = x509.KeyUsage(
        digital_signature=True,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=False,
        crl_sign=False,
        encipher_only=False,
        decipher_only=False,
    )
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(public)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - BEFORE)
        .not_valid_after(now - BEFORE + VALID)
        .add_extension(x509.SubjectAlternativeName(alternatives), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(usage, critical=True)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(public), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(public), critical=False)
    )
    return builder.sign(key, hashes.SHA256())


def _pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
