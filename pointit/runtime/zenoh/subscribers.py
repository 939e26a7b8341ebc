"""Readers of topics over Zenoh: callbacks only fill mailboxes; and retained states of writers that are gone.

Living writers answer from their caches, under keys that such a query does not match. Access rules for a
state's key also apply to its retained value.
"""

import asyncio
import collections
import functools
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import zenoh

from pointit.runtime.bus.contract import AnyTopic, Recall, Sent
from pointit.runtime.bus.mailbox import Mailbox
from pointit.runtime.bus.memory_bus import MailboxSubscription, Participant
from pointit.runtime.zenoh.declarations import (
    PRIORITY,
    Declared,
    check_size,
    check_writer,
    declare_retained_subscribers,
    declare_subscriber,
    decoded,
    encoded,
    encoding_of,
    name_from_key,
)
from pointit.runtime.zenoh.event_recovery import TIMEOUT_S, EventRecovery
from pointit.runtime.zenoh.liveliness import LivelinessSubscriber
from pointit.runtime.zenoh.queries import (
    ExcessReplies,
    OverflowCounter,
    QueuedQueryable,
    ReplyLimit,
    query_samples,
)
from pointit.runtime.zenoh.sources import SenderChecks
from pointit.runtime.zenoh.state_recovery import StateRecovery
from pointit.schemas import DecodeError, KeyNameError, Message, SchemaError
from pointit.schemas.topics import ANY, KEEPER_ALIVE, Delivery

MAX_USERS = 256
MAX_NAMES = 4096
"""Maximum number of names of a placeholder other than users, such as lamps and service instances."""
SILENT_S = 60.0
"""Time without a message after which a name may be replaced by a new one, s."""

MAX_KEEPERS = 4
"""Maximum number of keepers whose states of one name are read."""
AT_ONCE = 32
"""Maximum number of pending queries."""
EMPTY_RETRY_S = (0.05, 0.2, 0.7)
"""Delays before unanswered queries are repeated, s. A new process may not be known everywhere yet."""
BUSY = "the keeper is busy with too many other questions; ask later"


class NameAllowlist:
    """Names that every reader of a bus accepts in spite of unknown peers, such as the map's lamps."""

    def __init__(self) -> None:
        self._retained: dict[str, frozenset[str]] = {}

    def keep(self, placeholder: str, names: Iterable[str]) -> None:
        """Reserve `names`, in place of those reserved for `placeholder` before."""
        self._retained[placeholder] = frozenset(names)

    def holds(self, placeholder: str, name: str) -> bool:
        """Return True if a place is reserved for `name`. Any thread."""
        return name in self._retained.get(placeholder, ())


def max_names_for(placeholder: str) -> int:
    """Return the number of names that a reader accepts for `{placeholder}` of a key."""
    return MAX_USERS if placeholder == "user" else MAX_NAMES


class NameLimiter:
    """Limits the number of names that one reader accepts. Any thread.

    Readers store an object for each name (a publisher, a tracker), so a flood of new names would cost the
    time and memory that the existing ones need.
    """

    def __init__(self, placeholder: str, name_in: Callable[[str], str], allowlist: NameAllowlist) -> None:
        """Accept names for `placeholder`. `name_in` reads one from a key, or raises `SchemaError`."""
        self._allowlist = allowlist
        self._placeholder = placeholder or "name"
        self._limit = max_names_for(placeholder)
        self._name_in = name_in
        self._lock = threading.Lock()
        self._received: collections.OrderedDict[str, tuple[str, float]] = collections.OrderedDict()
        """Name and time of the last message, s, by key. The one that has been silent longest comes first."""

    def admit(self, key: str, now_s: float) -> str:
        """Return the name in `key`, on which a message arrived at `now_s`.

        Raises:
            SchemaError: If the name is invalid, or if there are too many others.
        """
        with self._lock:
            current = self._received.get(key)
            if current is not None:
                name = current[0]
                self._received[key] = (name, now_s)
                self._received.move_to_end(key)
                return name
        name = self._name_in(key)
        with self._lock:
            is_allowed = self._allowlist.holds(self._placeholder, name)
            is_new = key not in self._received and not is_allowed
            if is_new and len(self._received) >= self._limit:
                _, oldest_s = next(iter(self._received.values()))
                if now_s - oldest_s <= SILENT_S:
                    refused = f"{self._placeholder} {name!r}: more than {self._limit} names"
                    raise KeyNameError(
                        f"{refused}, the rest are not heard; "
                        f"a name makes room when it is silent for {SILENT_S:g} s"
                    )
                self._received.popitem(last=False)
            self._received[key] = (name, now_s)
        return name


class EncodedMessage:
    """A payload from another process, decoded for all its readers in this one. Used in the loop."""

    __slots__ = ("_failure", "_kind", "_message", "_name", "_sample")

    def __init__(self, kind: type[Message], sample: zenoh.Sample, name: str) -> None:
        self._kind = kind
        self._sample = sample
        self._name = name
        self._message: Message | None = None
        self._failure = ""

    @property
    def size(self) -> int:
        """Return its number of bytes."""
        return len(self._sample.payload)

    @property
    def sent(self) -> Sent | None:
        """Return when and by which process it was published, or None if it does not say.

        If a process receives a stamp up to 0.5 s ahead of its own clock, its next stamp is no earlier. The
        first router replaces stamps that are further ahead.
        """
        stamp = self._sample.timestamp
        if stamp is None:
            return None
        process = str(stamp.get_id())
        return Sent(stamp.get_time_as_ntp64().as_nanos(), process)

    def decode(self) -> Message:
        """Return the message. It is decoded for the first reader, and all others get the same object.

        Raises:
            DecodeError: If the payload is no valid message.
        """
        if self._failure:
            raise DecodeError(self._failure)
        message = self._message
        if message is None:
            try:
                message = decoded(self._kind, self._sample.payload, self._sample.encoding)
                check_writer(message, self._name)
                self._message = message
            except Exception as error:
                failure = str(error)
                if not isinstance(error, DecodeError):
                    failure = f"{type(error).__name__}: {failure}"
                self._failure = failure
                raise
        return message


class _SampleInput(ABC):
    """Input of samples from other processes for the readers of one key. Called on Zenoh's threads."""

    def __init__(self, topic: AnyTopic, allowlist: NameAllowlist) -> None:
        self.mailboxes: tuple[Mailbox, ...] = ()
        """Replaced, never changed: other threads read it."""
        self._kind = topic.message
        self._names = NameLimiter(topic.placeholder, functools.partial(name_from_key, topic), allowlist)

    def on_sample(self, sample: zenoh.Sample) -> None:
        if sample.kind != zenoh.SampleKind.PUT:
            return
        mailboxes = self.mailboxes
        try:
            check_size(self._kind, sample.payload)
            name = self._names.admit(str(sample.key_expr), time.monotonic())
        except SchemaError as error:
            for mailbox in mailboxes:
                mailbox.count_invalid(error)
            return
        encoded = EncodedMessage(self._kind, sample, name)
        for mailbox in mailboxes:
            mailbox.offer(name, encoded)

    @abstractmethod
    def undeclare(self) -> None: ...


class SharedSubscriber(_SampleInput):
    """The shared input of all readers of a key: a sample is received and decoded once."""

    def __init__(self, session: zenoh.Session, topic: AnyTopic, key: str, allowlist: NameAllowlist) -> None:
        super().__init__(topic, allowlist)
        self._subscriber = declare_subscriber(session, key, self.on_sample)

    def undeclare(self) -> None:
        """Stop receiving."""
        self._subscriber.undeclare()


class _RetainedInput(_SampleInput):
    """Input of one reader of states or events, which fetches what its writers have cached."""

    def __init__(
        self,
        bus: Participant,
        session: zenoh.Session,
        topic: AnyTopic,
        key: str,
        mailbox: Mailbox,
        *,
        allowlist: NameAllowlist,
        checks: SenderChecks,
    ) -> None:
        super().__init__(topic, allowlist)
        self.mailboxes = (mailbox,)
        self._began = session.new_timestamp()
        self._sources = checks.sources
        self._recovery: EventRecovery | StateRecovery
        on_writer: Callable[[zenoh.Sample], None] | None = None
        max_bytes = topic.message.max_bytes
        if topic.delivery is Delivery.EVENT:
            self._recovery = EventRecovery(
                bus, session, self._on_event, mailbox.count_lost, max_bytes=max_bytes, excess=checks.excess
            )
        else:
            max_names = max_names_for(topic.placeholder)
            states = StateRecovery(
                bus,
                session,
                self.on_sample,
                max_bytes=max_bytes,
                max_names=max_names,
                excess=checks.excess,
            )
            on_writer = states.on_writer
            self._recovery = states
        self._declared = declare_retained_subscribers(
            session, key, self._on_input, self._recovery.on_heartbeat, on_writer
        )
        if isinstance(self._recovery, StateRecovery):
            self._recovery.fetch_all(key)

    def undeclare(self) -> None:
        for declared in self._declared:
            declared.undeclare()
        self._recovery.close()

    def _on_input(self, sample: zenoh.Sample) -> None:
        if not self._sources.is_own(sample):
            self._recovery.on_sample(sample)

    def _on_event(self, sample: zenoh.Sample) -> None:
        # Zenoh fetches the whole cache of a new writer. A button press of a minute ago must not count now.
        # Live samples are accepted whatever their stamp.
        stamp = sample.timestamp
        is_live = sample.priority == PRIORITY
        if is_live or stamp is None or stamp >= self._began:
            self.on_sample(sample)


class ZenohSubscription(MailboxSubscription):
    """A mailbox that is filled by the writers of this process and by Zenoh."""

    def __init__(
        self,
        bus: Participant,
        session: zenoh.Session,
        topic: AnyTopic,
        mailbox: Mailbox,
        name: str,
        *,
        inputs: dict[str, SharedSubscriber],
        allowlist: NameAllowlist,
        checks: SenderChecks,
    ) -> None:
        """Fill `mailbox`. `inputs` are by key, `allowlist` has the names that are always accepted."""
        super().__init__(bus, topic, mailbox, name)
        self._key = topic.at(name)
        self._inputs = inputs
        self._input: SharedSubscriber | _RetainedInput
        if topic.delivery is not Delivery.LATEST:
            self._input = _RetainedInput(
                bus, session, topic, self._key, mailbox, allowlist=allowlist, checks=checks
            )
            return
        shared = inputs.get(self._key)
        if shared is None:
            shared = inputs[self._key] = SharedSubscriber(session, topic, self._key, allowlist)
        shared.mailboxes = (*shared.mailboxes, mailbox)
        self._input = shared

    def _undeclare(self) -> None:
        super()._undeclare()
        sample_input = self._input
        remaining = [mailbox for mailbox in sample_input.mailboxes if mailbox is not self._mailbox]
        sample_input.mailboxes = tuple(remaining)
        if not sample_input.mailboxes:
            self._inputs.pop(self._key, None)
            sample_input.undeclare()


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
                    query.reply(key, encoded(message), encoding=encoding_of(topic.message))
                yield

    # One each: many queries for one topic do not delay those for another
    queryables: list[Declared] = []
    for topic in topics:
        answer = functools.partial(work, topic)
        key = topic.at(ANY)
        queryables.append(QueuedQueryable(session, key, answer, overflows, about=topic.key, busy=BUSY))

    # Declared last: its arrival tells readers that the queryables are ready
    keeper = KEEPER_ALIVE.at(str(session.zid()))
    token = session.liveliness().declare_token(keeper)
    return [token, *queryables]


class RetainedStateFetcher:
    """Queries the keepers of other processes for the readers of this one, once for each reader and keeper."""

    def __init__(self, bus: Participant, session: zenoh.Session, excess: ExcessReplies) -> None:
        """Watch for keepers. Call this in the loop. `excess` counts answers that were not asked for."""
        self._excess = excess
        self._bus = bus
        self._session = session
        self._own_keeper = KEEPER_ALIVE.at(str(session.zid()))
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
        present = {keeper for keeper, is_present in changes.items() if is_present}
        arrived = present - {self._own_keeper}
        self._keepers = (self._keepers - changes.keys()) | arrived
        if arrived:
            self._request(self._readers)

    def _request(self, readers: Sequence[tuple[AnyTopic, str, Mailbox]]) -> None:
        for topic, name, mailbox in readers:
            if mailbox.accepts_retained:
                self._pending[topic.at(name)] = topic
        if not self._pending or self._task is not None:
            return
        if not self._bus.is_closed:
            self._task = self._bus.spawn(self._query_all(), "fetching retained states")

    async def _query_all(self) -> None:
        try:
            while self._pending:
                pending = self._pending
                self._pending = {}
                for wait_s in (0.0, *EMPTY_RETRY_S):
                    await asyncio.sleep(wait_s)
                    if not self._keepers or not pending:
                        break
                    pending = await self._query_once(pending)
        finally:
            self._task = None

    async def _query_once(self, pending: dict[str, AnyTopic]) -> dict[str, AnyTopic]:
        """Query every key and deliver the answers. Return the queries without an answer."""
        unanswered: dict[str, AnyTopic] = {}
        items = list(pending.items())
        for first in range(0, len(items), AT_ONCE):
            batch = items[first : first + AT_ONCE]
            answers = await asyncio.gather(*(self._query(key, topic) for key, topic in batch))
            for (key, topic), samples in zip(batch, answers, strict=True):
                if samples:
                    self._deliver_samples(topic, samples)
                else:
                    unanswered[key] = topic
        return unanswered

    async def _query(self, key: str, topic: AnyTopic) -> list[zenoh.Sample]:
        """Return the states of `key` that keepers have, for each name one of each keeper."""
        limit = ReplyLimit(
            MAX_KEEPERS * max_names_for(topic.placeholder), topic.message.max_bytes, max_of_key=MAX_KEEPERS
        )
        return await query_samples(self._session, key, timeout_s=TIMEOUT_S, limit=limit, excess=self._excess)

    def _deliver_samples(self, topic: AnyTopic, samples: Sequence[zenoh.Sample]) -> None:
        mailboxes: list[tuple[str, Mailbox]] = []
        for row, reader_name, mailbox in self._readers:
            if row is topic and mailbox.accepts_retained:
                mailboxes.append((reader_name, mailbox))
        for sample in samples[: max_names_for(topic.placeholder)]:
            try:
                name = name_from_key(topic, str(sample.key_expr))
                message = decoded(topic.message, sample.payload, sample.encoding)
                check_writer(message, name)
            except SchemaError as error:
                for _, mailbox in mailboxes:
                    mailbox.count_invalid(error)
                continue
            for reader_name, mailbox in mailboxes:
                if reader_name in (ANY, name) or not topic.placeholder:
                    mailbox.offer_retained(name, message)
