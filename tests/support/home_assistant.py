"""Home Assistants for tests: one that plays a recorded conversation, one in memory, and a site beside it."""

import asyncio
import contextlib
import json
from collections.abc import AsyncGenerator, AsyncIterator, Callable, Mapping
from itertools import count
from pathlib import Path
from ssl import SSLContext
from typing import Any, cast

import pytest
from websockets.asyncio.client import ClientConnection, connect
from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed, ConnectionClosedError

from pointit.bridges.home_assistant.config import HomeAssistantConfig
from pointit.bridges.home_assistant.connection import HomeAssistantConnection, LoginError, connected
from pointit.bridges.home_assistant.service import HomeAssistant
from pointit.runtime.errors import PointItError
from pointit.schemas import ActResult, Environment, Hover, SelectionEvent, ThingState, ThingStates
from pointit.schemas.environment import Thing, ThingMode
from pointit.schemas.topics import ACT_RESULTS, HOVER, MAP, SELECTION_EVENTS, THING_STATES
from tests.support.bench import Bench, background, repeated

TOKEN = "eyJhbGciOiJIUzI1NiJ9.eyJpc3MiOiI4ZGUwIn0.s3cr3t"  # noqa: S105 - of a test
VERSION = "2025.4.4"
RUNNING = {"state": "RUNNING", "version": VERSION}
"""Part of the answer to `get_config` of a Home Assistant that has started."""
LOST = ""
"""Stands for the end of a connection without a network."""
Message = dict[str, Any]


def token_file(folder: Path, token: str = TOKEN) -> Path:
    path = folder / "token"
    path.write_text(token + "\n")
    path.chmod(0o600)
    return path


def config_of(folder: Path, port: int, **parameters: Any) -> HomeAssistantConfig:
    fields = {"url": f"http://127.0.0.1:{port}", "token_file": str(token_file(folder)), **parameters}
    return HomeAssistantConfig.model_validate(fields)


def thing(name: str, action: str, mode: ThingMode = "switch") -> Thing:
    return Thing(id=name, center_m=(0, 0, 1), size_m=(0.2, 0.2, 0.2), mode=mode, home_assistant=action)


class HomeSite:
    """Map and acts of a site on a bench, as `pui` and `selector` publish them."""

    def __init__(self, bench: Bench, *things: Thing) -> None:
        self._bench = bench
        self.states: dict[str, ThingState] = {}
        """State of each thing, as its carrier tells it."""
        self.results: list[ActResult] = []
        self._stamp_ns = 1
        bench.bus.subscribe(THING_STATES, self._on_states)
        bench.bus.subscribe(ACT_RESULTS, self._on_result)
        bench.put(MAP, Environment(stamp_ns=1, name="room", things=things))

    @property
    def selected(self) -> set[str]:
        """Things that are on."""
        return {name for name, state in self.states.items() if state.state == "on"}

    @property
    def told(self) -> str:
        """Code and sentence of the last act."""
        if not self.results:
            return ""
        last = self.results[-1]
        return f"{last.code}: {last.text}"

    def point(self, name: str, *, on: bool = True, user: str = "anna") -> None:
        self._stamp_ns = max(self._stamp_ns + 1, self._bench.clock.now_ns())
        event = SelectionEvent(
            stamp_ns=self._stamp_ns,
            event="selected" if on else "deselected",
            object_id=name,
            user=user,
            carriers=("home-assistant",),
        )
        self._bench.put(SELECTION_EVENTS, event)

    def hover(self, name: str, user: str = "anna") -> None:
        self._stamp_ns += 1
        self._bench.put(HOVER, Hover(stamp_ns=self._stamp_ns, object_id=name), user)

    @contextlib.asynccontextmanager
    async def hovering(self, name: str) -> AsyncGenerator[None]:
        """Hover a thing while the block runs, as the selector repeats it."""
        try:
            async with repeated(0.1, lambda: self.hover(name)):
                yield
        finally:
            self.hover("")

    def _on_states(self, states: ThingStates, _name: str) -> None:
        self.states = {each.id: each for each in states.things}

    def _on_result(self, result: ActResult, _name: str) -> None:
        self.results.append(result)
        known = self.states[result.object_id]
        self.states[result.object_id] = known.model_copy(update={"state": result.state})


def start(bench: Bench, config: HomeAssistantConfig) -> asyncio.Task[None]:
    return bench.start(HomeAssistant, config)


class LocalSocket:
    """One end of a websocket without a network: to a `MemoryHome`, in virtual time."""

    def __init__(
        self,
        received: asyncio.Queue[str],
        sent: asyncio.Queue[str],
        is_alive: Callable[[str], bool] = lambda _effect: True,
    ) -> None:
        """Use two queues. `is_alive`: returns False for an effect that the process does not live to have."""
        self._received = received
        self._sent = sent
        self._is_alive = is_alive
        self.messages: list[Message] = []
        """Messages that were sent."""

    async def send(self, text: str) -> None:
        if self._is_alive(f"send {text}"):
            self.messages.append(json.loads(text))
            self._sent.put_nowait(text)

    async def recv(self) -> str:
        text = await self._received.get()
        if text == LOST:
            raise ConnectionClosedError(None, None)
        if not self._is_alive(f"receive {text}"):
            await asyncio.get_running_loop().create_future()  # for ever
        return text

    async def __aiter__(self) -> AsyncIterator[str]:
        while True:
            yield await self._received.get()


class MemoryHome:
    """The WebSocket API of a Home Assistant with states in memory. Its messages have the recorded form."""

    def __init__(self, states: Mapping[str, tuple[str, Mapping[str, Any]]]) -> None:
        self.states: dict[str, Message] = {}
        self.calls: list[tuple[str, str, Message]] = []
        """Calls of services that have come: `light.turn_on`, entity, data. Their effects come later."""
        self.logins: list[str] = []
        self.latency_s = 0.0
        self.report_delay_s = 0.0
        """Time from the answer of a call to the new state, as lamps with a transition take."""
        self.is_alive: Callable[[str], bool] = lambda _effect: True
        """See `LocalSocket`; of the next connection."""
        self.junk: list[Any] = []
        """Entries of the list of states that are none."""
        self.refusal = ""
        self.refusal_code = "home_assistant_error"
        self._client_queue = asyncio.Queue[str]()
        self.client = LocalSocket(self._client_queue, asyncio.Queue())
        """Client's end of the last connection without a network."""
        self.registries: dict[str, Any] = {}
        self.is_deaf = False
        """Calls succeed and do nothing."""
        self.token = TOKEN
        self.contexts: dict[str, Message] = {}
        """Context of the last change of each entity."""
        self._context_ids = count()
        self._subscriptions: list[tuple[ServerConnection, int, str]] = []
        self._last_brightness: dict[str, int] = {}
        """Brightness with which lamps that are off go on again."""
        for entity, (state, attributes) in states.items():
            self.states[entity] = {"entity_id": entity, "state": state, "attributes": dict(attributes)}

    @contextlib.asynccontextmanager
    async def serving(self, port: int = 0, ssl: SSLContext | None = None) -> AsyncGenerator[int]:
        async with serve(self._serve, "127.0.0.1", port, ssl=ssl) as server:
            yield next(iter(server.sockets)).getsockname()[1]
        self._subscriptions.clear()

    @contextlib.asynccontextmanager
    async def connected(self, config: HomeAssistantConfig) -> AsyncGenerator[HomeAssistantConnection]:
        """Yield an authenticated connection without a network, in place of that of the bridge."""
        there = asyncio.Queue[str]()
        here = asyncio.Queue[str]()
        server = LocalSocket(there, here)
        self.client = LocalSocket(here, there, self.is_alive)
        self._client_queue = here
        serving = asyncio.create_task(self._serve(cast("ServerConnection", server)))
        try:
            await self.client.recv()
            await self.client.send(json.dumps({"type": "auth", "access_token": config.read_token()}))
            if json.loads(await self.client.recv())["type"] == "auth_invalid":
                raise LoginError("Home Assistant rejects the token")
            self.client.messages.clear()
            yield HomeAssistantConnection(cast("ClientConnection", self.client))
        finally:
            serving.cancel()
            await asyncio.wait([serving])
            self._subscriptions.clear()

    def disconnect(self) -> None:
        """End the connection without a network, as a Home Assistant that restarts."""
        self._subscriptions.clear()
        self._client_queue.put_nowait(LOST)

    def new_context(self, user: str | None = None) -> Message:
        """Return a context: of a call by `user`, or of a report without a call."""
        return {"id": f"01{next(self._context_ids)}", "parent_id": None, "user_id": user}

    def set(self, entity: str, state: str | None, context: Message | None = None, **attributes: Any) -> None:
        """Change a state in a context, by default that of a device. `state`: None if it is deleted."""
        self.contexts[entity] = context or self.new_context()
        old = self.states.pop(entity, None)
        new: Message | None = None
        if state is not None:
            kept: Message = {}
            if old is not None and state != "unavailable":
                kept = old.get("attributes", {})
            new = {"entity_id": entity, "state": state, "attributes": {**kept, **attributes}}
            self.states[entity] = new
            new = {**new, "context": self.contexts[entity]}
        self.fire("state_changed", {"entity_id": entity, "old_state": old, "new_state": new})

    def fire(self, event: str, data: Message) -> None:
        for websocket, number, kind in self._subscriptions:
            if kind == event:
                message = {"id": number, "type": "event", "event": {"event_type": event, "data": data}}
                asyncio.get_running_loop().create_task(_send(websocket, message))

    async def _serve(self, websocket: ServerConnection) -> None:
        with contextlib.suppress(ConnectionClosed):
            await _send(websocket, {"type": "auth_required", "ha_version": VERSION})
            login = json.loads(await websocket.recv())
            self.logins.append(login["access_token"])
            if login["access_token"] != self.token:
                await _send(
                    websocket, {"type": "auth_invalid", "message": "Invalid access token or password"}
                )
                return
            await _send(websocket, {"type": "auth_ok", "ha_version": VERSION})
            async with asyncio.TaskGroup() as tasks:
                async for text in websocket:
                    tasks.create_task(self._answer(websocket, json.loads(text)))

    async def _answer(self, websocket: ServerConnection, command: Message) -> None:
        number = command["id"]
        result: Any = None
        if command["type"] == "get_states":
            result = [*self.junk]
            for name, state in self.states.items():
                result.append({**state, "context": self.contexts.get(name)})
        elif command["type"] == "subscribe_events":
            self._subscriptions.append((websocket, number, command["event_type"]))
        elif command["type"] == "call_service":
            result = await self._call(command)
            if self.refusal:
                error = {"code": self.refusal_code, "message": self.refusal}
                await _send(websocket, {"id": number, "type": "result", "success": False, "error": error})
                return
        else:
            result = self.registries.get(command["type"], [])
        with contextlib.suppress(ConnectionClosed):
            await _send(websocket, {"id": number, "type": "result", "success": True, "result": result})

    async def _call(self, command: Message) -> Message:
        """Note the call of a service, and do it unless it is refused. Return its result."""
        service = command["service"]
        entity = command["target"]["entity_id"]
        data = command["service_data"]
        context = self.new_context("pointit")
        delay_s = self.latency_s + self.report_delay_s
        if delay_s and not self.refusal:  # also if the client is dead by then
            asyncio.get_running_loop().call_later(delay_s, self.act, service, entity, data, context)
        self.calls.append((f"{command['domain']}.{service}", entity, data))
        await asyncio.sleep(self.latency_s)
        if not delay_s and not self.refusal:
            self.act(service, entity, data, context)
            await asyncio.sleep(0)  # the report comes before the result
        return {"context": context, "response": None}

    def act(self, service: str, entity: str, data: Message, context: Message | None = None) -> None:
        """Do to an entity what a service does, in a context, by default that of somebody in the app."""
        context = context or self.new_context("somebody")
        state = self.states.get(entity)
        if state is None or self.is_deaf:
            return
        if state["state"] == "unavailable":
            return
        is_on = state["state"] == "on"
        goes_on = service == "toggle" and not is_on
        if service == "turn_on" or goes_on:
            last = self._last_brightness.pop(entity, 180)
            attributes = data if is_on else {"brightness": last} | data
            self.set(entity, "on", context, **attributes)
        elif service in ("turn_off", "toggle"):
            if is_on:
                self._last_brightness[entity] = state["attributes"].get("brightness", 180)
            self.set(entity, "off", context, brightness=None)


async def _send(websocket: ServerConnection, message: Message) -> None:
    with contextlib.suppress(ConnectionClosed):
        await websocket.send(json.dumps(message))


@contextlib.asynccontextmanager
async def played(path: Path) -> AsyncGenerator[int]:
    """Play the server's side of a recorded conversation to each client. Yield the port."""
    lines = [json.loads(line) for line in path.read_text().splitlines()]  # noqa: ASYNC240 - of a test

    async def play(websocket: ServerConnection) -> None:
        entries = list(lines)
        first = 0
        while first < len(entries) and "server" in entries[first]:
            await _send(websocket, entries[first]["server"])
            first += 1
        entries = entries[first:]
        with contextlib.suppress(ConnectionClosed):
            async for text in websocket:
                message = json.loads(text)
                if message["type"] == "get_config":  # newer than the recording, which was of one that ran
                    reply = {"id": message["id"], "type": "result", "success": True, "result": RUNNING}
                    await _send(websocket, reply)
                    continue

                # the recorded answers to the same command, with this client's numbers
                index = _newest_index(entries, _without_secrets(_without_id(message)))
                recorded = entries.pop(index)["client"].get("id")
                numbers[recorded] = message.get("id")
                while index < len(entries) and "server" in entries[index]:
                    answer = entries.pop(index)["server"]
                    if "id" in answer:
                        answer = {**answer, "id": numbers[answer["id"]]}
                    await _send(websocket, answer)

    numbers: dict[int, int] = {}
    async with serve(play, "127.0.0.1", 0) as server:
        yield next(iter(server.sockets)).getsockname()[1]


@contextlib.asynccontextmanager
async def recording(url: str, path: Path, keep: Callable[[Message], bool]) -> AsyncGenerator[int]:
    """Forward to the websocket at `url`, and write the messages that `keep` accepts, without the token."""
    with path.open("w") as file:

        def write(side: str, text: str | bytes) -> None:
            value: Any = json.loads(text)
            messages = cast("list[Message]", value) if isinstance(value, list) else [value]
            for message in messages:
                if keep(message):
                    line = json.dumps({side: _without_secrets(message)})
                    file.write(line + "\n")

        async def forward(websocket: ServerConnection) -> None:
            async with connect(url, max_size=None) as upstream:

                async def back() -> None:
                    async for text in upstream:
                        write("server", text)
                        await websocket.send(text)

                task = asyncio.create_task(back())
                async for text in websocket:
                    write("client", text)
                    await upstream.send(text)
                task.cancel()

        async with serve(forward, "127.0.0.1", 0) as server:
            yield next(iter(server.sockets)).getsockname()[1]


def _without_secrets(message: Message) -> Message:
    if "access_token" not in message:
        return message
    return {**message, "access_token": "TOKEN"}


def _without_id(message: Message) -> Message:
    return {key: value for key, value in message.items() if key != "id"}


def _newest_index(entries: list[Message], command: Message) -> int:
    """Return the index of the last entry with `command`, which is of the newest conversation."""
    for index in reversed(range(len(entries))):
        if _without_id(entries[index].get("client", {})) == command:
            return index
    raise AssertionError(f"not in the recording: {command}")


@contextlib.asynccontextmanager
async def reading(connection: HomeAssistantConnection) -> AsyncGenerator[None]:
    """Hand on the messages of `connection` while the block runs."""
    async with background(connection.read()):
        yield


async def refusal(config: Any) -> str:
    """Return the sentence by which a connection with `config` fails. It has neither a token nor two lines."""
    with pytest.raises(PointItError) as caught:
        async with connected(config):
            pass
    assert TOKEN not in str(caught.value)
    assert "\n" not in str(caught.value)
    return str(caught.value)
