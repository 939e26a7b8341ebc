"""A bus on which messages are late and lost."""

import asyncio
import contextlib
import random
from collections.abc import Callable
from typing import TypeVar

from pointit.runtime.bus.contract import Subscription
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.errors import BusClosedError
from pointit.schemas import Message
from pointit.schemas.topics import ANY, TOPICS, Delivery, Topic

M = TypeVar("M", bound=Message)


class BadLink(MemoryBus):
    """A bus on which every reader gets messages late, and loses a tenth of those of *latest* topics.

    Messages of *latest* topics may overtake each other; events and states are reliable and keep their order.
    """

    LOST = 0.1
    LATE_S = 0.1
    JITTER_S = 0.05

    def __init__(self, exchange: LocalBroker) -> None:
        super().__init__(exchange)
        self._random = random.Random(1)

    def subscribe(
        self,
        topic: Topic[M],
        handler: Callable[[M, str], None],
        name: str = ANY,
        *,
        retained: bool = True,
        queue_all: bool = False,
    ) -> Subscription:
        loop = asyncio.get_running_loop()
        may_be_lost = any(row.key == topic.key and row.delivery is Delivery.LATEST for row in TOPICS)

        def deliver(message: M, its_name: str) -> None:
            with contextlib.suppress(BusClosedError):  # the reader may have ended meanwhile
                handler(message, its_name)

        def on_arrival(message: M, its_name: str) -> None:
            late_s = self.LATE_S
            if may_be_lost:
                if self._random.random() < self.LOST:
                    return
                late_s += self._random.uniform(-self.JITTER_S, self.JITTER_S)
            loop.call_later(late_s, deliver, message, its_name)

        return super().subscribe(topic, on_arrival, name, retained=retained, queue_all=queue_all)
