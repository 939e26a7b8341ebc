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
    keys = [ec.generate_private_key(ec.SECP256R1()) for _ in range(2)]
    names = [x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)]) for text in ("My home", host)]
    try:
        name: x509.GeneralName = x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        name = x509.DNSName(host)
    start = now - dt.timedelta(days=400)
    made: list[bytes] = []
    for index, extension in enumerate(
        (x509.BasicConstraints(ca=True, path_length=None), x509.SubjectAlternativeName([name]))
    ):
        builder = (
            x509.CertificateBuilder(
                names[0], names[index], keys[index].public_key(), x509.random_serial_number()
            )
            .not_valid_before(start)
            .not_valid_after(now + dt.timedelta(days=days if index else 30.0))
        )
        if index and purpose is not None:
            builder = builder.add_extension(x509.ExtendedKeyUsage([purpose]), critical=False)
        certificate = builder.add_extension(extension, critical=False).sign(keys[0], hashes.SHA256())
        made.append(certificate.public_bytes(serialization.Encoding.PEM))
    made.append(
        keys[1].private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )
    )
    files = (folder / "ca.pem", folder / "server.pem", folder / "server.key")
    for file, content in zip(files, made, strict=True):
        file.write_bytes(content)
    return files
