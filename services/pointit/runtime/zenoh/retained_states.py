# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)
"""Retained states of writers that are gone, over Zenoh. The keeper answers queries on the state's own key.

Living writers answer from their caches, under keys that such a query does not match. Access rules for a
state's key also apply to its retained value.
"""

import asyncio
import functools
from collections.abc import Iterator, Mapping, Sequence

import zenoh

from pointit.runtime.bus.contract import AnyTopic, Recall
from pointit.runtime.bus.local_broker import Participant
from pointit.runtime.bus.mailbox import Mailbox
from pointit.runtime.zenoh.declarations import Declared
from pointit.runtime.zenoh.liveliness import LivelinessSubscriber
from pointit.runtime.zenoh.queries import OverflowCounter, QueuedQueryable, query_samples
from pointit.runtime.zenoh.subscribers import max_names_for
from pointit.runtime.zenoh.wire_format import decoded, encoding_of, name_from_key
from pointit.schemas import SchemaError, encode
from pointit.schemas.topics import ANY, KEEPER_ALIVE

TIMEOUT_S = 2.0
AT_ONCE = 32
"""Maximum number of pending queries."""
EMPTY_RETRY_S = (0.05, 0.2, 0.7)
"""Delays before unanswered queries are repeated, s. A new process may not be known everywhere yet."""
BUSY = "the keeper is busy with too many other questions; ask later"


def recall_for_others(
    session: zenoh.Session, topics: Sequence[AnyTopic], recall: Recall, overflows: OverflowCounter
) -> list[Declared]:
    """Answer queries of other processes with the states that `recall` yields."""

    def work(topic: AnyTopic, query: zenoh.Query) -> Iterator[None]:
        """Answer in small steps: a query may be for all names, and there may be hundreds."""
        with query:
            for name, message in recall(topic):
                key = topic.at(name)
                if query.key_expr.intersects(zenoh.KeyExpr(key)):
                    query.reply(key, encode(message), encoding=encoding_of(topic.message))
                yield

    queryables = [  # one each: many queries for one topic do not delay those for another
        QueuedQueryable(
            session, topic.at(ANY), functools.partial(work, topic), overflows, about=topic.key, busy=BUSY
        )
        for topic in topics
    ]
    # declared last: its arrival tells readers that the queryables are ready
    token = session.liveliness().declare_token(KEEPER_ALIVE.at(str(session.zid())))
    return [token, *queryables]


class RetainedStateFetcher:
    """Queries the keepers of other processes for the readers of this one, once for each reader and keeper."""

    def __init__(self, bus: Participant, session: zenoh.Session) -> None:
        """Watch for keepers. Call this in the loop."""
        self._bus = bus
        self._session = session
        self._here = KEEPER_ALIVE.at(str(session.zid()))
        self._readers: list[tuple[AnyTopic, str, Mailbox]] = []
        self._pending: dict[str, AnyTopic] = {}
        """Pending queries by key."""
        self._keepers: set[str] = set()
        self._task: asyncio.Task[None] | None = None
        self._watch = LivelinessSubscriber(session, KEEPER_ALIVE.at(ANY), self._on_keepers, bus.dispatcher)

    def fetch(self, topic: AnyTopic, name: str, mailbox: Mailbox) -> None:
        """Fill `mailbox` with the retained states of `topic` under `name`."""
        self._readers = [reader for reader in self._readers if reader[2].accepts_retained]
        self._readers.append((topic, name, mailbox))
        if self._keepers:
            self._request([(topic, name, mailbox)])

    def close(self) -> None:
        """Stop watching. Pending queries end with the bus."""
        self._watch.close()

    def _on_keepers(self, changes: Mapping[str, bool]) -> None:
        come = {keeper for keeper, is_present in changes.items() if is_present} - {self._here}
        self._keepers = (self._keepers - changes.keys()) | come
        if come:
            self._request(self._readers)

    def _request(self, readers: Sequence[tuple[AnyTopic, str, Mailbox]]) -> None:
        self._pending |= {topic.at(name): topic for topic, name, box in readers if box.accepts_retained}
        if self._pending and self._task is None and not self._bus.is_closed:
            self._task = self._bus.spawn(self._query_all(), "fetching retained states")

    async def _query_all(self) -> None:
        try:
            while self._pending:
                pending, self._pending = self._pending, {}
                for wait_s in (0.0, *EMPTY_RETRY_S):
                    await asyncio.sleep(wait_s)
                    if not self._keepers or not pending:
                        break
                    pending = await self._query_once(pending)
        finally:
            self._task = None

    async def _query_once(self, pending: dict[str, AnyTopic]) -> dict[str, AnyTopic]:
        """Query every key and deliver the answers. Return the queries without an answer."""
        left: dict[str, AnyTopic] = {}
        items = list(pending.items())
        for first in range(0, len(items), AT_ONCE):
            batch = items[first : first + AT_ONCE]
            queries = (query_samples(self._session, key, timeout_s=TIMEOUT_S) for key, _ in batch)
            answers = await asyncio.gather(*queries)
            for (key, topic), samples in zip(batch, answers, strict=True):
                if samples:
                    self._hand_over(topic, samples)
                else:
                    left[key] = topic
        return left

    def _hand_over(self, topic: AnyTopic, samples: Sequence[zenoh.Sample]) -> None:
        mailboxes = [(name, box) for row, name, box in self._readers if row is topic and box.accepts_retained]
        for sample in samples[: max_names_for(topic.placeholder)]:
            try:
                name = name_from_key(topic, str(sample.key_expr))
                message = decoded(topic.message, sample.payload, sample.encoding)
            except SchemaError as error:
                for _, mailbox in mailboxes:
                    mailbox.count_invalid(error)
                continue
            for wanted, mailbox in mailboxes:
                if wanted in (ANY, name) or not topic.placeholder:
                    mailbox.offer_retained(name, message)
