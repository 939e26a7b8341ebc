"""Listener in front of the SDK's server, which accepts the names of its own subprotocols alone.

`foxglove.websocket.v1`, which viewers offer that are older or not Foxglove's, and `foxglove.sdk.v1` are the
same protocol (github.com/orgs/foxglove/discussions/1131). The names in the handshake are exchanged, and what
follows is passed on as it is.
"""

import asyncio
import contextlib
import logging
import socket

from pointit.runtime.host.name_lookup import resolve
from pointit.schemas.text import one_line

log = logging.getLogger(__name__)

OLD, NEW = "foxglove.websocket.v1", "foxglove.sdk.v1"
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
            async with asyncio.timeout(HANDSHAKE_TIMEOUT_S):  # TimeoutError is an OSError
                first = await reader.readexactly(1)
                if first == TLS_HANDSHAKE:
                    self._refuse(writer, "it asks for encryption: open ws:// in it, not wss://")
                    return
                request = first + await reader.readuntil(b"\r\n\r\n")
                target_reader, target = await asyncio.open_connection("127.0.0.1", self._target_port)
            with contextlib.closing(target):
                offered = names_of(request)
                target.write(rename(request, OLD, NEW))
                async with asyncio.timeout(HANDSHAKE_TIMEOUT_S):
                    response = await target_reader.readuntil(b"\r\n\r\n")
                if response.split(b" ")[1:2] != [b"%d" % SWITCHING]:
                    shown = one_line(", ".join(offered), MAX_NAMES) or "no subprotocol"
                    self._refuse(
                        writer,
                        f"it offers {shown}, and {NEW} or {OLD} is needed: choose *Foxglove WebSocket* "
                        "as its kind of connection",
                    )
                writer.write(response if NEW in offered else rename(response, NEW, OLD))
                await _exchange(reader, writer, target_reader, target)

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
    directions = {
        asyncio.create_task(_pass_on(reader, target)),
        asyncio.create_task(_pass_on(target_reader, writer)),
    }
    try:
        await asyncio.wait(directions, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for each in directions:
            each.cancel()
        await asyncio.gather(*directions, return_exceptions=True)


async def _pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while data := await reader.read(MAX_CHUNK_BYTES):
        writer.write(data)
        await writer.drain()


def names_of(head: bytes) -> list[str]:
    """Return the subprotocols that the header of a handshake names."""
    values = [value for name, value in _fields(head) if name == HEADER]
    return [name.strip() for value in values for name in value.split(",") if name.strip()]


def rename(head: bytes, old: str, new: str) -> bytes:
    """Return the header of a handshake with the subprotocol `new` in place of `old`."""
    lines = head.split(b"\r\n")
    for number, (field, value) in enumerate(_fields(head), start=1):
        if field == HEADER:
            names = [new if name.strip() == old else name.strip() for name in value.split(",")]
            lines[number] = f"{field}: {', '.join(dict.fromkeys(names))}".encode("latin-1")
    return b"\r\n".join(lines)


def _fields(head: bytes) -> list[tuple[str, str]]:
    """Return name and value of each line but the first."""
    parts = [line.decode("latin-1").partition(":") for line in head.split(b"\r\n")[1:]]
    return [(name.strip().lower(), value) for name, _, value in parts]
