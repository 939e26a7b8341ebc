"""Connection to an MQTT broker, by aiomqtt."""

import asyncio
import contextlib
import importlib.util
import os
import ssl
from collections.abc import AsyncGenerator, Awaitable, Callable, Coroutine
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pointit.runtime.errors import ConfigError, first_cause
from pointit.runtime.host.extras import remedy
from pointit.runtime.mqtt.broker_config import BrokerConfig

if TYPE_CHECKING:
    import aiomqtt

CONNECT_S = 5.0
"""Maximum time to connect, s."""
END_S = 0.3
"""Maximum time to take leave, s."""
PASSWORD = "MQTT_PASSWORD"  # noqa: S105 - the name of a variable
QUEUED_MESSAGES = 1000
"""Maximum number of unread messages."""


def require_client(what: str) -> None:
    """Check that the extra is installed, without which `what`, a plural, has no connection.

    Raises:
        ConfigError: If it is not.
    """
    if importlib.util.find_spec("aiomqtt") is None:
        raise ConfigError(f"{what} need an extra: run {remedy('mqtt')}")


def client_options(config: BrokerConfig) -> dict[str, Any]:
    """Return the options of `aiomqtt.Client` for the broker of `config`. Reads the password.

    Raises:
        ConfigError: If a file cannot be read.
    """
    host, port = config.address()
    password = os.environ.get(PASSWORD) if config.username else None
    try:
        if config.password_file:
            password = Path(config.password_file).read_text(encoding="utf-8").rstrip("\r\n")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"password_file: {config.password_file} cannot be read ({error})") from error
    try:
        context = ssl.create_default_context(cafile=config.ca_file or None) if config.tls else None
    except OSError as error:  # SSLError is one
        raise ConfigError(f"ca_file: {config.ca_file} cannot be used ({error})") from error
    return {
        "hostname": host,
        "port": port,
        "username": config.username or None,
        "password": password,
        "tls_context": context,
    }


@contextlib.asynccontextmanager
async def connected(options: dict[str, Any]) -> "AsyncGenerator[aiomqtt.Client]":
    """Yield a client that is connected with `options` of `aiomqtt.Client`.

    Raises:
        OSError: If nothing can be reached.
        aiomqtt.MqttError: If the broker refuses, does not answer, or goes away.
    """
    import aiomqtt  # noqa: PLC0415 - an extra

    # aiomqtt connects in a thread that cannot be interrupted and leaves a socket of a failed handshake open
    async with asyncio.timeout(CONNECT_S):
        _reader, writer = await asyncio.open_connection(
            options["hostname"], options["port"], ssl=options.get("tls_context")
        )
    writer.transport.abort()
    client = aiomqtt.Client(
        **options, timeout=CONNECT_S, keepalive=15, max_queued_incoming_messages=QUEUED_MESSAGES
    )
    opening = asyncio.ensure_future(client.__aenter__())
    try:
        await asyncio.shield(opening)  # cancelled in the middle, it would leave a socket and a task
        yield client
    finally:
        with contextlib.suppress(aiomqtt.MqttError, OSError):  # TimeoutError is one
            async with asyncio.timeout(END_S):
                await opening
                await client.__aexit__(None, None, None)


async def keep_connected(
    serve: Callable[[], Coroutine[Any, Any, None]],
    on_lost: Callable[[str], None],
    *,
    has_user: bool,
    retry_s: float,
) -> None:
    """Call `serve` again, `retry_s` after its connection was lost, until cancelled.

    `on_lost` is told why, and the remedy. Each `serve` is a task of its own: before Python 3.13, a task whose
    TaskGroup has failed goes on as cancelled, in 3.11.2, that of Debian 12, to its next `asyncio.timeout`;
    and the group loses a cancellation that comes while it fails.
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


def describe_error(error: BaseException, *, has_user: bool) -> str:
    """Return the meaning of an error of a broker, and the remedy, for a person."""
    text = str(error) or "no answer"
    if "uthor" in text or "password" in text:  # "Not authorized", "Bad user name or password"
        action = "correct" if has_user else "set"
        return f"the broker refuses the connection ({text}): {action} `username` and {PASSWORD}"
    return f"the broker cannot be reached ({text}): start it, or correct its address"
