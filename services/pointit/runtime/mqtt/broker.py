"""Connection to an MQTT broker, by aiomqtt."""

import asyncio
import contextlib
import importlib.util
import logging
import os
import secrets
import ssl
from collections.abc import AsyncGenerator, Awaitable, Callable, Coroutine
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pointit.runtime.errors import ConfigError, first_cause
from pointit.runtime.host.atomic_file import read_limited
from pointit.runtime.host.extras import remedy
from pointit.runtime.mqtt.broker_config import BrokerConfig
from pointit.runtime.mqtt.broker_errors import (
    CA_FILE,
    CLIENT_ID,
    CONNECT_TIMEOUT_S,
    PASSWORD,
    check_server,
    describe_error,
    transport_error,
)
from pointit.schemas.text import one_line

if TYPE_CHECKING:
    import aiomqtt

MAX_PASSWORD_BYTES = 65535
"""Maximum length of a password in MQTT."""
MAX_TOPIC = 100
"""Characters of an invalid topic that are logged."""
END_S = 0.3
"""Maximum time to take leave, s."""
QUEUED_MESSAGES = 1000
"""Maximum number of unread messages."""
log = logging.getLogger(__name__)
_paho_log = logging.getLogger("pointit.paho")
_paho_log.setLevel(logging.CRITICAL)  # its errors are raised, too, and it would log them at every try


def require_client(users: str) -> None:
    """Check that the extra is installed, without which `users`, a plural, has no connection.

    Raises:
        ConfigError: If it is not.
    """
    if importlib.util.find_spec("aiomqtt") is None:
        raise ConfigError(f"{users} need an extra: run {remedy('mqtt')}")


def client_options(config: BrokerConfig) -> dict[str, Any]:
    """Return the options of `aiomqtt.Client` for the broker of `config`. Reads the password.

    Raises:
        ConfigError: If a file cannot be read.
    """
    host, port = config.address()
    password = os.environ.get(PASSWORD) if config.username else None
    try:
        if config.password_file:
            content = read_limited(Path(config.password_file), MAX_PASSWORD_BYTES + 1)
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
    return {
        "hostname": host,
        "port": port,
        # the same after a loss: the broker then ends the former connection before the next one begins
        "identifier": f"{CLIENT_ID}{secrets.token_hex(5)}",
        "username": config.username or None,
        "password": password,
        "tls_context": _tls_context(config.ca_file) if config.tls else None,
    }


def _tls_context(ca_file: str) -> ssl.SSLContext:
    file, name = (ca_file, "ca_file") if ca_file else (os.environ.get(CA_FILE), CA_FILE)
    try:
        context = ssl.create_default_context(cafile=file or None)
    except OSError as error:  # SSLError is one
        raise ConfigError(
            f"{name}: {file} cannot be used ({error}): name a file with certificates in the form PEM"
        ) from error
    if (
        file
    ):  # own authorities often lack extensions that Python requires from 3.13 on, or certify only themselves
        context.verify_flags &= ~ssl.VERIFY_X509_STRICT
        context.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
    return context


@contextlib.asynccontextmanager
async def connected(options: dict[str, Any]) -> "AsyncGenerator[aiomqtt.Client]":
    """Yield a client that is connected with `options` of `aiomqtt.Client`.

    Raises:
        OSError: If nothing can be reached. BrokerError: the cause is known.
        aiomqtt.MqttError: If the broker refuses, does not answer, or goes away.
    """
    import aiomqtt  # noqa: PLC0415 - an extra

    server = options["hostname"], options["port"], options.get("tls_context")
    # aiomqtt connects in a thread that cannot be interrupted and leaves a socket of a failed handshake open
    await check_server(*server)
    client = aiomqtt.Client(
        **options,
        timeout=CONNECT_TIMEOUT_S,
        keepalive=15,
        max_queued_incoming_messages=QUEUED_MESSAGES,
        logger=_paho_log,
    )
    paho: Any = client._client  # noqa: SLF001  # pyright: ignore[reportPrivateUsage] - aiomqtt has no other way
    _skip_invalid_topics(paho)
    opening = asyncio.ensure_future(client.__aenter__())
    try:
        try:
            await asyncio.shield(opening)  # cancelled in the middle, it would leave a socket and a task
        except aiomqtt.MqttCodeError:
            raise
        except aiomqtt.MqttError as error:  # without an answer
            raise await transport_error(*server) or error from error
        yield client
    finally:
        with contextlib.suppress(aiomqtt.MqttError, OSError):  # TimeoutError is one
            async with asyncio.timeout(END_S):
                await opening
                await client.__aexit__(None, None, None)
        paho._sock_close()  # noqa: SLF001 - aiomqtt leaves it open if an exception ended the connection


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


async def uncancelled(call: Awaitable[object]) -> None:
    """Await a call of aiomqtt, and raise CancelledError if the task was cancelled meanwhile.

    aiomqtt waits by `asyncio.wait_for`, which loses a cancellation before Python 3.12. To be used in tasks
    of a group: before 3.13, the task that has the group counts as cancelled after one of them has failed.
    """
    await call
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError
