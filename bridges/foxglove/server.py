"""The server of Foxglove's SDK, its channels and their subscribers.

The SDK calls from threads of its own; `hand_over` brings each call into the loop.

Listener in front of the SDK's server, which accepts the names of its own subprotocols alone.

`foxglove.websocket.v1`, which viewers offer that are older or not Foxglove's, and `foxglove.sdk.v1` are the
same protocol (github.com/orgs/foxglove/discussions/1131). The names in the handshake are exchanged, and what
follows is passed on as it is.

No core: it waits for connections and for threads of a library.
"""

import asyncio
import contextlib
import functools
import logging
import socket
from collections import Counter
from collections.abc import Callable
from typing import Any

import foxglove
from foxglove.channels import FrameTransformsChannel, LogChannel, PointCloudChannel, SceneUpdateChannel
from foxglove.websocket import ChannelView, Client, ServerListener, WebSocketServer

from pointit.bridges.foxglove.event_log import LogLine
from pointit.bridges.foxglove.scene import PARTS, Part
from pointit.plugins import ListenError, format_address
from pointit.runtime.host.name_lookup import resolve
from pointit.schemas.catalogue.json_channel import Schema
from pointit.schemas.text import one_line, system_reason

log = logging.getLogger(__name__)

HandOver = Callable[[Callable[[], None]], None]
"""Calls a function in the event loop, thread-safe."""

SubscriptionCallback = Callable[[str, bool], None]
"""Called with a channel's topic, and True if a viewer subscribes, False if it unsubscribes."""

PictureChannel = Any
"""Channel for scenes of one part; each accepts messages of its own type."""

OLD = "foxglove.websocket.v1"
NEW = "foxglove.sdk.v1"
HEADER = "sec-websocket-protocol"
SWITCHING = 101
TLS_HANDSHAKE = b"\x16"
HANDSHAKE_TIMEOUT_S = 10.0
CLOSE_TIMEOUT_S = 0.3
"""Maximum time for the last frames to viewers, s."""
MAX_CHUNK_BYTES = 65536
MAX_NAMES = 100
"""Maximum number of characters in the log of the names that a client offers."""
MAX_REFUSALS = 16
"""Maximum number of different refusals in the log."""

BACKLOG = 256
"""Messages queued for a slow viewer; the oldest are dropped. About one second, and more than all channels
send to a new viewer at once."""

LOG = "/log"


class SubprotocolRelay:
    """Passes connections on to a server of this machine, and exchanges names in their handshake."""

    def __init__(self, port: int) -> None:
        """Pass on to `port` of the loopback."""
        self._target_port = port
        self._server: asyncio.Server | None = None
        self._connections = set[asyncio.Task[None]]()
        self._refusals = set[str]()

    async def open(self, host: str, port: int) -> int:
        """Listen at `port` of `host` (0: any free one); return the port.

        Raises:
            OSError: If it is taken, or the host is not of this machine.
        """
        family, address = resolve(host, port, socket.SOCK_STREAM)[0]
        is_dual = family == socket.AF_INET6 and socket.has_dualstack_ipv6()
        listener = socket.create_server(address, family=family, dualstack_ipv6=is_dual)
        self._server = await asyncio.start_server(self._accept, sock=listener)
        number: int = listener.getsockname()[1]
        return number

    async def close(self) -> None:
        """Stop listening, and end all connections once the target's last frames have left."""
        if self._server is not None:
            self._server.close()
        if self._connections:
            await asyncio.wait(self._connections, timeout=CLOSE_TIMEOUT_S)
        for connection in self._connections:
            connection.cancel()
        await asyncio.gather(*self._connections, return_exceptions=True)

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        connection = asyncio.create_task(self._serve(reader, writer), name="viewer of Foxglove")
        self._connections.add(connection)
        connection.add_done_callback(self._connections.discard)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.closing(writer), contextlib.suppress(OSError, EOFError, asyncio.LimitOverrunError):
            # The viewer's request
            async with asyncio.timeout(HANDSHAKE_TIMEOUT_S):  # TimeoutError is an OSError
                first = await reader.readexactly(1)
                if first == TLS_HANDSHAKE:
                    self._refuse(writer, "it asks for encryption: open ws:// in it, not wss://")
                    return
                request = first + await reader.readuntil(b"\r\n\r\n")
                target_reader, target = await asyncio.open_connection("127.0.0.1", self._target_port)
            with contextlib.closing(target):
                # The SDK's response, by the name that the viewer knows. A refusal is passed on, too
                names = names_of(request)
                target.write(rename(request, OLD, NEW))
                async with asyncio.timeout(HANDSHAKE_TIMEOUT_S):
                    response = await target_reader.readuntil(b"\r\n\r\n")
                status = response.split(b" ")[1:2]
                if status != [b"%d" % SWITCHING]:
                    self._refuse_names(writer, names)
                if NEW not in names:
                    response = rename(response, NEW, OLD)
                writer.write(response)
                await _exchange(reader, writer, target_reader, target)

    def _refuse_names(self, writer: asyncio.StreamWriter, names: list[str]) -> None:
        offered = one_line(", ".join(names), MAX_NAMES) or "no subprotocol"
        reason = (
            f"it offers {offered}, and {NEW} or {OLD} is needed: choose *Foxglove WebSocket* "
            "as its kind of connection"
        )
        self._refuse(writer, reason)

    def _refuse(self, writer: asyncio.StreamWriter, reason: str) -> None:
        if reason not in self._refusals and len(self._refusals) < MAX_REFUSALS:
            self._refusals.add(reason)
            host, *_ = writer.get_extra_info("peername") or ("an unknown address",)
            log.warning("a viewer at %s was refused: %s", host, reason)


async def _exchange(
    reader: asyncio.StreamReader,
    writer: asyncio.StreamWriter,
    target_reader: asyncio.StreamReader,
    target: asyncio.StreamWriter,
) -> None:
    """Pass everything on in both directions, until one of them ends."""
    to_target = asyncio.create_task(_pass_on(reader, target))
    to_viewer = asyncio.create_task(_pass_on(target_reader, writer))
    directions = {to_target, to_viewer}
    try:
        await asyncio.wait(directions, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for direction in directions:
            direction.cancel()
        await asyncio.gather(*directions, return_exceptions=True)


async def _pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while data := await reader.read(MAX_CHUNK_BYTES):
        writer.write(data)
        await writer.drain()


def names_of(head: bytes) -> list[str]:
    """Return the subprotocols that the header of a handshake names."""
    names: list[str] = []
    for field, value in _fields(head):
        if field == HEADER:
            names += filter(None, map(str.strip, value.split(",")))
    return names


def rename(head: bytes, old: str, new: str) -> bytes:
    """Return the header of a handshake with the subprotocol `new` in place of `old`."""
    lines = head.split(b"\r\n")
    for number, (field, value) in enumerate(_fields(head), start=1):
        if field == HEADER:
            names = [name.strip() for name in value.split(",")]
            renamed = dict.fromkeys(new if name == old else name for name in names)
            line = f"{field}: {', '.join(renamed)}"
            lines[number] = line.encode("latin-1")
    return b"\r\n".join(lines)


def _fields(head: bytes) -> list[tuple[str, str]]:
    """Return name and value of each line but the first."""
    fields: list[tuple[str, str]] = []
    for line in head.split(b"\r\n")[1:]:
        name, _, value = line.decode("latin-1").partition(":")
        fields.append((name.strip().lower(), value))
    return fields


class Viewers(ServerListener):
    """Counts the viewers per channel and reports changes."""

    def __init__(self, hand_over: HandOver, callback: SubscriptionCallback) -> None:
        """Call `callback` in the loop when a viewer subscribes or unsubscribes."""
        self._hand_over = hand_over
        self._callback = callback
        self._counts = Counter[str]()

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:  # noqa: ARG002 - the SDK's signature
        """Handle a call of the SDK."""
        self._pass_on(channel.topic, begins=True)

    def on_unsubscribe(self, client: Client, channel: ChannelView) -> None:  # noqa: ARG002 - the SDK's signature
        """Handle a call of the SDK."""
        self._pass_on(channel.topic, begins=False)

    def of(self, topic: str) -> int:
        """Return the number of viewers of a channel."""
        return self._counts[topic]

    @property
    def any(self) -> bool:
        """Return True if a viewer has subscribed to any channel."""
        return self._counts.total() > 0

    def _pass_on(self, topic: str, *, begins: bool) -> None:
        self._hand_over(functools.partial(self._count, topic, begins=begins))

    def _count(self, topic: str, *, begins: bool) -> None:
        self._counts[topic] += 1 if begins else -1
        if self._counts[topic] <= 0:
            del self._counts[topic]
        self._callback(topic, begins)


class Server:
    """Channels and a read-only server: it offers no capability to clients."""

    def __init__(self, hand_over: HandOver, callback: SubscriptionCallback) -> None:
        self.viewers = Viewers(hand_over, callback)
        self._context = foxglove.Context()
        self._server: WebSocketServer | None = None
        self._relay: SubprotocolRelay | None = None
        self._pictures: dict[Part, PictureChannel] = {}
        for part in PARTS:
            new_channel = _channel_of(part)
            self._pictures[part] = new_channel(picture_topic(part), context=self._context)
        self._log = LogChannel(LOG, context=self._context)

    async def open(self, name: str, host: str, port: int) -> str:
        """Listen on `host` and `port` (0: any free one); return the address.

        Raises:
            ListenError: If the address is taken or not of this machine.
        """
        self._server = foxglove.start_server(
            name=name,
            host="127.0.0.1",
            port=0,
            capabilities=[],
            server_listener=self.viewers,
            context=self._context,
            message_backlog_size=BACKLOG,
        )
        self._relay = SubprotocolRelay(self._server.port)
        try:
            listening_port = await self._relay.open(host, port)
        except OSError as error:
            problem = system_reason(error)
            raise ListenError(
                f"cannot listen on {host} port {port} for viewers ({problem}); end what "
                "listens there, or give another --port or --host"
            ) from error
        return f"ws://{format_address(host, listening_port)}"

    def channel(self, topic: str, schema: Schema) -> foxglove.Channel:
        """Return a new channel for JSON."""
        return foxglove.Channel(topic, schema=schema, context=self._context)

    def show(self, part: Part, picture: Any, now_ns: int) -> None:
        """Send a picture of `part` to its viewers."""
        self._pictures[part].log(picture, log_time=now_ns)

    def say(self, line: LogLine) -> None:
        """Send a line to the viewers of the log."""
        self._log.log(line.log(), log_time=line.at_ns)

    async def close(self) -> None:
        """Disconnect all viewers and stop listening."""
        if self._server is not None:
            self._server.stop()
        if self._relay is not None:
            await self._relay.close()


def picture_topic(part: Part) -> str:
    """Return the channel that shows `part`."""
    return "/tf" if part == "frames" else f"/scene/{part}"


def _channel_of(part: Part) -> Callable[..., PictureChannel]:
    if part == "pixels":
        return PointCloudChannel
    return FrameTransformsChannel if part == "frames" else SceneUpdateChannel
