"""Messages to send, and collectors of received ones."""

import asyncio
import time

from pointit.runtime.bus.contract import Publisher
from pointit.schemas import ButtonEvent, ImuSample, Message, UserProfile
from tests.support.bench import until

LEVEL = (0.0, 0.0, 0.0, 1.0)


def imu(seq: int) -> ImuSample:
    return ImuSample(stamp_ns=seq, seq=seq, orientation_xyzw=LEVEL)


def press(seq: int) -> ButtonEvent:
    return ButtonEvent(stamp_ns=seq, seq=seq)


def profile(seq: int) -> UserProfile:
    return UserProfile(stamp_ns=seq, seq=seq)


class Sink:
    """Keeps the messages of a subscription as (name, seq)."""

    def __init__(self) -> None:
        self.messages: list[Message] = []
        self.seen: list[tuple[str, int]] = []

    def __call__(self, message: Message, name: str) -> None:
        self.messages.append(message)
        self.seen.append((name, message.seq))

    def of(self, name: str) -> list[int]:
        return [seq for key, seq in self.seen if key == name]


async def reached(publisher: Publisher[ImuSample], *sinks: Sink) -> None:
    """Publish until every sink has a message: *latest* promises nothing to subscribers not known yet."""
    deadline_s = time.monotonic() + 30
    while not all(sink.seen for sink in sinks):
        assert time.monotonic() < deadline_s
        publisher.put(imu(0))
        await asyncio.sleep(0.01)
    publisher.put(imu(1))

    def is_quiet() -> bool:
        # nothing is on its way any more
        return all(sink.seen[-1][1] == 1 for sink in sinks)

    await until(is_quiet)
    for sink in sinks:
        sink.seen.clear()
        sink.messages.clear()


class Roll:
    """The present names, as reported to a watcher."""

    def __init__(self) -> None:
        self.told: list[tuple[str, bool]] = []

    def __call__(self, name: str, *, present: bool) -> None:
        self.told.append((name, present))
