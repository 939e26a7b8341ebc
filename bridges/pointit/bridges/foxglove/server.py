"""The server of Foxglove's SDK, its channels and their subscribers.

The SDK calls from threads of its own; `hand_over` brings each call into the loop.
"""

import functools
from collections import Counter
from collections.abc import Callable
from typing import Any, Protocol

import foxglove
from foxglove.channels import FrameTransformsChannel, LogChannel, PointCloudChannel, SceneUpdateChannel
from foxglove.websocket import ChannelView, Client, ServerListener, WebSocketServer

from pointit.bridges.foxglove.event_log import LogLine
from pointit.bridges.foxglove.scene import PARTS, Part
from pointit.bridges.foxglove.subprotocol_relay import SubprotocolRelay
from pointit.runtime.address_config import format_address
from pointit.runtime.errors import ListenError
from pointit.schemas.catalogue.json_channel import Schema

BACKLOG = 256
"""Messages queued for a slow viewer; the oldest are dropped. About one second, and more than all channels
send to a new viewer at once."""

LOG = "/log"

HandOver = Callable[[Callable[[], None]], None]
"""Calls a function in the event loop, thread-safe."""


class SubscriptionCallback(Protocol):
    """Called when a viewer subscribes to a channel or unsubscribes."""

    def __call__(self, topic: str, *, begins: bool) -> None:
        """Handle the change."""
        ...


PictureChannel = Any
"""Channel for scenes of one part; each accepts messages of its own type."""


class Viewers(ServerListener):
    """Counts the viewers per channel and reports changes."""

    def __init__(self, hand_over: HandOver, callback: SubscriptionCallback) -> None:
        """Call `tell(topic, begins=…)` in the loop when a viewer subscribes or unsubscribes."""
        self._hand_over = hand_over
        self._tell = callback
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
        self._tell(topic, begins=begins)


class Server:
    """Channels and a read-only server: it offers no capability to clients."""

    def __init__(self, hand_over: HandOver, callback: SubscriptionCallback) -> None:
        self.viewers = Viewers(hand_over, callback)
        self._context = foxglove.Context()
        self._server: WebSocketServer | None = None
        self._relay: SubprotocolRelay | None = None
        self._pictures: dict[Part, PictureChannel] = {
            part: _channel_of(part)(picture_topic(part), context=self._context) for part in PARTS
        }
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
            return f"ws://{format_address(host, await self._relay.open(host, port))}"
        except OSError as error:
            raise ListenError(
                f"cannot listen on {host} port {port} for viewers ({error.strerror or error}); end what "
                "listens there, or give another --port or --host"
            ) from error

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
