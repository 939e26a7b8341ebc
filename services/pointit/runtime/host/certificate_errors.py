"""Certificates of servers that are not accepted: cause and remedy, for a person."""

import ssl
from collections.abc import Iterator

NOT_YET_VALID, EXPIRED = 9, 10
OTHER_NAMES = (62, 64)
"""Codes of OpenSSL (`X509_V_ERR_…`): a host name, an IP address that the certificate does not have."""


def describe_certificate_error(error: ssl.SSLCertVerificationError, server: str, trust: str) -> str:
    """Return the reason for which the certificate of a server is not accepted, and the remedy.

    Args:
        error: error of the handshake.
        server: the server, such as `the broker at hub:8883`.
        trust: what makes an unknown authority trusted, such as "set `ca_file` to its certificate".
    """
    if error.verify_code == EXPIRED:
        return f"the certificate of {server} has expired: renew it there"
    if error.verify_code == NOT_YET_VALID:
        return f"the certificate of {server} is not valid yet by the clock of this machine: set the clock"
    if error.verify_code in OTHER_NAMES:
        return (
            f"the certificate of {server} is for other names ({error.verify_message}): use a name that it "
            "has, or issue one for this name"
        )
    return f"the certificate of {server} is not trusted ({error.verify_message}): {trust}"


def certificate_error_in(error: BaseException | None) -> ssl.SSLCertVerificationError | None:
    """Return the refusal of a certificate that has caused `error`, or None."""
    return next((each for each in _causes(error) if isinstance(each, ssl.SSLCertVerificationError)), None)


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__
