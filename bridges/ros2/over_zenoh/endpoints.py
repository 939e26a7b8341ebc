"""Endpoints of a node in a ROS 2 graph on Zenoh, and the context that they share.

No core: it waits for a network.
"""

import asyncio
import collections
import contextlib
from collections.abc import Callable
from dataclasses import replace

import xxhash

from pointit.bridges.ros2.graph.backend import SERVICE, EndpointKind, Qos, RosType, Server
from pointit.bridges.ros2.graph.node_backend import MessageQueue, NodeContext, RosEndpoint, RosServiceServer
from pointit.bridges.ros2.over_zenoh.attachment import Attachment, packed, unpacked
from pointit.bridges.ros2.over_zenoh.rmw_zenoh import LivelinessDirectory, RmwZenoh
from pointit.bridges.ros2.over_zenoh.token import gid
from pointit.runtime.errors import RefusedError
from pointit.runtime.foreign_zenoh import IncomingQuery, QueryReply, RawSample, RawSession
from pointit.runtime.service.plugin_guard import WarningSink

REMEMBERED = 16
"""Minimum number of a topic's messages that are remembered to drop duplicates."""

EMPTY_RETRY_S = (0.005, 0.02, 0.05)
"""Delays before a request that reached no server is repeated: a new server is not known at once."""
GONE = "its server was gone before it answered"
AT_ONCE_S = 0.05
"""A request that ended without an answer within this time (s) reached no server; later, the server died."""


class EndpointContext(NodeContext):
    """The session, the encoding of ROS in it, and the ids of our own endpoints."""

    def __init__(
        self,
        warnings: WarningSink,
        *,
        session: RawSession,
        rmw: RmwZenoh,
        directory: LivelinessDirectory,
        now_ns: Callable[[], int],
    ) -> None:
        """`directory`: nodes and endpoints, ours included; `now_ns`: clock for attachments."""
        super().__init__(warnings, session.dispatcher)
        self.session = session
        self.rmw = rmw
        self.directory = directory
        self.now_ns = now_ns
        self.gids: set[bytes] = set()
        """Ids of our endpoints: messages with them are our own."""

    def announce(self, kind: EndpointKind, name: str, of: RosType, qos: Qos) -> "Announcement":
        """Declare a token of a new endpoint in the graph until the result is closed."""
        return Announcement(self, self.rmw.endpoint_token(kind, name, of, qos))


class Announcement:
    """A token of ours; numbers the messages of its endpoint."""

    def __init__(self, context: EndpointContext, token: str) -> None:
        self._context = context
        self._text = token
        self._gid = gid(token)
        self._sequence = 0
        context.gids.add(self._gid)
        self._token = context.session.token(token)
        context.directory.announce(token)

    def next(self) -> Attachment:
        """Return the attachment of the next message."""
        self._sequence += 1
        return Attachment(sequence=self._sequence, stamp_ns=self._context.now_ns(), gid=self._gid)

    def close(self) -> None:
        """Remove it from the graph."""
        self._token.close()
        self._context.directory.retract(self._text)
        self._context.gids.discard(self._gid)


class ZenohWriter(RosEndpoint[EndpointContext]):
    """Publisher of one topic."""

    def __init__(self, context: EndpointContext, topic: str, kind: RosType, qos: Qos) -> None:
        """Declare. The presence token comes last: peers that see it find a publisher."""
        super().__init__(context, topic)
        # Zenoh's caches do not expire: with a lifespan nothing is cached, rather than everything for ever.
        # Subscribers of a latched topic still receive later messages.
        key = context.rmw.key(topic, kind)
        cache_size = qos.depth if qos.lasts else 0
        self._writer = context.session.publisher(key, cache_size=cache_size, reliable=qos.reliable)
        self._token = context.announce("publisher", topic, kind, qos)
        context.ends.add(self)

    @property
    def is_read(self) -> bool:
        """Return True if Zenoh knows a subscriber, with or without a token; False for a latched topic."""
        return not self._context.is_closed and self._writer.is_read

    def put(self, cdr: bytes) -> None:
        """Send; returns at once, and never blocks on readers.

        Raises:
            BusClosedError: If this writer or its backend is closed.
        """
        self._writer.put(cdr, packed(self._token.next()))

    def _undeclare(self) -> None:
        self._token.close()
        self._writer.close()


class ZenohReader(RosEndpoint[EndpointContext]):
    """Subscription of one topic, without messages of ourselves and of other PointIt bridges."""

    def __init__(
        self, context: EndpointContext, topic: str, kind: RosType, qos: Qos, handler: Callable[[bytes], None]
    ) -> None:
        """Declare; `handler` gets the CDR of messages."""
        super().__init__(context, topic)
        self._handler = handler
        self._malformed = 0
        self._recent: collections.OrderedDict[bytes, None] = collections.OrderedDict()
        self._remembered = max(qos.depth, REMEMBERED)
        self._queue = MessageQueue(context, topic, self._on_sample, qos)

        def enqueue(sample: RawSample) -> None:  # on a thread of Zenoh
            self._queue.put(sample, is_oversized=sample.is_oversized(context.max_bytes))

        key = context.rmw.key(topic, kind)
        cache_size = qos.depth if qos.latched else 0
        self._subscriber = context.session.subscriber(
            key, enqueue, cache_size=cache_size, reliable=qos.reliable
        )
        self._token = context.announce("subscriber", topic, kind, qos)
        context.ends.add(self)

    def _undeclare(self) -> None:
        for end in (self._token, self._subscriber, self._queue):
            end.close()

    def _on_sample(self, sample: RawSample) -> None:
        try:
            origin = unpacked(sample.attachment)
        except ValueError as error:
            self._malformed += 1
            sentence = f"dropped {self._malformed} messages on {self.name}: {error}"
            self._context.warnings.show_briefly(f"attachments of {self.name}", sentence)
            return
        context = self._context
        if origin.gid in context.gids or origin.gid in context.directory.bridged:
            return  # it is ours, or of another PointIt
        if sample.attachment is not None and self._is_known(sample.attachment, sample.payload):
            return
        self._handler(sample.payload)

    def _is_known(self, attachment: bytes, payload: bytes) -> bool:
        """Return True if this message was received before, as when it is fetched again from a cache."""
        mark = attachment + xxhash.xxh3_128_digest(payload)  # not all of it: it may be a megabyte
        if mark in self._recent:
            return True
        self._recent[mark] = None
        if len(self._recent) > self._remembered:
            self._recent.popitem(last=False)
        return False


class ZenohServiceServer(RosServiceServer[EndpointContext]):
    """Answers one service."""

    def __init__(self, context: EndpointContext, service: str, kind: RosType, server: Server) -> None:
        """Declare. The presence token comes last, so that clients that see it find a server."""
        super().__init__(context, service, server)
        key = context.rmw.key(service, kind)
        self._queryable = context.session.queryable(key, self._on_query, max_bytes=context.max_bytes)
        self._token = context.announce("server", service, kind, SERVICE)
        context.ends.add(self)

    def _undeclare(self) -> None:
        self._token.close()
        self._queryable.close()

    def _on_query(self, query: IncomingQuery) -> None:
        try:
            origin = unpacked(query.attachment)
        except ValueError as error:
            sentence = f"dropped a request to {self.name}: {error}"
            self._context.warnings.show_briefly(f"attachments of {self.name}", sentence)
            self._start(id(query), query.refuse(str(error)))
            return
        mark = origin.gid, origin.sequence
        if mark in self._tasks:
            self._start(id(query), query.refuse("duplicate sequence number"))
        else:
            self._start(mark, self._answer(query, origin))

    async def _answer(self, query: IncomingQuery, origin: Attachment) -> None:
        try:
            response = await self._response(query.payload, bytes)
        except asyncio.CancelledError:
            query.drop()
            raise
        except RefusedError as error:
            await query.refuse(str(error))
        else:
            echo = replace(origin, stamp_ns=self._context.now_ns())
            await query.answer(response, packed(echo))


class ZenohServiceClient(RosEndpoint[EndpointContext]):
    """Client of one service."""

    def __init__(self, context: EndpointContext, service: str, kind: RosType) -> None:
        super().__init__(context, service)
        key = context.rmw.key(service, kind)
        self._querier = context.session.querier(key, max_bytes=context.max_bytes)
        self._token = context.announce("client", service, kind, SERVICE)
        context.ends.add(self)

    async def call(self, request: bytes, *, timeout_s: float) -> bytes:
        """Return the response's CDR.

        Raises:
            TimeoutError: If there is no server, or no answer of it in time.
        """
        loop = self._context.loop
        refusals: list[str] = []
        problem = "no node serves it"
        try:
            async with asyncio.timeout(timeout_s):
                for wait_s in (*EMPTY_RETRY_S, None):
                    await self._querier.wait_for_server()
                    problem = "its server did not answer"
                    began_s = loop.time()
                    response = await self._ask(request, refusals)
                    if response is not None:
                        return response

                    # Repeated only if it reached no server: a request may not be done twice
                    problem = GONE
                    has_arrived = bool(refusals) or loop.time() - began_s > AT_ONCE_S
                    if wait_s is None or has_arrived:
                        break
                    await asyncio.sleep(wait_s)
        except TimeoutError as error:
            reasons = dict.fromkeys([*refusals, f"{problem} within {timeout_s:g} s"])
            raise TimeoutError(f"ROS service {self.name}: {'; '.join(reasons)}") from error
        reason = "; ".join(dict.fromkeys(refusals)) or GONE
        raise TimeoutError(f"ROS service {self.name}: {reason}")

    async def _ask(self, request: bytes, refusals: list[str]) -> bytes | None:
        """Return the first good response, or None, with the reasons of rejections added to `refusals`."""
        origin = self._token.next()
        async with contextlib.aclosing(self._querier.ask(request, packed(origin))) as answers:
            async for answer in answers:
                reason = answer.refusal or self._objection(answer, origin)
                if not reason:
                    return answer.payload
                refusals.append(reason)
        return None

    def _objection(self, answer: QueryReply, origin: Attachment) -> str:
        """Return the rejection of `answer` to the request from `origin`, or `""`."""
        try:
            echo = unpacked(answer.attachment)
        except ValueError as error:
            return f"its answer was dropped: {error}"
        if (echo.gid, echo.sequence) != (origin.gid, origin.sequence):
            return "its answer was dropped: it is to another request"
        return ""

    def _undeclare(self) -> None:
        self._token.close()
        self._querier.close()
