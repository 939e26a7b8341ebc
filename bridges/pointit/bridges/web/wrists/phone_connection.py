"""One paired phone: what it says, and what waits to be told to it, whichever way it comes for it."""

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
from pointit.bridges.web.wire import MOST_TOLD, OWN_FAULT, Answer, Ask, Turn, WireModel
from pointit.bridges.web.wrists.pairing import Phone
from pointit.bridges.web.wrists.wrist_control import WristControl
from pointit.runtime.errors import PointItError
from pointit.runtime.health.service_bus import WarningSink
from pointit.schemas import SchemaError, WristSample, summarize_validation_error

log = logging.getLogger(__name__)

MOST_WAITING = 64
"""Messages that wait for a phone; the oldest give way."""

MOST_ASKS = 8
"""That one phone may have open."""

FRESH_S = 2.0
"""What has waited for longer is not told any more: nobody wants yesterday's chimes."""

RATE_HZ = 240.0
"""What a phone may say in a second in the long run, and `BURST` at once."""
BURST = 480.0

_said: TypeAdapter[Turn | Ask] = TypeAdapter(Annotated[Turn | Ask, Field(discriminator="kind")])


@dataclass(frozen=True, kw_only=True)
class PhoneHost:
    """What phones need of the service."""

    wrists: WristControl
    now_ns: Callable[[], int]
    """The site's time."""
    send: Callable[[str, WristSample], None]
    """Publishes a sample of a person's wrist."""
    answer: Callable[[str, Ask], Awaitable[Answer]]
    """Does what the phone with this page id asks for, which names its person; raises a `PointItError` or
    `SchemaError` that says why not."""
    changed: Callable[[], None]
    """Is told when who moves what may have changed."""
    warnings: WarningSink
    """Where malformed input shows."""
    version: str
    """Of PointIt."""
    site: str


class PhoneConnection:
    """The way from and to one phone, from pairing to unpairing."""

    def __init__(self, phone: Phone, host: PhoneHost) -> None:
        self.phone = phone
        self._host = host
        self._bucket = TokenBucket(RATE_HZ, BURST)
        self._waiting: deque[tuple[float, str]] = deque(maxlen=MOST_WAITING)
        """With the time of each."""
        self.woken = asyncio.Event()
        """Something waits."""
        self.asks: set[asyncio.Task[None]] = set()
        """What it has asked and not been answered."""
        self.malformed = 0
        """Messages that could not be understood."""
        self.dropped = 0
        """Messages beyond `RATE_HZ`."""

    def put(self, part: WireModel) -> None:
        """Have `part` told to the phone."""
        self._waiting.append((time.monotonic(), part.model_dump_json()))
        self.woken.set()

    def clear(self) -> None:
        """Forget what waits: the phone begins anew."""
        self._waiting.clear()
        self._host.warnings.clear(self._topic)

    def drain(self) -> list[str]:
        """Return what waits, as JSON, oldest first; from then on it does not."""
        now_s = time.monotonic()
        fresh = [text for when_s, text in self._waiting if now_s - when_s <= FRESH_S]
        self._waiting.clear()
        self.woken.clear()
        return fresh

    def hear(self, item: str | bytes | dict[str, Any]) -> WristSample | None:
        """Take a message, JSON or its object; return the sample of the wrist that it makes, if any."""
        if not self._bucket.take(time.monotonic()):
            self.dropped += 1
            self._host.warnings.warn(
                self._topic,
                f"the phone of {self.phone.user} says more than {RATE_HZ:.0f} things a second, "
                f"{self.dropped} were dropped in all; load its page again",
            )
            return None
        try:
            said = _said.validate_python(item) if isinstance(item, dict) else _said.validate_json(item)
        except ValidationError as error:
            self.complain(summarize_validation_error(error))
            return None
        if isinstance(said, Turn):
            return self._turn(said)
        if len(self.asks) >= MOST_ASKS:
            self.put(Answer(id=said.id, error="too much is asked at once: wait for the answers"))
            return None
        task = asyncio.create_task(self._ask(said), name=f"asked by the phone of {self.phone.user}")
        self.asks.add(task)
        task.add_done_callback(self.asks.discard)
        return None

    def complain(self, what: str) -> None:
        """Count a message that cannot be understood, and show it."""
        self.malformed += 1
        self._host.warnings.warn(
            self._topic,
            f"the phone of {self.phone.user} has sent what cannot be understood ({what[:MOST_TOLD]}), "
            f"{self.malformed} such messages in all; load its page again",
        )

    async def end(self) -> None:
        """Give up what is asked."""
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
