"""Connection to a Home Assistant by its WebSocket API.

https://developers.home-assistant.io/docs/api/websocket

No core: it waits for a server.
"""

import asyncio
import contextlib
import importlib.util
import json
import re
import time
from collections.abc import AsyncGenerator, Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

from pointit.bridges.home_assistant.config import HomeAssistantConfig
from pointit.bridges.home_assistant.connection_problem import connection_problem, no_home_assistant
from pointit.bridges.home_assistant.home_action import ServiceCall
from pointit.bridges.home_assistant.home_connection import (
    ActionRefusedError,
    NoHomeAssistantError,
    is_list,
    is_state,
)
from pointit.bridges.home_assistant.home_websocket import (
    CONNECT_TIMEOUT_S,
    GREETING,
    MAX_MESSAGE_BYTES,
    MAX_SHARE,
    MAX_TURN_S,
    messages_in,
    open_websocket,
)
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy
from pointit.schemas.text import one_line

if TYPE_CHECKING:
    from websockets.asyncio.client import ClientConnection

REPLY_TIMEOUT_S = 30.0
"""Time for Home Assistant to carry out a command, s. Some lamps take seconds."""
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
                    for message in messages_in(text):
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


@contextlib.asynccontextmanager
async def connected(config: HomeAssistantConfig) -> AsyncGenerator[HomeAssistantConnection]:
    """Yield an authenticated connection.

    Raises:
        LoginError: If the token is rejected.
        ConfigError: If there is no token.
        NoHomeAssistantError: If there is no Home Assistant at the address. One sentence with the remedy.
    """
    from websockets.exceptions import ConnectionClosed, InvalidHandshake  # noqa: PLC0415 - an extra

    # What is missing here is reported before anything is sent
    require_client()
    config.check_home_assistant()
    token = await asyncio.to_thread(config.read_token)
    try:
        websocket = await open_websocket(config.websocket_url)
    except (OSError, EOFError, UnicodeError, InvalidHandshake) as error:  # TimeoutError is an OSError
        raise NoHomeAssistantError(await connection_problem(config, error)) from error

    # The token goes only to what begins as a Home Assistant
    try:
        try:
            await _log_in(config, websocket, token)
        except (ConnectionClosed, TimeoutError):
            raise NoHomeAssistantError(no_home_assistant(config, "it does not begin as one")) from None
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
        greeting = messages_in(await websocket.recv())
        if [message.get("type") for message in greeting] != [GREETING]:
            raise NoHomeAssistantError(no_home_assistant(config, "it does not begin as one"))
        await websocket.send(json.dumps({"type": "auth", "access_token": token}))
        for answer in messages_in(await websocket.recv()):
            if answer.get("type") == "auth_ok":
                return
            if answer.get("type") == "auth_invalid":
                raise LoginError(
                    f"Home Assistant at {config.url} rejects the token in {config.token_file}: make a new "
                    "long-lived access token in your profile there, Security, and write it into the file"
                )
    raise NoHomeAssistantError(no_home_assistant(config, "it does not answer as one"))
