"""Failures of TLS with a server: cause and remedy, for a person.

A failed handshake is no proof that a server does not encrypt, so no remedy here takes the encryption away.
A caller may say so once the server has answered in its protocol without encryption.
"""

import asyncio
import contextlib
import ssl
import warnings
from collections.abc import AsyncGenerator, Iterator
from dataclasses import dataclass

from pointit.schemas.text import system_reason

NOT_YET_VALID = 9
EXPIRED = 10
OTHER_NAMES = (62, 64)
"""Codes of OpenSSL (`X509_V_ERR_…`): a host name, an IP address that the certificate does not have."""
UNKNOWN_AUTHORITY = (2, 18, 19, 20, 21)
"""Codes for an issuer that is not among the trusted ones, the certificate itself included."""
ALERT_REASONS = ("SSLV3_ALERT_", "TLSV1_", "TLSV13_ALERT_")
"""Begins of OpenSSL's names of alerts, which only a server that speaks TLS can send."""
UNKNOWN_NAME = ("TLSV1_UNRECOGNIZED_NAME", "TLSV1_ALERT_INTERNAL_ERROR")
"""Alerts of proxies without a certificate for the name: nginx sends the first, Caddy the second."""
WANTS_CERTIFICATE = (
    "TLSV13_ALERT_CERTIFICATE_REQUIRED",
    "SSLV3_ALERT_BAD_CERTIFICATE",
    "TLSV1_ALERT_UNKNOWN_CA",
)
"""Alerts of servers that want a certificate of the client."""
HANDSHAKE_FAILURE = "SSLV3_ALERT_HANDSHAKE_FAILURE"
"""Alert for a missing certificate of the client in TLS 1.2, and for ciphers of which none is common."""
OLD_VERSION = ("TLSV1_ALERT_PROTOCOL_VERSION", "UNSUPPORTED_PROTOCOL")
PROBE_TIMEOUT_S = 2.0
"""Maximum time for the connection that finds out the cause of a failure, s."""
ALL_CIPHERS = "ALL:@SECLEVEL=0"
"""Ciphers of OpenSSL, also those that it does not use by itself any more."""


@dataclass(frozen=True, kw_only=True)
class TlsServer:
    """A server that is reached by TLS.

    Attributes:
        host: its name or address.
        port: its port.
        name: the subject of a sentence, such as `the broker at hub:8883`.
        authority_hint: what makes an unknown authority trusted, such as "set `ca_file` to its certificate".
        certificate_hint: what to do if it wants a certificate of the client.
    """

    host: str
    port: int
    name: str
    authority_hint: str
    certificate_hint: str


async def tls_problem(server: TlsServer, error: BaseException, context: ssl.SSLContext | None = None) -> str:
    """Return the reason for which a connection to `server` failed by TLS, and the remedy, else `""`.

    Args:
        server: the server. It may get further handshakes, in which nothing is sent.
        error: error of the connection.
        context: the connection's own context, or None for that of the system.
    """
    certificate_error = certificate_error_in(error)
    if certificate_error is not None:
        return describe_certificate_error(certificate_error, server.name, server.authority_hint)

    # A server of TLS 1.3 refuses the client after its handshake: the library sees an end without a cause
    tls_error = tls_error_in(error)
    if tls_error is None:
        tls_error = await refusal_after_handshake(server.host, server.port, context)
    if tls_error is None:
        return ""

    version = "" if is_alert(tls_error) else await old_version(server.host, server.port)
    return describe_tls_error(tls_error, server.name, server.certificate_hint, version)


def describe_tls_error(error: ssl.SSLError, server: str, certificate_hint: str, version: str = "") -> str:
    """Return the reason for which a TLS handshake failed, not by a certificate, and the remedy.

    Args:
        error: error of the handshake.
        server: the subject of a sentence, such as `the broker at hub:8883`.
        certificate_hint: what to do if it wants a certificate of the client.
        version: the server's newest version of TLS if that is an old one, else `""`.
    """
    reason = error.reason or ""
    shown_reason = system_reason(error)
    if reason in UNKNOWN_NAME:
        return (
            f"{server} encrypts, and has no certificate for this name or address ({shown_reason}): write the "
            "name that people open in a browser"
        )
    if reason in WANTS_CERTIFICATE:
        return f"{server} asks for a certificate of the client, and PointIt has none: {certificate_hint}"
    if reason == HANDSHAKE_FAILURE:
        return (
            f"{server} encrypts, and refuses the TLS handshake ({shown_reason}): it may ask for a "
            f"certificate of the client, and PointIt has none ({certificate_hint}), or it has no cipher of "
            "this machine (update it)"
        )
    if version or reason in OLD_VERSION:
        version = version or "an old version of TLS"
        return f"{server} encrypts by {version} only: update it to TLS 1.2"
    if is_alert(error):
        return f"{server} encrypts, and refuses the TLS handshake ({shown_reason}): look into its log"
    return f"{server} does not complete the TLS handshake ({shown_reason}): correct the port"


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


def tls_error_in(error: BaseException | None) -> ssl.SSLError | None:
    """Return the error of TLS that has caused `error`, or None."""
    for cause in _causes(error):
        if isinstance(cause, ssl.SSLError):
            return cause
    return None


def is_alert(error: ssl.SSLError) -> bool:
    """Return True if `error` is an alert of the server, which therefore encrypts."""
    return (error.reason or "").startswith(ALERT_REASONS)


async def encrypts(host: str, port: int, timeout_s: float = PROBE_TIMEOUT_S) -> bool:
    """Return True if the server at `host` and `port` answers by TLS within `timeout_s`, if only to refuse."""
    try:
        async with asyncio.timeout(timeout_s), opened(host, port, _unverified()):
            return True
    except ssl.SSLError as error:
        return is_alert(error)
    except OSError:  # TimeoutError is one
        return False


async def refusal_after_handshake(
    host: str, port: int, context: ssl.SSLContext | None
) -> ssl.SSLError | None:
    """Return the alert by which a server ends a connection after the handshake, or None if it does not.

    So it does in TLS 1.3 if it misses a certificate of the client. Sends nothing.
    """
    context = context or ssl.create_default_context()
    try:
        async with asyncio.timeout(PROBE_TIMEOUT_S), opened(host, port, context) as (reader, _writer):
            await reader.read(1)
    except ssl.SSLError as error:
        return error
    except OSError:  # TimeoutError is one
        pass
    return None


async def old_version(host: str, port: int) -> str:
    """Return the version of TLS of a server that speaks none from 1.2 on, such as `TLSv1.1`, else `""`."""
    context = _unverified()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        context.minimum_version = ssl.TLSVersion.TLSv1
    context.maximum_version = ssl.TLSVersion.TLSv1_2
    context.set_ciphers(ALL_CIPHERS)
    try:
        async with asyncio.timeout(PROBE_TIMEOUT_S), opened(host, port, context) as (_reader, writer):
            connection: ssl.SSLObject = writer.get_extra_info("ssl_object")
            version = connection.version() or ""
    except OSError:  # SSLError and TimeoutError are some
        return ""
    return "" if version == "TLSv1.2" else version


@contextlib.asynccontextmanager
async def opened(
    host: str, port: int, context: ssl.SSLContext | None
) -> AsyncGenerator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
    """Yield a connection, by TLS if there is a `context`.

    Raises:
        OSError: If there is none. SSLError is one.
    """
    try:
        reader, writer = await asyncio.open_connection(host, port, ssl=context)
    except UnicodeError as error:  # a label of more than 63 characters
        raise OSError(str(error)) from error
    try:
        yield reader, writer
    finally:
        writer.transport.abort()


def _unverified() -> ssl.SSLContext:
    """Return a context that accepts any certificate: nothing is sent over its connection."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__
