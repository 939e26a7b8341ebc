# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)
"""Queries and answers of a plain session: raw bytes and attachments. Each query is answered."""

import asyncio
import contextlib
import threading
from collections.abc import AsyncGenerator, Callable
from dataclasses import dataclass
from typing import Any

import zenoh
from zenoh.handlers import Callback

from pointit.runtime.bus.contract import Declaration
from pointit.runtime.bus.dispatcher import Dispatcher
from pointit.runtime.foreign_zenoh.pubsub import bytes_of, is_oversized
from pointit.runtime.host.threads import in_daemon_thread
from pointit.runtime.zenoh.queries import declare_queryable, refuse

MAX_OPEN = 64
"""Limit of queries that a queryable has accepted and not answered. Further ones are refused."""
QUERY_TIMEOUT_S = 600.0
"""Time for which Zenoh keeps a query alive. The querier has a deadline of its own, and cancels."""
MAX_REASON_CHARACTERS = 500
MAX_ANSWERS = 16
"""Limit of answers to one query that wait for the loop. Further ones are dropped."""


class IncomingQuery:
    """A query that must be answered once, since otherwise the querier waits for a time-out."""

    def __init__(self, query: zenoh.Query, done: Callable[[], None]) -> None:
        self.payload = bytes_of(query.payload) or b""
        self.attachment = bytes_of(query.attachment)
        self._query: zenoh.Query | None = query
        self._done = done

    async def answer(self, payload: bytes, attachment: bytes | None) -> None:
        """Answer in a separate thread, since Zenoh waits for a busy link. Other queries are not delayed."""

        def reply(query: zenoh.Query) -> None:
            with query, contextlib.suppress(zenoh.ZError):  # the querier is gone, or our session is
                query.reply(str(query.key_expr), payload, attachment=attachment)

        await self._end(reply)

    async def refuse(self, reason: str) -> None:
        """Send an error reply."""
        await self._end(lambda query: refuse(query, reason[:MAX_REASON_CHARACTERS]))

    def drop(self) -> None:
        """Drop the query without an answer, because the queryable was closed."""
        query = self._take()
        if query is not None:
            query.drop()

    async def _end(self, reply: Callable[[zenoh.Query], None]) -> None:
        query = self._take()
        if query is not None:
            await in_daemon_thread(lambda: reply(query), "zenoh-reply")

    def _take(self) -> zenoh.Query | None:
        query, self._query = self._query, None
        if query is not None:
            self._done()
        return query


class RawQueryable(Declaration):
    """Accepts a limited number of queries at a time; see `RawSession.queryable`."""

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        dispatcher: Dispatcher,
        handler: Callable[[IncomingQuery], None],
        max_bytes: int,
    ) -> None:
        self._dispatcher = dispatcher
        self._handler = handler
        self._max_bytes = max_bytes
        self._loop = asyncio.get_running_loop()
        self._lock = threading.Lock()
        self._open = 0
        super().__init__(declare_queryable(session, key, self._on_query).undeclare)

    def _on_query(self, query: zenoh.Query) -> None:  # on Zenoh's threads
        if reason := self._objection(query):
            refuse(query, reason)
            return
        ask = IncomingQuery(query, self._release)
        try:
            self._loop.call_soon_threadsafe(self._receive, ask)
        except RuntimeError:  # the loop is gone
            ask.drop()

    def _objection(self, query: zenoh.Query) -> str:
        if is_oversized(query.payload, query.attachment, self._max_bytes):
            return f"too long, at most {self._max_bytes} bytes are taken"
        with self._lock:
            if self._open >= MAX_OPEN:
                return f"busy, {MAX_OPEN} requests are waiting already"
            self._open += 1
        return ""

    def _release(self) -> None:
        with self._lock:
            self._open -= 1

    def _receive(self, query: IncomingQuery) -> None:
        if self.is_closed or self._dispatcher.is_closed:
            query.drop()
        else:
            self._handler(query)


@dataclass(frozen=True, slots=True)
class QueryReply:
    """One answer, or the reason for its absence."""

    payload: bytes
    attachment: bytes | None
    refusal: str = ""


class RawQuerier(Declaration):
    """Asks at one key."""

    def __init__(self, session: zenoh.Session, key: str, dispatcher: Dispatcher, max_bytes: int) -> None:
        self._dispatcher = dispatcher
        self._max_bytes = max_bytes
        self._loop = asyncio.get_running_loop()
        # Answers have the congestion control of their query. With DROP, a busy machine loses long answers,
        # and with them the end of all answers. A message that waits for a link delays only messages of its
        # own priority.
        self._querier = session.declare_querier(
            key,
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=QUERY_TIMEOUT_S,
            congestion_control=zenoh.CongestionControl.BLOCK,
            priority=zenoh.Priority.DATA_LOW,
            allowed_destination=zenoh.Locality.REMOTE,
        )
        super().__init__(self._querier.undeclare)

    async def wait_for_server(self) -> None:
        """Return when a queryable exists at this key."""
        if self._has_server():
            return
        found = asyncio.Event()

        def on_matching(status: zenoh.MatchingStatus) -> None:  # on Zenoh's threads
            if status.matching:
                with contextlib.suppress(RuntimeError):  # the loop is gone
                    self._loop.call_soon_threadsafe(found.set)

        listener = self._querier.declare_matching_listener(Callback(on_matching, indirect=False))
        try:
            if not self._has_server():
                await found.wait()
        finally:
            if not self._is_over():
                listener.undeclare()

    async def ask(self, payload: bytes, attachment: bytes | None) -> AsyncGenerator[QueryReply]:
        """Yield the answers as they arrive, until all queryables have answered. Closing cancels the query.

        The query is sent in a separate thread, since Zenoh waits for a busy link.
        """
        waiting: asyncio.Queue[QueryReply | None] = asyncio.Queue()
        token = zenoh.CancellationToken()

        def take(reply: zenoh.Reply) -> None:  # on Zenoh's threads
            if waiting.qsize() < MAX_ANSWERS:
                tell(self._read(reply))

        def tell(answer: QueryReply | None) -> None:
            with contextlib.suppress(RuntimeError):  # the loop is gone
                self._loop.call_soon_threadsafe(waiting.put_nowait, answer)

        def get() -> None:
            self._querier.get(
                Callback(take, lambda: tell(None), indirect=False),
                payload=payload,
                attachment=attachment,
                cancellation_token=token,
            )

        done = False
        try:
            await in_daemon_thread(get, "zenoh-ask")
            while (answer := await waiting.get()) is not None:
                yield answer
            done = True
        finally:
            if not done and not self._is_over():
                self._loop.run_in_executor(None, token.cancel)

    def _is_over(self) -> bool:
        return self.is_closed or self._dispatcher.is_closed

    def _has_server(self) -> bool:
        status: Any = self._querier.matching_status  # no bool, whatever the stubs say: always true
        return bool(status.matching)

    def _read(self, reply: zenoh.Reply) -> QueryReply:
        sample = reply.ok
        if sample is None:
            reason = b"" if reply.err is None else reply.err.payload.to_bytes()[:MAX_REASON_CHARACTERS]
            return QueryReply(b"", None, reason.decode(errors="replace") or "refused")
        if is_oversized(sample.payload, sample.attachment, self._max_bytes):
            return QueryReply(b"", None, f"its answer is longer than {self._max_bytes} bytes")
        return QueryReply(sample.payload.to_bytes(), bytes_of(sample.attachment))
