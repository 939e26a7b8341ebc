"""Connection to a Home Assistant by its WebSocket API.

https://developers.home-assistant.io/docs/api/websocket

No core: it waits for a server.
"""

import asyncio
import contextlib
import importlib.util
import json
import logging
import re
import socket
import ssl
import time
from collections.abc import AsyncGenerator, Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NoReturn, cast
from urllib.parse import urlsplit

from pointit.bridges.home_assistant.config import HomeAssistantConfig
from pointit.bridges.home_assistant.home_action import ServiceCall
from pointit.bridges.home_assistant.home_connection import (
    ActionRefusedError,
    NoHomeAssistantError,
    is_list,
    is_state,
)
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.certificate_errors import certificate_error_in, describe_certificate_error
from pointit.runtime.host.extras import remedy
from pointit.runtime.mqtt.broker import encrypts
from pointit.schemas.text import one_line, system_reason

if TYPE_CHECKING:
    from websockets.asyncio.client import ClientConnection

CONNECT_TIMEOUT_S = 10.0
REPLY_TIMEOUT_S = 30.0
"""Time for Home Assistant to carry out a command, s. Some lamps take seconds."""
PROBE_TIMEOUT_S = 3.0
MAX_MESSAGE_BYTES = 16 * 2**20
"""Limit of a message: all states of a home of 10 000 entities have some 10 MB."""
MAX_QUEUED_FRAMES = 4
MIN_READ_BYTES = 128
"""Least size of what is read in a turn of the loop: some ten of the smallest frames."""
MAX_READ_BYTES = 2**12
"""The same while messages are quick to take."""
MAX_TURN_S = 0.002
"""Time that messages take before others get their turn, s."""
MAX_SHARE = 0.25
"""Share of the time that messages take while there are many."""
MAX_ENTRY_CHARS = 2**17
"""Limit of an entry of a list, such as a state, and of any other message. Longer ones are left out."""
MAX_ENTRIES = 50_000
"""Limit of the entries of a list. Further ones are left out."""
TOO_BIG = 1009
"""Code by which a websocket is closed after a message above its limit."""
_LIST_RESULT = re.compile(
    r'\{\s*"id"\s*:\s*(\d{1,15})\s*,\s*"type"\s*:\s*"result"\s*,\s*"success"\s*:\s*true\s*,\s*"result"\s*:\s*\['
)
"""Start of a result that is a list, which is read entry by entry."""
_SEPARATOR = re.compile(r"[\s,]*")
_NEXT_STATE = re.compile(r',\s*\{\s*"entity_id"')  # the entry after one that is too long
_ENTRIES = json.JSONDecoder()
LOST = "the connection is lost: wait until Home Assistant runs again"
MAX_REASON = 200
"""Characters of an error of Home Assistant that are shown."""
REDIRECT = range(300, 400)
BAD_REQUEST = 400
NOT_FOUND = 404
_GATEWAY = "the proxy at {url} does not reach Home Assistant ({status}): start it"
STATUS_PROBLEMS: Mapping[int, str] = {
    BAD_REQUEST: "a server answers at {url}, and refuses the connection (400): add the proxy in front of "
    "Home Assistant to `trusted_proxies` there, have it pass WebSockets on, or write the address of Home "
    "Assistant itself as `url`",
    401: "the proxy at {url} asks for a login (401), which PointIt does not have: write the address of Home "
    "Assistant itself as `url`",
    403: "Home Assistant at {url} blocks this machine (403) after wrong logins: remove its address from "
    "ip_bans.yaml there and restart it",
    **dict.fromkeys((502, 503, 504), _GATEWAY),
}
"""Meaning of statuses of HTTP, with the remedy."""
AUTHORITY_HINT = "set the variable SSL_CERT_FILE to a file with its authority's certificate"
_logger = logging.getLogger("pointit.home_assistant.websocket")
_logger.setLevel(logging.INFO)  # the library logs all frames, also that with the token, at the level DEBUG


class LoginError(ConfigError):
    """Home Assistant rejects the token. Repeated, it makes it block this machine."""


class Pace:
    """Limits the share of the time that a task takes, so that pointing goes on beside it."""

    def __init__(self) -> None:
        """Begin with nothing taken."""
        self._used_s = 0.0
        self._begin_s = 0.0

    def begin(self) -> None:
        """Note that the task begins to work."""
        self._begin_s = time.perf_counter()

    async def rest(self) -> None:
        """Give others their turn if the task has taken enough."""
        self._used_s += time.perf_counter() - self._begin_s
        if self._used_s >= MAX_TURN_S:
            pause_s = self._used_s * (1 / MAX_SHARE - 1)
            self._used_s = 0.0
            await asyncio.sleep(pause_s)
        self.begin()


def require_client() -> None:
    """Check that the extra is installed. Raises ConfigError."""
    if importlib.util.find_spec("websockets") is None:
        raise ConfigError(f"Home Assistant needs an extra: run {remedy('home-assistant')}")


class HomeAssistantConnection:
    """Commands to a Home Assistant and their replies, and its events."""

    def __init__(self, websocket: "ClientConnection") -> None:
        """Use an authenticated `websocket`."""
        self._websocket = websocket
        self._pace = Pace()
        self._last_id = 0
        self._replies: dict[int, asyncio.Future[Any]] = {}
        self._handlers: dict[int, Callable[[Mapping[str, Any]], None]] = {}

    @property
    def refusals(self) -> Sequence[str]:
        """Return nothing: all that Home Assistant has can be used."""
        return ()

    async def request(self, command: str, **fields: Any) -> Any:
        """Send a command and return its result. Requires a task in `read`.

        Raises:
            ActionRefusedError: If Home Assistant does not carry it out. Its sentence.
            TimeoutError: If it does not reply within `REPLY_TIMEOUT_S`.
        """
        return await self._send_request(self._next_id(), command, fields)

    async def states(self) -> dict[str, Mapping[str, Any]]:
        """Return the states of all entities, by entity. Raises as `request`."""
        states = await self.request("get_states")
        if not is_list(states):
            return {}
        return {state["entity_id"]: state for state in states if is_state(state)}

    async def is_starting(self) -> bool:
        """Return True if Home Assistant says that it has not loaded everything yet. Raises as `request`."""
        settings = await self.request("get_config")
        state = _fields(settings).get("state")
        return isinstance(state, str) and state in ("NOT_RUNNING", "STARTING")

    async def subscribe(self, event: str, handler: Callable[[Mapping[str, Any]], None]) -> None:
        """Call `handler` with the data of all events of a type. Raises as `request`."""
        number = self._next_id()
        self._handlers[number] = handler
        await self._send_request(number, "subscribe_events", {"event_type": event})

    async def call(self, call: ServiceCall) -> str:
        """Run an action. Return the id of the context of its changes, or `""`. Raises as `request`."""
        result = await self.request(
            "call_service",
            domain=call.domain,
            service=call.service,
            service_data=dict(call.data),
            target={"entity_id": call.entity},
        )
        context = _fields(result).get("context")
        context_id = _fields(context).get("id")
        return context_id if isinstance(context_id, str) else ""

    async def read(self) -> None:
        """Hand on replies and events until the connection is lost.

        Raises:
            NoHomeAssistantError: If it is lost.
        """
        from websockets.exceptions import ConnectionClosed  # noqa: PLC0415 - an extra

        try:
            while True:
                text = await self._websocket.recv()
                self._pace.begin()
                head = _LIST_RESULT.match(text) if isinstance(text, str) else None

                # A list of all entities may be long, so others have their turn between its entries
                if isinstance(text, str) and head is not None:
                    entries = await self._read_entries(text, head.end())
                    number = int(head[1])
                    self._on_message({"id": number, "type": "result", "success": True, "result": entries})
                elif len(text) <= MAX_ENTRY_CHARS:
                    for message in _messages(text):
                        self._on_message(message)
                await self._pace.rest()
        except ConnectionClosed as error:
            if error.sent is not None and error.sent.code == TOO_BIG:
                raise NoHomeAssistantError(
                    f"Home Assistant sends more than {MAX_MESSAGE_BYTES >> 20} MiB at once: remove entities"
                ) from error
            raise NoHomeAssistantError(LOST) from error
        finally:
            for reply in self._replies.values():
                reply.cancel()

    async def _read_entries(self, text: str, start: int) -> list[Mapping[str, Any]]:
        """Return the objects in the list that begins at `start` of `text`, which gives others their turn."""
        entries: list[Mapping[str, Any]] = []
        while len(entries) < MAX_ENTRIES:
            separator = cast("re.Match[str]", _SEPARATOR.match(text, start))
            start = separator.end()
            try:
                entry, length = _ENTRIES.raw_decode(text[start : start + MAX_ENTRY_CHARS])
            except (ValueError, RecursionError):  # the end of the list, an entry that is too long, or no JSON
                next_state = _NEXT_STATE.search(text, start + MAX_ENTRY_CHARS)
                if next_state is None:
                    break
                entry = None
                length = next_state.start() - start
            start += length
            if isinstance(entry, dict):
                entries.append(cast("Mapping[str, Any]", entry))
            await self._pace.rest()
        return entries

    def _next_id(self) -> int:
        self._last_id += 1
        return self._last_id

    async def _send_request(self, number: int, command: str, fields: Mapping[str, Any]) -> Any:
        from websockets.exceptions import ConnectionClosed  # noqa: PLC0415 - an extra

        reply: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        self._replies[number] = reply
        try:
            await self._websocket.send(json.dumps({**fields, "id": number, "type": command}))
            async with asyncio.timeout(REPLY_TIMEOUT_S):
                return await reply
        except ConnectionClosed as error:
            raise NoHomeAssistantError(LOST) from error
        finally:
            del self._replies[number]

    def _on_message(self, message: Mapping[str, Any]) -> None:
        number = message.get("id")
        kind = message.get("type")
        if not isinstance(number, int):
            return
        reply = self._replies.get(number)
        handler = self._handlers.get(number)
        if kind == "event" and handler is not None:
            event = _fields(message.get("event"))
            handler(_fields(event.get("data")))
        elif kind == "result" and reply is not None:
            if reply.done():  # nobody waits for it any more
                return
            if message.get("success"):
                reply.set_result(message.get("result"))
            else:
                error = _fields(message.get("error"))
                text = one_line(str(error.get("message", "it gives no reason")), MAX_REASON)
                reply.set_exception(ActionRefusedError(text, str(error.get("code", ""))))


def _fields(value: object) -> Mapping[str, Any]:
    """Return the fields of an object, none of anything else."""
    return cast("Mapping[str, Any]", value) if isinstance(value, dict) else {}


def _messages(text: str | bytes) -> Sequence[Mapping[str, Any]]:
    """Return the messages in a frame: one, or several in a list. Without those that are no objects."""
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        return ()
    values = cast("list[object]", value) if isinstance(value, list) else [value]
    return [cast("Mapping[str, Any]", message) for message in values if isinstance(message, dict)]


@contextlib.asynccontextmanager
async def connected(config: HomeAssistantConfig) -> AsyncGenerator[HomeAssistantConnection]:
    """Yield an authenticated connection.

    Raises:
        LoginError: If the token is rejected.
        ConfigError: If there is no token.
        NoHomeAssistantError: If there is no Home Assistant at the address. One sentence with the remedy.
    """
    from websockets.asyncio.client import ClientConnection, connect  # noqa: PLC0415 - an extra
    from websockets.exceptions import ConnectionClosed, InvalidHandshake  # noqa: PLC0415

    # The library reads all that a socket has, up to 256 kB at once, whatever it takes to parse
    class PacedConnection(ClientConnection, asyncio.BufferedProtocol):
        """Reads as much in a turn of the loop as it handles at once, and pauses if that takes long."""

        size = MIN_READ_BYTES

        def get_buffer(self, sizehint: int) -> memoryview:
            del sizehint
            self.received = memoryview(bytearray(self.size))
            return self.received

        def buffer_updated(self, nbytes: int) -> None:
            begin_s = time.perf_counter()
            self.data_received(bytes(self.received[:nbytes]))
            used_s = time.perf_counter() - begin_s
            if used_s < MAX_TURN_S / 4:
                self.size = min(self.size * 2, MAX_READ_BYTES)
            elif used_s > MAX_TURN_S:
                self.size = MIN_READ_BYTES
                self.transport.pause_reading()
                self.loop.call_later(used_s * (1 / MAX_SHARE - 1), self.resume)

        def resume(self) -> None:
            if not self.recv_messages.paused and not self.transport.is_closing():
                self.transport.resume_reading()

    class Connect(connect):
        """Follows no redirect: another server would get the token."""

        def process_redirect(self, exc: Exception) -> Exception:
            return exc

    # What is missing here is reported before anything is sent
    require_client()
    config.check_home_assistant()
    token = await asyncio.to_thread(config.read_token)
    connecting = Connect(
        config.websocket_url,
        open_timeout=CONNECT_TIMEOUT_S,
        close_timeout=1.0,
        compression=None,  # a few bytes of it can become many
        create_connection=PacedConnection,
        max_size=MAX_MESSAGE_BYTES,
        max_queue=MAX_QUEUED_FRAMES,
        proxy=None,
        logger=_logger,
    )
    try:
        websocket = await connecting
    except (OSError, EOFError, UnicodeError, InvalidHandshake) as error:  # TimeoutError is an OSError
        await _raise_connect_error(config, error)

    # The token goes only to what begins as a Home Assistant
    try:
        try:
            await _log_in(config, websocket, token)
        except (ConnectionClosed, TimeoutError):
            raise NoHomeAssistantError(_is_none(config, "it does not begin as one")) from None
        yield HomeAssistantConnection(websocket)
    finally:
        try:
            await websocket.close()
        finally:  # also if that is cancelled: its task of pings would stay
            websocket.transport.abort()
            await websocket.wait_closed()


async def _log_in(config: HomeAssistantConfig, websocket: "ClientConnection", token: str) -> None:
    """Send `token` to what has begun as a Home Assistant does."""
    async with asyncio.timeout(CONNECT_TIMEOUT_S):
        greeting = _messages(await websocket.recv())
        if [message.get("type") for message in greeting] != ["auth_required"]:
            raise NoHomeAssistantError(_is_none(config, "it does not begin as one"))
        await websocket.send(json.dumps({"type": "auth", "access_token": token}))
        for answer in _messages(await websocket.recv()):
            if answer.get("type") == "auth_ok":
                return
            if answer.get("type") == "auth_invalid":
                raise LoginError(
                    f"Home Assistant at {config.url} rejects the token in {config.token_file}: make a new "
                    "long-lived access token in your profile there, Security, and write it into the file"
                )
    raise NoHomeAssistantError(_is_none(config, "it does not answer as one"))


def _is_none(config: HomeAssistantConfig, reason: str) -> str:
    return f"{config.url} is no Home Assistant ({reason}): correct `url`, its usual port is 8123"


def _status_problem(config: HomeAssistantConfig, status: int, headers: Mapping[str, str]) -> str:
    """Return the meaning of a status of HTTP, with the remedy, or `""` if it is that of any server."""
    location = headers.get("Location", "")
    path = urlsplit(config.url).path
    with contextlib.suppress(ValueError):  # some text that is no address
        redirected = urlsplit(location)
        location = f"{redirected.scheme}://{redirected.netloc}"
    if status in REDIRECT and location.startswith(("https://", "http://")):
        location = one_line(location, MAX_REASON)
        return f"the server at {config.url} refers to another address: write {location} as `url`"
    if status == NOT_FOUND and path:
        address = config.url.removesuffix(path)
        return f"no Home Assistant is at {path} of {address} (404): write {address} as `url`"
    return STATUS_PROBLEMS.get(status, "").format(url=config.url, status=status)


async def _raise_connect_error(config: HomeAssistantConfig, error: Exception) -> NoReturn:
    """Raise the meaning of an error of a connection, with the remedy."""
    from websockets.exceptions import InvalidStatus  # noqa: PLC0415 - an extra

    parts = urlsplit(config.url)
    host = parts.hostname or ""
    is_encrypted = config.websocket_url.startswith("wss")
    problem = (
        f"no Home Assistant answers at {config.url} ({system_reason(error, MAX_REASON)})"
        ": start it, or correct `url`, its usual port is 8123"
    )

    # From the most certain cause to the least
    may_encrypt = not isinstance(error, OSError)
    refusal = certificate_error_in(error)
    if refusal is not None:
        problem = describe_certificate_error(refusal, f"Home Assistant at {parts.netloc}", AUTHORITY_HINT)
    elif isinstance(error, InvalidStatus):
        status = error.response.status_code
        problem = _status_problem(config, status, error.response.headers)
        may_encrypt = not problem or status == BAD_REQUEST
        problem = problem or _is_none(config, f"it answers {status}")
    elif is_encrypted and isinstance(error, ssl.SSLError | ConnectionResetError | ConnectionAbortedError):
        plain_url = f"http://{parts.netloc}{parts.path}"
        problem = f"the server at {config.url} does not encrypt: write {plain_url} as `url`"
    elif isinstance(error, socket.gaierror):
        reason = one_line(str(error), MAX_REASON)
        problem = (
            f"the name {host} in `url` is not known in this network ({reason}): "
            "correct it, or write the IP address"
        )
    elif isinstance(error, TimeoutError):
        problem = f"no Home Assistant answers at {config.url} within {CONNECT_TIMEOUT_S:g} s: correct `url`"
    elif may_encrypt:
        problem = _is_none(config, "it does not answer as one")

    # What answers without sense, or with 400, may want TLS: a connection tells
    if may_encrypt and not is_encrypted:
        port = parts.port or 80
        if await encrypts(host, port, PROBE_TIMEOUT_S):
            encrypted_url = f"https://{parts.netloc}{parts.path}"
            problem = f"the server at {config.url} encrypts: write {encrypted_url} as `url`"
    raise NoHomeAssistantError(problem) from error
