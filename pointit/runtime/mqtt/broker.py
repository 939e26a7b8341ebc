"""Connection to an MQTT broker, by aiomqtt, why there is none, and the search for brokers."""

import asyncio
import contextlib
import importlib.util
import itertools
import logging
import os
import re
import ssl
from collections.abc import AsyncGenerator, Awaitable, Callable, Coroutine, Sequence
from pathlib import Path
from typing import Any

from pointit.runtime.address_config import format_address
from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.errors import ConfigError, first_cause
from pointit.runtime.host.extras import remedy
from pointit.runtime.host.name_lookup import browse
from pointit.runtime.host.state_file import read_secret
from pointit.runtime.host.tls_errors import (
    TlsServer,
    certificate_error_in,
    encrypts,
    is_alert,
    opened,
    refusal_after_handshake,
    tls_error_in,
    tls_problem,
)
from pointit.runtime.machine import this_machine
from pointit.runtime.mqtt.broker_client import BrokerClient, BrokerError
from pointit.runtime.mqtt.broker_config import PORT, TLS_PORT, BrokerConfig
from pointit.schemas.text import one_line, system_reason

log = logging.getLogger(__name__)

FindOn = Callable[[str, int, float], Awaitable[Sequence[FoundDevice]]]
"""Returns the devices on the broker at a host and a port, after seconds at most."""

PASSWORD = "MQTT_PASSWORD"  # noqa: S105 - the name of a variable
CA_FILE = "MQTT_CA_FILE"
"""Variable with the file of the authority, where `ca_file` is not set."""
DISCOVERY_PREFIX = "MQTT_DISCOVERY_PREFIX"
"""Variable with the first levels of the topics by which Home Assistant finds devices."""
CLIENT_ID = "pointit"
"""Start of all client identifiers."""
CONNECT_TIMEOUT_S = 5.0
"""Maximum time to connect, s."""
PROBE_TIMEOUT_S = 2.0
"""Maximum time for the connection that finds out the cause of a failure, s."""
CONNECT = bytes.fromhex("100c00044d5154540402000f0000")
"""CONNECT of MQTT 3.1.1: a clean session, no client identifier, no user name."""
CONNECT_5 = bytes.fromhex("100d00044d5154540502000f000000")
"""The same of MQTT 5."""
MIN_CONNACK_5_BYTES = 3
"""Minimum length of the body of a CONNACK of MQTT 5, which has properties. One of MQTT 3.1.1 has 2 bytes."""
CONNACK = b"\x20"
HTTP = b"HTTP/1"
"""Begin of an answer of HTTP."""
WEBSOCKET_HEADERS = (
    "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: mqtt\r\n"
)
"""Headers of a request for a websocket (RFC 6455), with the key of its example."""
BAD_CLIENT_ID = (2, 133)
"""Return codes of CONNACK, as are those below: of MQTT 3.1.1, and of 5, to which paho converts them."""
BAD_PASSWORD = (4, 134)
NOT_AUTHORIZED = (5, 135)
AUTHORITY_HINT = f"set the variable {CA_FILE} to a file with its authority's certificate"
"""Remedy that each command with a broker has, whatever its options and parameters are."""

MAX_PASSWORD_BYTES = 65535
"""Maximum length of a password in MQTT."""
MAX_TOPIC = 100
"""Characters of an invalid topic that are logged."""
END_S = 0.3
"""Maximum time to take leave, s."""
MAX_PACKET_BYTES = 1024 * 1024
"""Maximum length of a packet that is read. Lamps, robots and sensors send some kB."""
QUEUED_MESSAGES = 1000
"""Maximum number of unread messages."""
_paho_log = logging.getLogger("pointit.paho")

KINDS = ("_mqtt._tcp", "_secure-mqtt._tcp")
"""Services by which brokers announce themselves."""


async def check_server(host: str, port: int, context: ssl.SSLContext | None) -> bool:
    """Check that something listens at `host` and `port`, with a certificate that `context` accepts, if any.

    Return True if it answers by MQTT 5, in which a broker says what it refuses.

    Raises:
        BrokerError: If the certificate is not accepted, or the server does not encrypt.
        OSError: If nothing answers.
    """
    try:
        async with asyncio.timeout(CONNECT_TIMEOUT_S), opened(host, port, context) as (reader, writer):
            return await _answers_by_mqtt_5(reader, writer)
    except (ssl.SSLError, ConnectionError, TimeoutError) as error:
        if context is None:
            raise

        # A refused certificate and an alert are proof that it encrypts; an answer in clear that it does not
        tls_error = tls_error_in(error)
        has_alert = tls_error is not None and is_alert(tls_error)
        is_encrypted = has_alert or certificate_error_in(error) is not None
        if not is_encrypted and await _answers_plain(host, port):
            raise BrokerError(
                f"{_name(host, port)} does not encrypt at this port: leave `tls` out (mqtt:// in place of "
                "mqtts://), or name its port for TLS, usually 8883"
            ) from error
        if tls_error is None:
            raise
        raise BrokerError(await tls_problem(_server(host, port), error, context)) from error


async def _answers_by_mqtt_5(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bool:
    """Return True if a server answers a CONNECT of MQTT 5 in that version, if only to refuse it.

    It is one without a login, on a connection of its own: some brokers of MQTT 3.1.1 misread it.
    """
    writer.write(CONNECT_5)
    try:
        async with asyncio.timeout(PROBE_TIMEOUT_S):
            kind, length = await reader.readexactly(2)
    except (OSError, EOFError):  # TimeoutError is an OSError; the connection that follows tells the reason
        return False
    return kind == CONNACK[0] and length >= MIN_CONNACK_5_BYTES


async def transport_error(host: str, port: int, context: ssl.SSLContext | None) -> BrokerError | None:
    """Return the reason for which a server does not answer a CONNECT, or None if it is unknown."""
    if context is None and await encrypts(host, port):
        return BrokerError(
            f"{_name(host, port)} encrypts at this port: set `tls` (mqtts:// in front of its address), or "
            "name its port without encryption, usually 1883"
        )
    if context is not None:
        refusal = await refusal_after_handshake(host, port, context)
        if refusal is not None:
            return BrokerError(await tls_problem(_server(host, port), refusal, context))
    if await _answers_http(host, port, context):
        return BrokerError(
            f"{_name(host, port)} answers by HTTP, as listeners for websockets do, and PointIt speaks MQTT "
            "by TCP: name its port for that, usually 1883, or 8883 with `tls`"
        )
    return None


def _name(host: str, port: int) -> str:
    return f"the broker at {format_address(host, port)}"


def _server(host: str, port: int) -> TlsServer:
    return TlsServer(
        host=host,
        port=port,
        name=_name(host, port),
        authority_hint=AUTHORITY_HINT,
        certificate_hint="use a listener without `require_certificate`",
    )


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
    return f"the broker cannot be reached ({system_reason(error)}): start it, or correct its address"


def _return_code(error: BaseException) -> int | None:
    """Return the code of an `aiomqtt.MqttCodeError`, or None if it is another error."""
    code = getattr(error, "rc", None)
    return getattr(code, "value", code)


async def _answers_plain(host: str, port: int) -> bool:
    """Return True if the server at `host` and `port` answers a CONNECT that is not encrypted."""
    try:
        async with asyncio.timeout(PROBE_TIMEOUT_S), opened(host, port, None) as (reader, writer):
            writer.write(CONNECT)
            return await reader.read(1) == CONNACK
    except OSError:  # TimeoutError is one
        return False


async def _answers_http(host: str, port: int, context: ssl.SSLContext | None) -> bool:
    """Return True if the server at `host` and `port` answers a request of HTTP, as that for a websocket."""
    request = f"GET /mqtt HTTP/1.1\r\nHost: {format_address(host, port)}\r\n{WEBSOCKET_HEADERS}\r\n"
    try:
        async with asyncio.timeout(PROBE_TIMEOUT_S), opened(host, port, context) as (reader, writer):
            writer.write(request.encode())
            return await reader.readexactly(len(HTTP)) == HTTP
    except (OSError, EOFError):  # TimeoutError is an OSError
        return False


_paho_log.setLevel(logging.CRITICAL)  # its errors are raised, too, and it would log them at every try


def require_client(users: str) -> None:
    """Check that the extra is installed, without which `users`, a plural, has no connection.

    Raises:
        ConfigError: If it is not.
    """
    if importlib.util.find_spec("aiomqtt") is None:
        raise ConfigError(f"{users} need an extra: run {remedy('mqtt')}")


def discovery_prefix(prefix: str = "") -> str:
    """Return `prefix`, or that of the variable MQTT_DISCOVERY_PREFIX, or Home Assistant's own.

    Raises:
        ConfigError: If it is no topic.
    """
    default = os.environ.get(DISCOVERY_PREFIX, "") or "homeassistant"
    prefix = prefix or default
    if not re.fullmatch(r"[^#+\x00/]+(/[^#+\x00/]+)*", prefix):
        raise ConfigError(f"{DISCOVERY_PREFIX}: {prefix!r} is no topic: write levels, such as house/ha")
    return prefix


def client_options(config: BrokerConfig) -> dict[str, Any]:
    """Return the options of `aiomqtt.Client` for the broker of `config`. Reads the password.

    Raises:
        ConfigError: If a file cannot be read.
    """
    host, port = config.address()
    password: str | None = None
    if config.username and config.uses_variable:
        password = os.environ.get(PASSWORD)
    try:
        if config.password_file:
            content = read_secret(Path(config.password_file), MAX_PASSWORD_BYTES + 1)
            password = content.decode().rstrip("\r\n")
    except FileNotFoundError as error:
        raise ConfigError(
            f"password_file: {config.password_file} does not exist; correct the path"
        ) from error
    except UnicodeDecodeError:  # its text and the chained error have bytes of the password
        raise ConfigError(
            f"password_file: {config.password_file} is not in UTF-8; save it as UTF-8"
        ) from None
    except ConfigError as error:
        raise ConfigError(f"password_file: {error}") from error
    if password is not None and len(password) > MAX_PASSWORD_BYTES:
        raise ConfigError(
            f"password_file: {config.password_file} exceeds {MAX_PASSWORD_BYTES} bytes; "
            "name a file that holds the password only"
        )
    tls_context = _tls_context(config.ca_file) if config.tls else None
    # the same after a loss: the broker then ends the former connection before the next one begins
    identifier = f"{CLIENT_ID}{this_machine().random_name(5)}"
    return {
        "hostname": host,
        "port": port,
        "identifier": identifier,
        "username": config.username or None,
        "password": password,
        "tls_context": tls_context,
    }


def _tls_context(ca_file: str) -> ssl.SSLContext:
    file: str | None = ca_file
    name = "ca_file"
    if not ca_file:
        file = os.environ.get(CA_FILE)
        name = CA_FILE
    try:
        context = ssl.create_default_context(cafile=file or None)
    except OSError as error:  # SSLError is one
        raise ConfigError(
            f"{name}: {file} cannot be used ({system_reason(error)}): name a file with certificates in the "
            "form PEM"
        ) from error
    # own authorities often lack extensions that Python requires from 3.13 on, or certify only themselves
    if file:
        context.verify_flags &= ~ssl.VERIFY_X509_STRICT
        context.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
    return context


@contextlib.asynccontextmanager
async def connected(options: dict[str, Any]) -> AsyncGenerator[BrokerClient]:
    """Yield a client that is connected with `options`, by MQTT 5 if the broker knows it.

    Args:
        options: those of `aiomqtt.Client`, and `session_hint` of `BrokerClient`.

    Raises:
        OSError: If nothing can be reached. BrokerError: the cause is known.
        aiomqtt.MqttError: If the broker refuses the connection, or does not answer.
    """
    import aiomqtt  # noqa: PLC0415 - an extra

    options = dict(options)
    session_hint = options.pop("session_hint", "")
    server = options["hostname"], options["port"], options.get("tls_context")
    # aiomqtt connects in a thread that cannot be interrupted and leaves a socket of a failed handshake open
    has_version_5 = await check_server(*server)
    protocol = aiomqtt.ProtocolVersion.V5 if has_version_5 else aiomqtt.ProtocolVersion.V311
    client = aiomqtt.Client(
        **options,
        properties=_connect_properties() if has_version_5 else None,
        protocol=protocol,
        timeout=CONNECT_TIMEOUT_S,
        keepalive=15,
        max_queued_incoming_messages=QUEUED_MESSAGES,
        logger=_paho_log,
    )
    paho: Any = client._client  # noqa: SLF001  # aiomqtt has no other way
    ignore_closed_sockets(client)
    _skip_invalid_topics(paho)
    _limit_packets(paho)
    connection = BrokerClient(client, options.get("username") or "", session_hint)
    opening = asyncio.ensure_future(client.__aenter__())
    try:
        try:
            await asyncio.shield(opening)  # cancelled in the middle, it would leave a socket and a task
        except aiomqtt.MqttCodeError:
            raise
        except aiomqtt.MqttError as error:  # without an answer
            raise await transport_error(*server) or error from error
        connection.check()  # a broker may accept a connection, and close it at once
        yield connection
    finally:
        with contextlib.suppress(aiomqtt.MqttError, OSError):  # TimeoutError is one
            async with asyncio.timeout(END_S):
                await opening
                await client.__aexit__(None, None, None)
        paho._sock_close()  # noqa: SLF001 - aiomqtt leaves it open if an exception ended the connection


def _connect_properties() -> Any:
    """Return the properties by which a broker of MQTT 5 sends no packet that is not read."""
    from paho.mqtt.packettypes import PacketTypes  # noqa: PLC0415 - an extra
    from paho.mqtt.properties import Properties  # noqa: PLC0415 - an extra

    properties: Any = Properties(PacketTypes.CONNECT)
    properties.MaximumPacketSize = MAX_PACKET_BYTES
    return properties


def _limit_packets(paho: Any) -> None:
    """End the connection before a packet is read that is too long: brokers of MQTT 3.1.1 send any.

    A packet says its length first, and paho then asks for as many bytes as are missing.
    """
    receive = paho._sock_recv  # noqa: SLF001 - paho has no limit of its own

    def receive_limited(size: int) -> bytes:
        if size > MAX_PACKET_BYTES:
            megabytes = size / 2**20
            log.warning(
                "the broker sends a message of %.0f MB, more than %d are not read, and the connection ends: "
                "find and remove it there",
                megabytes,
                MAX_PACKET_BYTES >> 20,
            )
            raise ConnectionAbortedError(f"a message has {megabytes:.0f} MB")
        received: bytes = receive(size)
        return received

    paho._sock_recv = receive_limited  # noqa: SLF001 - as above


def ignore_closed_sockets(client: Any) -> None:
    """Make an `aiomqtt.Client` that is not connected yet ignore sockets that close before it watches them."""
    client._loop = _LoopWithoutClosedSockets(client._loop)  # noqa: SLF001 - aiomqtt has no other way


class _LoopWithoutClosedSockets:
    """The loop of a client, which ignores sockets that are closed by the time they are to be watched.

    aiomqtt watches a socket by a callback in the next round of the loop. If the broker goes away before,
    the socket is closed by then, and the loop would log a traceback.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the loop itself."""
        return getattr(self._loop, name)

    def call_soon_threadsafe(self, callback: Callable[..., object], *arguments: Any) -> asyncio.Handle:
        """Call `callback` in the next round."""
        is_watching = callback in (self._loop.add_reader, self._loop.add_writer)
        if is_watching:
            return self._loop.call_soon_threadsafe(_watch_if_open, callback, *arguments)
        return self._loop.call_soon_threadsafe(callback, *arguments)


def _watch_if_open(watch: Callable[..., object], number: int, *arguments: Any) -> None:
    """Call `watch`, `add_reader` or `add_writer` of a loop, unless the socket of this `number` is closed."""
    with contextlib.suppress(OSError, ValueError):  # of the selector; ValueError: -1
        watch(number, *arguments)


def _skip_invalid_topics(paho: Any) -> None:
    """Replace the receiver of messages by one that ignores those whose topic is not valid, with one warning.

    An exception of the receiver has paho handle the same packet again and again, and read no other.
    """
    receive = paho.on_message
    is_logged = False

    def on_message(*arguments: Any) -> None:
        nonlocal is_logged
        try:
            receive(*arguments)
        except ValueError as error:
            if not is_logged:
                topic = error.object if isinstance(error, UnicodeDecodeError) else error
                log.warning(
                    "messages whose topic is not valid are ignored, first %s: correct their sender",
                    one_line(str(topic), MAX_TOPIC),
                )
            is_logged = True

    paho.on_message = on_message


async def keep_connected(
    serve: Callable[[], Coroutine[Any, Any, None]],
    on_lost: Callable[[str], None],
    *,
    has_user: bool,
    retry_s: float,
) -> None:
    """Call `serve` again, `retry_s` after its connection was lost, until cancelled.

    `on_lost` gets the reason and the remedy. Each `serve` is a separate task, since TaskGroup has two faults
    before Python 3.13: a task whose group has failed still counts as cancelled (in 3.11.2 of Debian 12 until
    its next `asyncio.timeout`), and the group loses a cancellation that arrives while it fails.
    """
    import aiomqtt  # noqa: PLC0415 - an extra

    this = asyncio.current_task()
    while True:
        try:
            await asyncio.create_task(serve())
        except* (aiomqtt.MqttError, OSError) as errors:
            on_lost(describe_error(first_cause(errors), has_user=has_user))
        if this is not None and this.cancelling():
            raise asyncio.CancelledError
        await asyncio.sleep(retry_s)


async def find_on_brokers(find_on: FindOn, seconds: float) -> list[FoundDevice]:
    """Return the devices on the brokers of this machine and on those that announce themselves."""
    local = (find_on("127.0.0.1", port, seconds) for port in (PORT, TLS_PORT))
    results = await asyncio.gather(*local, _find_in_thread(find_on, seconds))
    return list(itertools.chain.from_iterable(results))


async def _find_in_thread(find_on: FindOn, seconds: float) -> list[FoundDevice]:
    # Half of the time to find the brokers, half of it to ask them
    half_s = seconds / 2
    try:
        results = await asyncio.gather(*(browse(kind, half_s) for kind in KINDS))
    except ConfigError:  # without the extra `discovery`, that of this machine is all
        return []
    services = itertools.chain.from_iterable(results)
    brokers = {(service.address, service.port) for service in services}
    devices = await asyncio.gather(*(find_on(host, port, half_s) for host, port in sorted(brokers)))
    return list(itertools.chain.from_iterable(devices))
