"""Certificates as people make them at home: an authority of their own, and a server that it has signed."""

import datetime as dt
import ipaddress
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID


def issue(
    folder: Path, host: str, *, days: float = 30.0, purpose: x509.ObjectIdentifier | None = None
) -> tuple[Path, Path, Path]:
    """Write an authority, the certificate of a server `host` and its key, and return the three files.

    The authority has no key identifiers, as those of old instructions.

    Args:
        folder: folder of the files.
        host: name or address that the server has in its certificate.
        days: time until the certificate expires; negative if it has expired.
        purpose: the only purpose for which the certificate is issued, or None if there is no limit.
    """
    now = dt.datetime.now(dt.UTC)
    start = now - dt.timedelta(days=400)
    authority_key = ec.generate_private_key(ec.SECP256R1())
    server_key = ec.generate_private_key(ec.SECP256R1())
    authority_name = _name("My home")

    def certificate(name: str, key: ec.EllipticCurvePrivateKey, days: float) -> x509.CertificateBuilder:
        end = now + dt.timedelta(days=days)
        builder = x509.CertificateBuilder(
            authority_name, _name(name), key.public_key(), x509.random_serial_number()
        )
        return builder.not_valid_before(start).not_valid_after(end)

    # the authority signs itself
    is_authority = x509.BasicConstraints(ca=True, path_length=None)
    authority = certificate("My home", authority_key, 30.0)
    authority = authority.add_extension(is_authority, critical=False)

    server = certificate(host, server_key, days)
    if purpose is not None:
        server = server.add_extension(x509.ExtendedKeyUsage([purpose]), critical=False)
    server = server.add_extension(x509.SubjectAlternativeName([_general_name(host)]), critical=False)

    # the files that such an authority hands out
    files = (folder / "ca.pem", folder / "server.pem", folder / "server.key")
    for file, builder in zip(files[:2], (authority, server), strict=True):
        signed = builder.sign(authority_key, hashes.SHA256())
        file.write_bytes(signed.public_bytes(serialization.Encoding.PEM))
    key = server_key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    files[2].write_bytes(key)
    return files


def _name(text: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)
