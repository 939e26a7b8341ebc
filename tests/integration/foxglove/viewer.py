"""A viewer that is not Foxglove's: it speaks the protocol over a websocket of its own."""

import asyncio
import base64
import json
import struct
from collections.abc import AsyncGenerator, Sequence
from contextlib import asynccontextmanager
from typing import Any

import websockets
from websockets.asyncio.client import ClientConnection
from websockets.typing import Subprotocol

from tests.integration.foxglove.protobuf import Reader

MESSAGE_DATA = 1
SDK = "foxglove.sdk.v1"


class Viewer:
    def __init__(self, socket: ClientConnection, wanted: frozenset[str] | None) -> None:
        self._socket = socket
        self._wanted = wanted
        self.subprotocol = socket.subprotocol
        """Name that the server has chosen."""
        self.info: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        """Advertised channels by topic."""
        self.gone: set[str] = set()
        self.frames: dict[str, list[tuple[int, Any]]] = {}
        """Log time (ns) and message, by topic."""
        self.bytes = 0
        self._by_subscription: dict[int, dict[str, Any]] = {}
        self._readers: dict[int, Reader] = {}

    async def listen(self) -> None:
        async for data in self._socket:
            if isinstance(data, str):
                await self._on_text(json.loads(data))
            elif data[0] == MESSAGE_DATA:
                self.bytes += len(data)
                subscription, time_ns = struct.unpack_from("<IQ", data, 1)
                self._on_message(self._by_subscription[subscription], time_ns, data[13:])

    def all(self, topic: str) -> list[Any]:
        return [message for _, message in self.frames.get(topic, [])]

    def entities(self, part: str) -> dict[str, dict[str, Any]]:
        shown: dict[str, dict[str, Any]] = {}
        for update in self.all(f"/scene/{part}"):
            for deletion in update.get("deletions", []):
                if deletion.get("type", 0) == 1:
                    shown.clear()
                shown.pop(deletion.get("id", ""), None)
            shown |= {entity["id"]: entity for entity in update.get("entities", [])}
        return shown

    def ever(self, part: str) -> set[str]:
        return {each["id"] for update in self.all(f"/scene/{part}") for each in update.get("entities", [])}

    async def subscribe(self, *topics: str) -> None:
        await self._subscribe([self.channels[topic] for topic in topics])

    async def send(self, message: dict[str, Any]) -> None:
        await self._socket.send(json.dumps(message))

    async def _on_text(self, message: dict[str, Any]) -> None:
        if message["op"] == "serverInfo":
            self.info = message
        elif message["op"] == "advertise":
            self.channels |= {channel["topic"]: channel for channel in message["channels"]}
            wanted = self._wanted
            await self._subscribe(
                [each for each in message["channels"] if wanted is None or each["topic"] in wanted]
            )
        elif message["op"] == "unadvertise":
            self.gone |= {
                topic for topic, each in self.channels.items() if each["id"] in message["channelIds"]
            }

    async def _subscribe(self, channels: list[dict[str, Any]]) -> None:
        self._by_subscription |= {channel["id"]: channel for channel in channels}
        subscriptions = [{"id": channel["id"], "channelId": channel["id"]} for channel in channels]
        if subscriptions:
            await self.send({"op": "subscribe", "subscriptions": subscriptions})

    def _on_message(self, channel: dict[str, Any], time_ns: int, payload: bytes) -> None:
        if channel["encoding"] == "json":
            message = json.loads(payload)
        else:
            assert channel["encoding"] == "protobuf"
            reader = self._readers.get(channel["id"])
            if reader is None:
                reader = Reader(base64.b64decode(channel["schema"] + "=="))
                self._readers[channel["id"]] = reader
            message = reader.read(channel["schemaName"], payload)
        self.frames.setdefault(channel["topic"], []).append((time_ns, message))


@asynccontextmanager
async def viewer(
    address: str, *wanted: str, everything: bool = False, subprotocols: Sequence[str] = (SDK,)
) -> AsyncGenerator[Viewer]:
    names = [Subprotocol(name) for name in subprotocols]
    async with websockets.connect(address, subprotocols=names) as socket:
        one = Viewer(socket, None if everything else frozenset(wanted))
        listening = asyncio.create_task(one.listen(), name="viewer")
        try:
            yield one
        finally:
            await socket.close()
            await asyncio.gather(listening, return_exceptions=True)
