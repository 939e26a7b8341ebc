"""Topics on the network: delivery, loss, and recovery of what was lost.

- Newest values are in order for each writer and reader. A full queue drops them, and so does a cut link.
- Events are in order. A lost one is fetched from the cache of its writer while that lives, and later ones
  wait for it. After 15 s without an answer it is counted as lost.
- The last value of a state is fetched again from its writer while that lives.
"""

import collections
import functools
from dataclasses import dataclass, field

from pointit.runtime.bus.contract import AnyTopic
from pointit.runtime.bus.mailbox import Mailbox
from pointit.schemas import Message
from pointit.schemas.topics import ANY, Delivery
from tests.simulation.network.router import Router, Session

CACHED_EVENTS = 500
HEARTBEAT_S = 0.2
"""Period in which a writer says how many events it has sent, s."""
RECOVERY_WAITS_S = (0.0, 0.1, 0.2, 0.4, 0.8, 1.6, 2.0, 2.0, 2.0, 2.0, 2.0)
"""Waits before each question for lost events, s."""


@dataclass(eq=False)
class Writer:
    """A publisher as the network sees it."""

    session: Session
    topic: AnyTopic
    name: str
    number: int
    cache: collections.deque[tuple[int, float, Message]]
    """Newest messages with their numbers and times, s."""
    count: int = 0
    is_open: bool = True


@dataclass(eq=False)
class Gap:
    """Lost events of one writer, and later ones that wait for them."""

    first: int
    waiting: dict[int, Message] = field(default_factory=dict[int, Message])
    questions: int = 0


@dataclass(eq=False)
class Reader:
    """A subscription as the network sees it."""

    session: Session
    topic: AnyTopic
    name: str
    mailbox: Mailbox
    began_s: float
    last: dict[Writer, int] = field(default_factory=dict[Writer, int])
    """Number of the newest message from each writer."""
    gaps: dict[Writer, Gap] = field(default_factory=dict[Writer, Gap])
    is_open: bool = True

    def reads(self, writer: Writer) -> bool:
        """Return True if messages of `writer` come to it over the network."""
        return self.name in (ANY, writer.name) and self.session is not writer.session


class MessageNetwork:
    """Writers and readers of all topics, and what passes between them."""

    def __init__(self, router: Router) -> None:
        self.lost_events = 0
        self.dropped = 0
        self._router = router
        self._timeline = router.timeline
        self._readers: dict[str, list[Reader]] = {}
        """By topic key."""
        self._readers_of: dict[tuple[str, str], list[Reader]] = {}
        """By topic key and the name of the writer. Emptied when a reader comes or goes."""
        self._writers: dict[str, dict[int, Writer]] = {}
        """By topic key and number."""
        self._writer_count = 0
        router.on_connected.append(self._on_connected)
        router.on_closed.append(self._on_closed)

    # Declarations

    def add_writer(self, session: Session, topic: AnyTopic, name: str) -> Writer:
        """Declare a writer."""
        self._writer_count += 1
        size = CACHED_EVENTS if topic.delivery is Delivery.EVENT else 1
        cache = collections.deque[tuple[int, float, Message]](maxlen=size)
        writer = Writer(session, topic, name, self._writer_count, cache)
        self._writers.setdefault(topic.key, {})[writer.number] = writer
        return writer

    def remove_writer(self, writer: Writer) -> None:
        """Remove a writer and its cache."""
        writer.is_open = False
        self._writers[writer.topic.key].pop(writer.number, None)

    def add_reader(self, session: Session, topic: AnyTopic, name: str, mailbox: Mailbox) -> Reader:
        """Declare a reader. It fetches the last values of states."""
        reader = Reader(session, topic, name, mailbox, self._timeline.now_s)
        self._readers.setdefault(topic.key, []).append(reader)
        self._readers_of.clear()
        if topic.delivery is Delivery.STATE:
            for writer in list(self._writers.get(topic.key, {}).values()):
                if reader.reads(writer):
                    self._fetch_state(reader, writer)
                    self._catch_up_later(reader, writer)
        return reader

    def remove_reader(self, reader: Reader) -> None:
        """Remove a reader."""
        if not reader.is_open:
            return
        reader.is_open = False
        self._readers[reader.topic.key].remove(reader)
        self._readers_of.clear()

    def _on_closed(self, session: Session) -> None:
        for writers in self._writers.values():
            for writer in list(writers.values()):
                if writer.session is session:
                    self.remove_writer(writer)
        for readers in list(self._readers.values()):
            for reader in list(readers):
                if reader.session is session:
                    self.remove_reader(reader)

    def _on_connected(self, session: Session) -> None:
        """Fetch what this process lacks of others, and what others lack of it."""
        for key, readers in self._readers.items():
            for reader in readers:
                for writer in self._writers.get(key, {}).values():
                    if session in (reader.session, writer.session) and reader.reads(writer):
                        self._catch_up_later(reader, writer)

    # Delivery

    def send(self, writer: Writer, message: Message) -> None:
        """Send `message` to all readers in other processes."""
        writer.count += 1
        is_latest = writer.topic.delivery is Delivery.LATEST
        if not is_latest:
            writer.cache.append((writer.count, self._timeline.now_s, message))
        kind = "latest" if is_latest else "data"
        for reader in self._readers_for(writer):
            if reader.session is writer.session:
                continue
            if self._router.is_dropped(writer.session, reader.session):
                self.dropped += 1
                self._catch_up_later(reader, writer)
                continue
            deliver = functools.partial(self._receive, reader, writer, writer.count, message)
            self._router.carry(writer.session, reader.session, kind, deliver)

    def _readers_for(self, writer: Writer) -> list[Reader]:
        key = (writer.topic.key, writer.name)
        readers = self._readers_of.get(key)
        if readers is None:
            readers = []
            for reader in self._readers.get(writer.topic.key, ()):
                if reader.name in (ANY, writer.name):
                    readers.append(reader)
            self._readers_of[key] = readers
        return readers

    def _receive(self, reader: Reader, writer: Writer, number: int, message: Message) -> None:
        if not reader.is_open:
            return
        delivery = reader.topic.delivery
        if delivery is Delivery.LATEST:
            reader.mailbox.offer(writer.name, message)
            return
        last = reader.last.get(writer)
        if last is not None and number <= last:
            return
        if delivery is Delivery.EVENT:
            gap = reader.gaps.get(writer)
            if gap is not None:
                gap.waiting[number] = message
                return
            first = self._first_wanted(reader, writer)
            if number > first:
                gap = Gap(first, {number: message})
                reader.gaps[writer] = gap
                self._ask_writer_later(reader, writer, gap)
                return
        reader.last[writer] = number
        reader.mailbox.offer(writer.name, message)

    @staticmethod
    def _first_wanted(reader: Reader, writer: Writer) -> int:
        """Return the number of the first event that a reader lacks. It wants none of before its time."""
        last = reader.last.get(writer)
        if last is not None:
            return last + 1
        for number, sent_s, _message in writer.cache:
            if sent_s >= reader.began_s:
                return number
        return writer.count + 1

    # Recovery

    def _fetch_state(self, reader: Reader, writer: Writer) -> None:
        """Ask a writer for its last value."""
        for number, _sent_s, message in writer.cache:
            deliver = functools.partial(self._receive, reader, writer, number, message)
            answer = functools.partial(self._router.carry, writer.session, reader.session, "data", deliver)
            self._router.carry(reader.session, writer.session, "query", answer)

    def _catch_up_later(self, reader: Reader, writer: Writer) -> None:
        """Have the next heartbeat of the writer tell the reader what it lacks."""
        if writer.topic.delivery is not Delivery.LATEST:
            wait_s = HEARTBEAT_S * (1.0 + self._router.random.random())
            self._timeline.after(wait_s, self._catch_up, reader, writer)

    def _catch_up(self, reader: Reader, writer: Writer) -> None:
        if not reader.is_open or not writer.is_open:
            return
        if not reader.session.is_connected or not writer.session.is_connected:
            return  # again when both are connected
        if reader.session.link.is_cut or writer.session.link.is_cut:
            self._catch_up_later(reader, writer)
            return
        if writer.topic.delivery is Delivery.STATE:
            for number, _sent_s, message in writer.cache:
                deliver = functools.partial(self._receive, reader, writer, number, message)
                self._router.carry(writer.session, reader.session, "data", deliver)
            return
        if writer in reader.gaps:
            return
        first = self._first_wanted(reader, writer)
        if writer.count >= first:
            gap = Gap(first)
            reader.gaps[writer] = gap
            self._ask_writer_later(reader, writer, gap)

    def _ask_writer_later(self, reader: Reader, writer: Writer, gap: Gap) -> None:
        if gap.questions >= len(RECOVERY_WAITS_S):
            self._close_gap(reader, writer, gap)
            return
        wait_s = RECOVERY_WAITS_S[gap.questions]
        wait_s += self._router.delay_s(reader.session) + self._router.delay_s(writer.session)
        gap.questions += 1
        self._timeline.after(wait_s, self._ask_writer, reader, writer, gap)

    def _ask_writer(self, reader: Reader, writer: Writer, gap: Gap) -> None:
        if reader.gaps.get(writer) is not gap or not reader.is_open:
            return
        if not self._can_answer(reader, writer):
            self._ask_writer_later(reader, writer, gap)
            return
        for number, _sent_s, message in writer.cache:
            if number >= gap.first:
                gap.waiting.setdefault(number, message)
        deliver = functools.partial(self._close_gap, reader, writer, gap)
        self._router.carry(writer.session, reader.session, "data", deliver)

    def _can_answer(self, reader: Reader, writer: Writer) -> bool:
        process = writer.session.process
        if not writer.is_open or not process.zenoh_is_alive:
            return False
        if not writer.session.is_connected or not reader.session.is_connected:
            return False
        if writer.session.link.is_cut or reader.session.link.is_cut:
            return False
        return not self._router.is_dropped(writer.session, reader.session)

    def _close_gap(self, reader: Reader, writer: Writer, gap: Gap) -> None:
        """Deliver what was fetched and what has waited, and count what is lost."""
        if reader.gaps.get(writer) is not gap:
            return
        del reader.gaps[writer]
        last = gap.first - 1
        for number in sorted(gap.waiting):
            lost = number - last - 1
            if lost > 0:
                self.lost_events += lost
                reader.mailbox.count_lost(lost)
            last = number
            reader.mailbox.offer(writer.name, gap.waiting[number])
        reader.last[writer] = last
