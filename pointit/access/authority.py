"""A site's certificate authority: EC P-256, for its router and its identities."""

import datetime as dt
import ipaddress
from collections.abc import Sequence
from dataclasses import dataclass

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from pointit.runtime.errors import ConfigError

AUTHORITY_DAYS = 3653
MAX_NAME = 64
"""Maximum number of characters of a common name in X.509."""
BEFORE = dt.timedelta(hours=1)
"""Clock error of machines that still accept a new certificate."""


@dataclass(frozen=True, kw_only=True)
class IssuedCertificate:
    """A certificate with its key, in PEM."""

    certificate: bytes
    key: bytes
    valid_from: dt.datetime
    valid_until: dt.datetime
    fingerprint: str
    """SHA-256 of the certificate, in hexadecimal."""


class Authority:
    """Issues certificates. Holds the key that must stay with the operator of the site."""

    def __init__(self, certificate: bytes, key: bytes) -> None:
        """Load what `create_authority` has made.

        Raises:
            ConfigError: If they are not an authority's certificate and its key.
        """
        try:
            self._certificate = x509.load_pem_x509_certificate(certificate)
            private = serialization.load_pem_private_key(key, None)
        except (ValueError, TypeError) as error:
            raise ConfigError(f"the authority's certificate or key is damaged ({error})") from error
        public_key = self._certificate.public_key()
        if not isinstance(private, ec.EllipticCurvePrivateKey) or private.public_key() != public_key:
            raise ConfigError("the authority's key is not that of its certificate")
        self._key = private

    @property
    def valid_until(self) -> dt.datetime:
        """Return the time at which all its certificates have expired."""
        return self._certificate.not_valid_after_utc

    def issue(
        self, common_name: str, now: dt.datetime, days: float, hosts: Sequence[str] = ()
    ) -> IssuedCertificate:
        """Return a certificate for `common_name`, valid for `days`, but not longer than the authority.

        `days` may be negative in tests. `hosts`: names and addresses of a server, empty for a client.

        Raises:
            ConfigError: If the name is too long, or a host is invalid.
        """
        if len(common_name) > MAX_NAME:
            raise ConfigError(
                f"{common_name!r} has {len(common_name)} characters, limit {MAX_NAME}; "
                "choose shorter names for the site or the person"
            )
        key = ec.generate_private_key(ec.SECP256R1())

        # A router is a client, too: it connects to other routers
        purposes = [ExtendedKeyUsageOID.CLIENT_AUTH]
        if hosts:
            purposes.append(ExtendedKeyUsageOID.SERVER_AUTH)

        # Negative days end before now, and a certificate must begin before its end
        valid_until = min(now + dt.timedelta(days=days), self.valid_until)
        valid_from = min(now, valid_until) - BEFORE
        constraints = x509.BasicConstraints(ca=False, path_length=None)
        issuer_key = x509.AuthorityKeyIdentifier.from_issuer_public_key(self._key.public_key())
        builder = (
            _builder(common_name, self._certificate.subject, key, valid_from, valid_until)
            .add_extension(constraints, critical=True)
            .add_extension(_usage(is_authority=False), critical=True)
            .add_extension(x509.ExtendedKeyUsage(purposes), critical=False)
            .add_extension(issuer_key, critical=False)
        )
        if hosts:
            alternative_names = x509.SubjectAlternativeName([_general_name(host) for host in hosts])
            builder = builder.add_extension(alternative_names, critical=False)
        return _issued(builder.sign(self._key, hashes.SHA256()), key)


def create_authority(site: str, now: dt.datetime) -> IssuedCertificate:
    """Return the certificate and the key of a new authority for `site`."""
    key = ec.generate_private_key(ec.SECP256R1())
    subject = _name(f"PointIt {site}"[:MAX_NAME])
    valid_until = now + dt.timedelta(days=AUTHORITY_DAYS)
    constraints = x509.BasicConstraints(ca=True, path_length=0)
    builder = (
        _builder("", subject, key, now - BEFORE, valid_until)
        .subject_name(subject)
        .add_extension(constraints, critical=True)
        .add_extension(_usage(is_authority=True), critical=True)
    )
    return _issued(builder.sign(key, hashes.SHA256()), key)


def _builder(
    common_name: str,
    issuer: x509.Name,
    key: ec.EllipticCurvePrivateKey,
    valid_from: dt.datetime,
    valid_until: dt.datetime,
) -> x509.CertificateBuilder:
    public_key = key.public_key()
    builder = (
        x509.CertificateBuilder()
        .issuer_name(issuer)
        .public_key(public_key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(valid_from)
        .not_valid_after(valid_until)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(public_key), critical=False)
    )
    if common_name:
        builder = builder.subject_name(_name(common_name))
    return builder


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _usage(*, is_authority: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not is_authority,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=is_authority,
        crl_sign=is_authority,
        encipher_only=False,
        decipher_only=False,
    )


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        pass
    if not all(map(_is_label, host.split("."))):
        raise ConfigError(f"{host!r} is not a name or address of a machine")
    return x509.DNSName(host)


def _is_label(text: str) -> bool:
    """Return True if `text` can stand between the dots of a host name. Windows permits `_`, too."""
    if not 0 < len(text) < 64 or not text.isascii():
        return False
    return text.replace("-", "").replace("_", "").isalnum()


def _issued(certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> IssuedCertificate:
    key_pem = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    return IssuedCertificate(
        certificate=certificate.public_bytes(serialization.Encoding.PEM),
        key=key_pem,
        valid_from=certificate.not_valid_before_utc,
        valid_until=certificate.not_valid_after_utc,
        fingerprint=certificate.fingerprint(hashes.SHA256()).hex(),
    )
