"""uvicorn's websocket protocol, which parses no more of what a client sends than its reader can take.

uvicorn stops reading once a message waits for the application. By then it has parsed all that the socket had,
up to 256 kB or thousands of messages. It never stops for frames that are no messages, such as pings.

No core: it waits for a socket.
"""

import asyncio
from typing import Any

from uvicorn.protocols.utils import ClientDisconnected
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame

from pointit.bridges.web.pages.latest_values import TokenBucket

READ_BYTES = 512
"""Bytes that are read and parsed at a time: some messages of a page, at most 85 frames."""

CONTROL_HZ = 5.0
CONTROL_BURST = 40.0
"""Rate limit of a client's frames that are no message of their own: pings, pongs, parts of messages. Browsers
send a pong for each ping of ours."""


class PacedWebSocket(WebSocketsSansIOProtocol, asyncio.BufferedProtocol):
    """Reads `READ_BYTES` at a time, and nothing while a message waits or the client is over `CONTROL_HZ`.

    The receiver of the messages waits before each one until the page may send another.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        """Create it with the arguments of uvicorn's protocol."""
        super().__init__(*arguments, **options)
        self._buffer = memoryview(bytearray(READ_BYTES))
        self._control_bucket = TokenBucket(CONTROL_HZ, CONTROL_BURST)
        self._is_over_limit = False
        """The client has sent too many frames, and the transport is paused until `_on_allowance`."""
        self._allowance_timer: asyncio.TimerHandle | None = None

    def get_buffer(self, sizehint: int) -> memoryview:  # noqa: ARG002 - asyncio's interface
        """Return the buffer that the transport reads into; its size limits what is parsed at a time."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Parse what was read."""
        self.data_received(bytes(self._buffer[:nbytes]))
        self._pause_if_over_limit()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the pause."""
        if self._allowance_timer is not None:
            self._allowance_timer.cancel()
        super().connection_lost(exc)

    async def receive(self) -> Any:
        """Return the next message for the application. A client over its limit stays paused."""
        message = await super().receive()
        if self._is_over_limit:
            self.transport.pause_reading()
        return message

    async def send(self, message: Any) -> None:
        """Send a message of the application.

        Raises:
            ClientDisconnected: If the connection is closing. uvicorn raises RuntimeError after it has closed
                one that does not answer pings, of which the application does not know yet.
        """
        try:
            await super().send(message)
        except RuntimeError as error:
            if not self.close_sent:
                raise
            raise ClientDisconnected from error

    def handle_ping(self) -> None:
        """Answer a ping, which counts."""
        self._count_control_frame()
        super().handle_ping()

    def handle_pong(self, event: Frame) -> None:
        """Process a pong, which counts, asked for or not."""
        self._count_control_frame()
        super().handle_pong(event)

    def handle_cont(self, event: Frame) -> None:
        """Process a further part of a message, which counts: it may be empty."""
        self._count_control_frame()
        super().handle_cont(event)

    def send_receive_event_to_app(self) -> None:
        """Queue a message. After a close by this side, when nobody receives it, it counts like a ping."""
        if self.close_sent:
            self._count_control_frame()
        super().send_receive_event_to_app()

    def _count_control_frame(self) -> None:
        # a debt is possible: all frames of one read are parsed
        self._control_bucket.reserve(self.loop.time())

    def _pause_if_over_limit(self) -> None:
        wait_s = self._control_bucket.wait_s(self.loop.time())
        if wait_s <= 0.0 or self._is_over_limit:
            return
        if self.transport.is_closing():
            return
        self._is_over_limit = True
        self.transport.pause_reading()
        self._allowance_timer = self.loop.call_later(wait_s, self._on_allowance)

    def _on_allowance(self) -> None:
        self._is_over_limit = False
        # uvicorn has paused it as well while a message waits, and resumes it then
        if not self.read_paused:
            self.transport.resume_reading()
