"""Websockets to a Home Assistant, whose messages take a share of the time only, and what is in a frame.

No core: it waits for a network.
"""

import asyncio
import json
import logging
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from websockets.asyncio.client import connect

CONNECT_TIMEOUT_S = 10.0
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
GREETING = "auth_required"
"""Type of the first message of a Home Assistant."""
_logger = logging.getLogger("pointit.home_assistant.websocket")
_logger.setLevel(logging.INFO)  # the library logs all frames, also that with the token, at the level DEBUG


def open_websocket(url: str) -> "connect":
    """Return the connection to the websocket at `url`, to be awaited."""
    from websockets.asyncio.client import ClientConnection, connect  # noqa: PLC0415 - an extra

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

    return Connect(
        url,
        open_timeout=CONNECT_TIMEOUT_S,
        close_timeout=1.0,
        compression=None,  # a few bytes of it can become many
        create_connection=PacedConnection,
        max_size=MAX_MESSAGE_BYTES,
        max_queue=MAX_QUEUED_FRAMES,
        proxy=None,
        logger=_logger,
    )


def messages_in(text: str | bytes) -> Sequence[Mapping[str, Any]]:
    """Return the messages in a frame: one, or several in a list. Without those that are no objects."""
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        return ()
    values = cast("list[object]", value) if isinstance(value, list) else [value]
    return [cast("Mapping[str, Any]", message) for message in values if isinstance(message, dict)]
