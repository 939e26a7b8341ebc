"""Queries to other sessions, and bounded queues for queries from them.

Nothing waits on Zenoh's threads or in the loop, which handles each queue for a slice of time per turn.
"""

import asyncio
import collections
import contextlib
import logging
import math
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import zenoh
from zenoh.handlers import Callback

from pointit.runtime.zenoh.declarations import Declared
from pointit.schemas import SchemaError
from pointit.schemas.text import one_line

log = logging.getLogger(__name__)

T = TypeVar("T")
MAX_WAITING = 512
"""Maximum length of a queue, twice the calls that a server answers at a time. Others are rejected."""
MAX_REPLY_BYTES = 1024 * 1024
"""Maximum length of a reply: that of the longest message of a site."""
MAX_SHOWN = 100
"""Maximum number of characters of a key in a message."""
SLICE_S = 0.001
"""Maximum time for which one queue is handled in a turn of the loop, s. Other tasks run between turns."""
SHOWN_S = 5.0
"""Time for which the warning about refused queries is shown after the last of them, s."""
LOG_PERIOD_S = 1.0


@dataclass(frozen=True)
class ReplyLimit:
    """Number and size of the replies that were asked for. Others are not kept."""

    max_replies: int
    """Number of replies with which a query ends."""
    max_bytes: int = MAX_REPLY_BYTES
    """Maximum length of one reply."""
    max_of_key: int | None = None
    """Number of replies under one key, if the query is for several: one writer takes no other's place."""


class ExcessReplies:
    """Counts replies that nobody has asked for, of all queries of a session, from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._count = 0
        self._selector = ""
        self._writer = ""
        self._max_of_key: int | None = None
        self._last_s = self._logged_s = -math.inf

    def add(self, selector: str, writer: str, now_s: float, *, max_of_key: int | None = None) -> None:
        """Count a reply to `selector`, under the key `writer`, at `now_s`, monotonic.

        `max_of_key`: number of replies that are read under its key, if it is beyond that. They may be of
        as many writers, each of which has answered what it was asked for.
        """
        with self._lock:
            self._count += 1
            self._selector = selector
            self._writer = writer
            self._max_of_key = max_of_key
            self._last_s = now_s
            if now_s - self._logged_s < LOG_PERIOD_S:
                return
            self._logged_s = now_s
        log.warning("%s", self.problem(now_s))

    def problem(self, now_s: float) -> str:
        """Return a message for `SHOWN_S` after the last of them, else `""`."""
        with self._lock:
            if now_s - self._last_s > SHOWN_S:
                return ""
            writer = one_line(self._writer, MAX_SHOWN)
            selector = one_line(self._selector, MAX_SHOWN)
            unread = f"{selector}; {self._count} answers since the start were not read"
            if self._max_of_key is not None:
                return (
                    f"{writer} has more than {self._max_of_key} answers ({unread}): end the programs that "
                    "write it beside the one that should, or revoke the identity of one that answers "
                    "several times"
                )
            return (
                f"the writer of {writer} answers more than was asked for ({unread}): end its process, or "
                "revoke its identity"
            )


class _RepliesOfQuery:
    """Replies to one query, up to its limit. Called on Zenoh's threads."""

    def __init__(
        self, selector: str, limit: ReplyLimit, excess: ExcessReplies, end: Callable[[], None]
    ) -> None:
        """Begin without replies. `end` is called once there are too many."""
        self.replies: list[zenoh.Reply] = []
        self._excess = excess
        self._selector = selector
        self._limit = limit
        self._end = end
        self._by_key = Counter[str]()

    def add(self, reply: zenoh.Reply) -> None:
        sample = reply.ok
        error = reply.err
        key = ""
        payload = None
        if sample is not None:
            key = str(sample.key_expr)
            payload = sample.payload
        elif error is not None:
            payload = error.payload

        is_too_long = payload is not None and len(payload) > self._limit.max_bytes
        max_of_key = self._limit.max_of_key
        is_beyond_key = max_of_key is not None and self._by_key[key] >= max_of_key
        has_room = len(self.replies) < self._limit.max_replies
        if has_room and not is_too_long and not is_beyond_key:
            self._by_key[key] += 1
            self.replies.append(reply)
            return
        self._excess.add(
            self._selector,
            key or self._selector,
            time.monotonic(),
            max_of_key=max_of_key if is_beyond_key and not is_too_long else None,
        )
        if not has_room:
            self._end()


async def query_replies(
    session: zenoh.Session | zenoh.Liveliness,
    selector: str,
    *,
    limit: ReplyLimit,
    excess: ExcessReplies | None = None,
    **arguments: Any,
) -> list[zenoh.Reply]:
    """Return the answers of other sessions in order of arrival. A cancelled task waits for no further answer.

    Replies beyond `limit` are not kept, and are counted in `excess`. `session`: a session, or its
    `liveliness()` for tokens. `arguments`: further arguments of its `get`.
    """
    loop = asyncio.get_running_loop()
    ended = asyncio.Event()
    is_complete = threading.Event()

    def end() -> None:  # on Zenoh's thread
        with contextlib.suppress(RuntimeError):  # the loop is gone
            loop.call_soon_threadsafe(ended.set)

    def complete() -> None:
        is_complete.set()
        end()

    token = zenoh.CancellationToken()
    received = _RepliesOfQuery(selector, limit, excess or ExcessReplies(), end)
    on_reply = Callback(received.add, complete, indirect=False)
    session.get(selector, on_reply, cancellation_token=token, **arguments)
    try:
        await ended.wait()
    finally:
        # Cancelled, or ended with more replies than were asked for: no more of them are read
        if not is_complete.is_set():
            loop.run_in_executor(None, token.cancel)
    return list(received.replies)


async def query_samples(
    session: zenoh.Session,
    selector: str,
    *,
    timeout_s: float,
    limit: ReplyLimit,
    excess: ExcessReplies | None = None,
    under_any_key: bool = False,
) -> list[zenoh.Sample]:
    """Return the samples of all answers in order of arrival, or none if Zenoh cannot send the query.

    `under_any_key`: answers may have other keys than the query. Those beyond `limit` are not read.
    """
    # All answers, not only the newest of each key: several may be missing samples
    accept_replies = zenoh.ReplyKeyExpr.ANY if under_any_key else None
    try:
        replies = await query_replies(
            session,
            selector,
            limit=limit,
            excess=excess,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=timeout_s,
            allowed_destination=zenoh.Locality.REMOTE,
            accept_replies=accept_replies,
        )
    except zenoh.ZError as error:  # background tasks repeat their queries: an error must not end them
        log.warning("%s cannot be asked for: %s", selector, error)
        return []
    samples: list[zenoh.Sample] = []
    for reply in replies:
        if reply.ok is not None and reply.ok.kind == zenoh.SampleKind.PUT:
            samples.append(reply.ok)
    return samples


def refuse(query: zenoh.Query, reason: str) -> None:
    """Answer `query` with an error: without an answer the caller would wait for its time-out."""
    with query, contextlib.suppress(zenoh.ZError):  # the caller's session or our own is closed
        query.reply_err(reason.encode())


class OverflowCounter:
    """Counts rejections by full queues, for all queues of a process and from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._count = 0
        self._key = ""
        self._last_s = self._logged_s = -math.inf

    def add(self, key: str, now_s: float) -> None:
        """Count a rejected query for `key` at `now_s`, monotonic."""
        with self._lock:
            self._count += 1
            self._key = key
            self._last_s = now_s
            if now_s - self._logged_s < LOG_PERIOD_S:
                return
            self._logged_s = now_s
        log.warning("%s", self.problem(now_s))

    def problem(self, now_s: float) -> str:
        """Return a message for `SHOWN_S` after a rejection, else `""`."""
        with self._lock:
            if now_s - self._last_s > SHOWN_S:
                return ""
            amount = "1 question was turned away,"
            if self._count > 1:
                amount = f"{self._count} questions were turned away, the last"
            return (
                f"{amount} for {self._key}, as more than "
                f"{MAX_WAITING} waited: find out who on this site asks so much, and end that"
            )


class BoundedWorkQueue(Generic[T]):
    """A queue that any thread fills. The loop in which it was created handles the items in order."""

    def __init__(self, key: str, work: Callable[[T], Iterable[object]], turned_away: OverflowCounter) -> None:
        """Create an empty queue. `work` returns an iterator over an item's steps, which run in the loop."""
        self._key = key
        self._work = work
        self._turned_away = turned_away
        self._loop = asyncio.get_running_loop()
        self._lock = threading.Lock()
        self._waiting: collections.deque[T] = collections.deque()
        self._steps: Iterator[object] | None = None
        """Remaining steps of the item in progress."""
        self._is_awake = False

    def offer(self, item: T) -> bool:
        """Add `item`, or return False if the queue is full. Any thread.

        Raises:
            RuntimeError: If the loop is closed.
        """
        with self._lock:
            has_room = len(self._waiting) < MAX_WAITING
            if has_room:
                if not self._is_awake:
                    self._loop.call_soon_threadsafe(self._work_one_slice)
                    self._is_awake = True
                self._waiting.append(item)
        if not has_room:
            self._turned_away.add(self._key, time.monotonic())
        return has_room

    def _work_one_slice(self) -> None:
        until_s = time.monotonic() + SLICE_S
        while True:
            if self._steps is None:
                with self._lock:
                    if not self._waiting:
                        self._is_awake = False
                        return
                    item = self._waiting.popleft()
                self._steps = iter(self._work(item))
            try:
                next(self._steps)
            except StopIteration:
                self._steps = None
            except Exception:
                self._steps = None
                log.exception("a question for %s could not be answered", self._key)
            if time.monotonic() >= until_s:
                break
        self._loop.call_soon(self._work_one_slice)


def declare_queryable(session: zenoh.Session, key: str, on_query: Callable[[zenoh.Query], None]) -> Declared:
    """Call `on_query` for each query of `key`. It or a later function must answer or drop the query."""
    return session.declare_queryable(
        key, Callback(on_query, indirect=False), complete=True, allowed_origin=zenoh.Locality.REMOTE
    )


class QueuedQueryable:
    """Hands queries of a key from Zenoh's threads to the loop, a limited number of them."""

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        work: Callable[[zenoh.Query], Iterable[object]],
        overflows: OverflowCounter,
        *,
        about: str,
        busy: str,
        check: Callable[[zenoh.Query], None] = lambda _: None,
    ) -> None:
        """Declare the queryable.

        Call this in the loop. `work` handles or drops a query in small steps in the loop. `about` is the text
        for `key` in messages, `busy` the refusal if the queue is full. `check` raises `SchemaError` to refuse
        a query on Zenoh's threads.
        """
        self._work = work
        self._busy = busy
        self._check = check
        self._closed = False
        self._queue = BoundedWorkQueue(about, self._steps, overflows)
        self._declared = declare_queryable(session, key, self._on_query)

    def undeclare(self) -> None:
        """Stop answering. Pending queries are dropped."""
        self._closed = True
        self._declared.undeclare()

    def _on_query(self, query: zenoh.Query) -> None:  # on Zenoh's threads
        try:
            self._check(query)
            if not self._queue.offer(query):
                refuse(query, self._busy)
        except SchemaError as error:  # no item of it is queued for the loop
            refuse(query, str(error))
        except RuntimeError:  # the loop is gone
            query.drop()

    def _steps(self, query: zenoh.Query) -> Iterator[None]:
        if self._closed:
            query.drop()
            return
        for _ in self._work(query):
            yield
            if self._closed:
                return
