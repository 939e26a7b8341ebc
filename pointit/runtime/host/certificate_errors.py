"""Certificates of servers that are not accepted: cause and remedy, for a person."""

import ssl
from collections.abc import Iterator

NOT_YET_VALID = 9
EXPIRED = 10
OTHER_NAMES = (62, 64)
"""Codes of OpenSSL (`X509_V_ERR_…`): a host name, an IP address that the certificate does not have."""
UNKNOWN_AUTHORITY = (2, 18, 19, 20, 21)
"""Codes for an issuer that is not among the trusted ones, the certificate itself included."""


def describe_certificate_error(error: ssl.SSLCertVerificationError, server: str, authority_hint: str) -> str:
    """Return the reason for which the certificate of a server is not accepted, and the remedy.

    Args:
        error: error of the handshake.
        server: the server, such as `the broker at hub:8883`.
        authority_hint: what makes an unknown authority trusted, such as "set `ca_file` to its certificate".
    """
    code = error.verify_code
    reason = error.verify_message.rstrip(".")
    if code == EXPIRED:
        return f"the certificate of {server}, or of its authority, has expired: renew it there"
    if code == NOT_YET_VALID:
        return f"the certificate of {server} is not valid yet by the clock of this machine: set the clock"
    if code in OTHER_NAMES:
        return (
            f"the certificate of {server} is for other names ({reason}): use a name that it has, or issue "
            "one with this name, or address, as its subject alternative name"
        )
    if code in UNKNOWN_AUTHORITY:
        return f"the certificate of {server} is not trusted ({reason}): {authority_hint}"
    return f"the certificate of {server} cannot be used ({reason}): issue another one there"


def certificate_error_in(error: BaseException | None) -> ssl.SSLCertVerificationError | None:
    """Return the refusal of a certificate that has caused `error`, or None."""
    for cause in _causes(error):
        if isinstance(cause, ssl.SSLCertVerificationError):
            return cause
    return None


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__
