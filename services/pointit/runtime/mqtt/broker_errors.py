"""Causes for which a broker cannot be connected to, and their remedies, for a person."""

import asyncio
import ssl
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

from pointit.runtime.host.certificate_errors import describe_certificate_error

PASSWORD = "MQTT_PASSWORD"  # noqa: S105 - the name of a variable
CA_FILE = "MQTT_CA_FILE"
"""Variable with the file of the authority, where `ca_file` is not set."""
CLIENT_ID = "pointit"
"""Start of all client identifiers."""
CONNECT_TIMEOUT_S = 5.0
"""Maximum time to connect, s."""
PROBE_TIMEOUT_S = 2.0
"""Maximum time for the connection that finds out the cause of a failure, s."""
CONNECT = bytes.fromhex("100c00044d5154540402000f0000")
"""CONNECT of MQTT 3.1.1: a clean session, no client identifier, no user name."""
CONNACK = b"\x20"
BAD_CLIENT_ID, BAD_PASSWORD, NOT_AUTHORIZED = (2, 133), (4, 134), (5, 135)
"""Return codes of CONNACK: of MQTT 3.1.1, and of 5, to which paho converts them."""
AUTHORITY_HINT = (
    f"set `ca_file` (--mqtt-ca-file, variable {CA_FILE}) to a file with its authority's certificate"
)


class BrokerError(OSError):
    """A broker cannot be connected to. The text has the cause and the remedy."""


async def check_server(host: str, port: int, context: ssl.SSLContext | None) -> None:
    """Check that something listens at `host` and `port`, with a certificate that `context` accepts, if any.

    Raises:
        BrokerError: If the certificate is not accepted, or the server does not encrypt.
        OSError: If nothing answers.
    """
    broker = f"the broker at {_shown(host, port)}"
    try:
        async with asyncio.timeout(CONNECT_TIMEOUT_S), _opened(host, port, context):
            return
    except ssl.SSLCertVerificationError as error:
        raise BrokerError(describe_certificate_error(error, broker, AUTHORITY_HINT)) from error
    except (ssl.SSLError, ConnectionError, TimeoutError) as error:
        if context is not None and await _answers_plain(host, port):
            raise BrokerError(
                f"{broker} does not encrypt at this port: leave `tls` out (mqtt:// in place of mqtts://), or "
                "name its port for TLS, usually 8883"
            ) from error
        if not isinstance(error, ssl.SSLError):
            raise
        raise BrokerError(
            f"{broker} does not complete the TLS handshake ({error.reason or error}): correct the port, or "
            "update the broker to TLS 1.2"
        ) from error


async def transport_error(host: str, port: int, context: ssl.SSLContext | None) -> BrokerError | None:
    """Return the reason for which a server does not answer a CONNECT, or None if it is unknown."""
    broker = f"the broker at {_shown(host, port)}"
    if context is None:
        text = (
            f"{broker} encrypts at this port: set `tls` (mqtts:// in front of its address), or name its port "
            "without encryption, usually 1883"
        )
        return BrokerError(text) if await encrypts(host, port) else None
    try:
        async with asyncio.timeout(PROBE_TIMEOUT_S), _opened(host, port, context) as (reader, _writer):
            await reader.read(1)  # of TLS 1.3, a refusal follows the handshake
    except ssl.SSLError as error:
        if "CERTIFICATE_REQUIRED" in (error.reason or ""):
            return BrokerError(
                f"{broker} asks for a certificate of the client, and PointIt has none: use a listener "
                "without `require_certificate`"
            )
    except OSError:  # TimeoutError is one
        pass
    return None


async def encrypts(host: str, port: int, timeout_s: float = PROBE_TIMEOUT_S) -> bool:
    """Return True if the server at `host` and `port` completes a TLS handshake within `timeout_s`."""
    try:
        async with asyncio.timeout(timeout_s), _opened(host, port, _unverified()):
            return True
    except OSError:  # SSLError and TimeoutError are some
        return False


def refuses_login(error: BaseException) -> bool:
    """Return True if the broker refuses the user name or the password, or asks for one."""
    return _return_code(error) in (*BAD_PASSWORD, *NOT_AUTHORIZED)


def describe_error(error: BaseException, *, has_user: bool) -> str:
    """Return the meaning of an error of a broker, and the remedy, for a person."""
    text = str(error) or "no answer"
    if isinstance(error, BrokerError):
        return text
    code = _return_code(error)
    if code in BAD_CLIENT_ID:
        return f"the broker refuses the client identifier ({text}): allow those that begin with {CLIENT_ID}"
    if refuses_login(error):
        action = "correct" if has_user else "set"
        also = f"; allow client identifiers that begin with {CLIENT_ID}" if code in NOT_AUTHORIZED else ""
        return (
            f"the broker refuses the connection ({text}): {action} `username` and {PASSWORD} or "
            f"`password_file`{also}"
        )
    return f"the broker cannot be reached ({text}): start it, or correct its address"


def _return_code(error: BaseException) -> int | None:
    """Return the code of an `aiomqtt.MqttCodeError`, or None if it is another error."""
    code = getattr(error, "rc", None)
    return getattr(code, "value", code)


async def _answers_plain(host: str, port: int) -> bool:
    """Return True if the server at `host` and `port` answers a CONNECT that is not encrypted."""
    try:
        async with asyncio.timeout(PROBE_TIMEOUT_S), _opened(host, port, None) as (reader, writer):
            writer.write(CONNECT)
            return await reader.read(1) == CONNACK
    except OSError:  # TimeoutError is one
        return False


@asynccontextmanager
async def _opened(
    host: str, port: int, context: ssl.SSLContext | None
) -> AsyncGenerator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
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


def _shown(host: str, port: int) -> str:
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
