# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)
"""Reading topics over Zenoh; its callbacks arrive on its threads and only fill mailboxes."""

import functools
import time
from abc import ABC, abstractmethod

import zenoh

from pointit.runtime.bus.contract import AnyTopic, Sent
from pointit.runtime.bus.endpoints import MailboxSubscription
from pointit.runtime.bus.local_broker import Participant
from pointit.runtime.bus.mailbox import Mailbox
from pointit.runtime.bus.name_limiter import NameLimiter, Places
from pointit.runtime.transport.declarations import declare_caching_subscriber, declare_subscriber
from pointit.runtime.zenoh.event_recovery import EventRecovery
from pointit.runtime.zenoh.wire_format import PRIORITY, check_size, decoded, name_from_key
from pointit.schemas import DecodeError, Message, SchemaError
from pointit.schemas.topics import Delivery


class EncodedMessage:
    """Bytes from another process, for all readers of them in this one; in the loop."""

    __slots__ = ("_failure", "_kind", "_message", "_sample")

    def __init__(self, kind: type[Message], sample: zenoh.Sample) -> None:
        self._kind = kind
        self._sample = sample
        self._message: Message | None = None
        self._failure = ""

    @property
    def size(self) -> int:
        """Return its number of bytes."""
        return len(self._sample.payload)

    @property
    def sent(self) -> Sent | None:
        """Return when and by which process it was published, or None if it does not say.

        A process that hears a clock up to 0.5 s ahead of its own stamps no earlier than that one. Messages
        of a clock that is further ahead are stamped by the first router.
        """
        stamp = self._sample.timestamp
        return None if stamp is None else Sent(stamp.get_time_as_ntp64().as_nanos(), str(stamp.get_id()))

    def decode(self) -> Message:
        """Return the message; decoded for the first who asks, the same object for all others.

        Raises:
            DecodeError: it is none.
        """
        if self._failure:
            raise DecodeError(self._failure)
        message = self._message
        if message is None:
            try:
                message = self._message = decoded(self._kind, self._sample.payload, self._sample.encoding)
            except Exception as error:
                is_known = isinstance(error, DecodeError)
                self._failure = str(error) if is_known else f"{type(error).__name__}: {error}"
                raise
        return message


class _Inlet(ABC):
    """The input of samples of other processes, for the readers of one key. Called on Zenoh's threads."""

    def __init__(self, topic: AnyTopic, places: Places) -> None:
        self.mailboxes: tuple[Mailbox, ...] = ()
        """Replaced, never changed: other threads read it."""
        self._kind = topic.message
        self._names = NameLimiter(topic.placeholder, functools.partial(name_from_key, topic), places)

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
        parcel = EncodedMessage(self._kind, sample)
        for mailbox in mailboxes:
            mailbox.offer(name, parcel)

    @abstractmethod
    def undeclare(self) -> None: ...


class SharedSubscriber(_Inlet):
    """The shared input of all readers of a key: a sample is received and decoded once."""

    def __init__(self, session: zenoh.Session, topic: AnyTopic, key: str, places: Places) -> None:
        super().__init__(topic, places)
        self._subscriber = declare_subscriber(session, key, self.on_sample)

    def undeclare(self) -> None:
        """Hear nothing any more."""
        self._subscriber.undeclare()


class _KeptInlet(_Inlet):
    """The input of one reader of states or events, which begins with a history of its own."""

    def __init__(
        self,
        bus: Participant,
        session: zenoh.Session,
        topic: AnyTopic,
        key: str,
        mailbox: Mailbox,
        *,
        places: Places,
    ) -> None:
        super().__init__(topic, places)
        self.mailboxes = (mailbox,)
        self._began = session.new_timestamp()
        is_event = topic.delivery is Delivery.EVENT
        self._arrears = EventRecovery(bus, session, self._on_event, mailbox.count_lost) if is_event else None
        on_sample = self.on_sample if self._arrears is None else self._arrears.on_sample
        self._subscriber = declare_caching_subscriber(session, key, on_sample, history=0 if is_event else 1)

    def undeclare(self) -> None:
        self._subscriber.undeclare()
        if self._arrears is not None:
            self._arrears.close()

    def _on_event(self, sample: zenoh.Sample) -> None:
        # A writer that is heard for the first time makes Zenoh fetch everything it has kept: a button that
        # was pressed a minute ago must not be pressed now. What comes live is taken whatever its clock says.
        stamp = sample.timestamp
        if sample.priority == PRIORITY or stamp is None or stamp >= self._began:
            self.on_sample(sample)


class ZenohSubscription(MailboxSubscription):
    """A mailbox that is filled by this process's writers and by Zenoh."""

    def __init__(
        self,
        bus: Participant,
        session: zenoh.Session,
        topic: AnyTopic,
        mailbox: Mailbox,
        name: str,
        *,
        inlets: dict[str, SharedSubscriber],
        places: Places,
    ) -> None:
        """Fill `mailbox`; `inlets` are those of the bus, by key, `places` the names it takes in any case."""
        super().__init__(bus, topic, mailbox, name)
        self._key = topic.at(name)
        self._inlets = inlets
        self._inlet: SharedSubscriber | _KeptInlet
        if topic.delivery is not Delivery.LATEST:
            self._inlet = _KeptInlet(bus, session, topic, self._key, mailbox, places=places)
            return
        shared = inlets.get(self._key)
        if shared is None:
            shared = inlets[self._key] = SharedSubscriber(session, topic, self._key, places)
        shared.mailboxes = (*shared.mailboxes, mailbox)
        self._inlet = shared

    def _undeclare(self) -> None:
        super()._undeclare()
        inlet = self._inlet
        inlet.mailboxes = tuple(mailbox for mailbox in inlet.mailboxes if mailbox is not self._mailbox)
        if not inlet.mailboxes:
            self._inlets.pop(self._key, None)
            inlet.undeclare()
