"""One paired phone: its messages, and the queue of messages to it, by socket or post."""

import asyncio
import logging
import time
from collections import deque
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field, TypeAdapter, ValidationError

from pointit.bridges.web.pages.page_requests import is_allowed
from pointit.bridges.web.pages.rate_limit import TokenBucket
from pointit.bridges.web.wire import MAX_TOLD, OWN_FAULT, Answer, Ask, Turn, WireModel
from pointit.bridges.web.wrists.pairing import Phone
from pointit.bridges.web.wrists.wrist_control import WristControl
from pointit.runtime.errors import PointItError
from pointit.runtime.service.surroundings import WarningSink
from pointit.schemas import SchemaError, WristSample, summarize_validation_error

log = logging.getLogger(__name__)

MAX_WAITING = 64
"""Maximum number of queued messages to a phone; the oldest are dropped."""

MAX_ASKS = 8
"""Maximum number of open requests of one phone."""

FRESH_S = 2.0
"""Queued messages older than this (s) are not sent: late cues are useless."""

RATE_HZ = 240.0
"""Rate limit of a phone's messages in the long run, and `BURST` at once."""
BURST = 480.0

_said: TypeAdapter[Turn | Ask] = TypeAdapter(Annotated[Turn | Ask, Field(discriminator="kind")])


@dataclass(frozen=True, kw_only=True)
class PhoneHost:
    """Functions of the service for phones."""

    wrists: WristControl
    now_ns: Callable[[], int]
    """The site's time."""
    send: Callable[[str, WristSample], None]
    """Publishes a sample of a person's wrist."""
    answer: Callable[[str, Ask], Awaitable[Answer]]
    """Handles a request of the phone with this page id, which names its person; raises a `PointItError` or
    `SchemaError` if it is refused."""
    changed: Callable[[], None]
    """Called when the holder of a wrist may have changed."""
    warnings: WarningSink
    """Warnings about malformed input."""
    version: str
    """Version of PointIt."""
    site: str
    speaks: bool = False
    """Phones speak the names of things, unless the person chose otherwise."""


class PhoneConnection:
    """Messages from and to one phone, from pairing to unpairing."""

    def __init__(self, phone: Phone, host: PhoneHost) -> None:
        self.phone = phone
        self._host = host
        self._bucket = TokenBucket(RATE_HZ, BURST)
        self._waiting: deque[tuple[float, str]] = deque(maxlen=MAX_WAITING)
        """Queued messages with their times."""
        self.woken = asyncio.Event()
        """Set while messages are queued."""
        self.asks: set[asyncio.Task[None]] = set()
        """Requests that are not answered yet."""
        self.malformed = 0
        """Number of malformed messages."""
        self.dropped = 0
        """Number of messages beyond `RATE_HZ`."""

    def put(self, part: WireModel) -> None:
        """Queue `part` for the phone."""
        self._waiting.append((time.monotonic(), part.model_dump_json()))
        self.woken.set()

    def clear(self) -> None:
        """Clear the queue: the phone reconnects."""
        self._waiting.clear()
        self._host.warnings.clear(self._topic)

    def drain(self) -> list[str]:
        """Empty the queue, and return its messages as JSON, oldest first."""
        now_s = time.monotonic()
        fresh = [text for when_s, text in self._waiting if now_s - when_s <= FRESH_S]
        self._waiting.clear()
        self.woken.clear()
        return fresh

    def hear(self, item: str | bytes | dict[str, Any]) -> WristSample | None:
        """Process a message, JSON or its object, and return its wrist sample, or None if it has none."""
        if not self._bucket.take(time.monotonic()):
            self.dropped += 1
            self._host.warnings.warn(
                self._topic,
                f"the phone of {self.phone.user} sends more than {RATE_HZ:.0f} messages a second, "
                f"{self.dropped} were dropped in all; load its page again",
            )
            return None
        try:
            said = _said.validate_python(item) if isinstance(item, dict) else _said.validate_json(item)
        except ValidationError as error:
            self.on_malformed(summarize_validation_error(error))
            return None
        if isinstance(said, Turn):
            return self._turn(said)
        if len(self.asks) >= MAX_ASKS:
            self.put(Answer(id=said.id, error="too much is asked at once: wait for the answers"))
            return None
        task = asyncio.create_task(self._ask(said), name=f"asked by the phone of {self.phone.user}")
        self.asks.add(task)
        task.add_done_callback(self.asks.discard)
        return None

    def on_malformed(self, what: str) -> None:
        """Count a malformed message, and warn of it."""
        self.malformed += 1
        self._host.warnings.warn(
            self._topic,
            f"the phone of {self.phone.user} has sent malformed messages ({what[:MAX_TOLD]}), "
            f"{self.malformed} such messages in all; load its page again",
        )

    async def end(self) -> None:
        """Cancel open requests."""
        tasks = list(self.asks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    @property
    def _topic(self) -> str:
        return f"phone of {self.phone.user}"

    def _turn(self, turn: Turn) -> WristSample | None:
        phone, wrists = self.phone, self._host.wrists
        before = wrists.holder(phone.user)
        sample = wrists.turn(phone.user, phone.page, turn, self._host.now_ns())
        if wrists.holder(phone.user) != before:
            self._host.changed()
        return sample

    async def _ask(self, ask: Ask) -> None:
        if not is_allowed(ask, "wrist"):
            self.put(Answer(id=ask.id, error=f"a phone cannot ask for {ask.deed or ask.key!r}"))
            return
        if ask.deed == "centre" and self._host.wrists.holder(self.phone.user)[0] != self.phone.page:
            self.put(Answer(id=ask.id, error="this phone does not move the arm: take it first"))
            return
        own = ask.model_copy(update={"name": self.phone.user})
        try:
            answer = await self._host.answer(self.phone.page, own)
        except (PointItError, SchemaError) as error:
            answer = Answer(id=ask.id, error=str(error))
        except Exception:  # the phone waits for an answer
            log.exception("a phone asked %s and was not answered", ask.deed or ask.key)
            answer = Answer(id=ask.id, error=OWN_FAULT)
        self.put(answer)
