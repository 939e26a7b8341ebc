"""Sentences of a service to people: their page, phone and voice show or speak them."""

import asyncio
from collections.abc import Sequence

from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.errors import PointItError
from pointit.schemas.pointing import StepChoice
from pointit.schemas.requests import Say
from pointit.schemas.topics import SAY

UNTOLD = "person-untold"
"""Code of the problem that a person's supervisor did not take a sentence."""
GUIDANCE_PERIOD_S = 10.0
"""Interval at which the same guidance is sent again, s."""
RETRY_S = 5.0
"""Time after which advice that was not delivered may be sent again, s."""


class PersonMessages:
    """Sends sentences of one service to people, without waiting for their answers.

    A sentence that cannot be delivered is a problem of the service's health, until the next one is.
    """

    def __init__(self, bus: ServiceBus, instance: str) -> None:
        """Create it for a service that is present as `instance`."""
        self._bus = bus
        self._instance = instance
        self._advice: dict[str, str] = {}
        """The last advice, by person."""
        self._guidance: dict[str, tuple[Say, float]] = {}
        """The last guidance, by person, and when it was sent."""
        self._sending: set[asyncio.Task[None]] = set()

    def tell(self, user: str, text: str) -> None:
        """Show `text`, at most 200 characters, to `user` once, with a chime."""
        self._send(user, Say(text=text, service=self._instance))

    def advise(self, user: str, text: str) -> None:
        """Show `text` to `user` as their next step, in place of the last advice. Again: no effect."""
        if self._advice.get(user) != text:
            self._advice[user] = text
            self._send(user, Say(text=text, stays=True, service=self._instance))

    def guide(self, user: str, text: str, choices: Sequence[StepChoice] = ()) -> None:
        """Show `text` to `user` as their next step, also while they rest, with choices.

        To be repeated: the same is sent again only now and then, for a supervisor that has started again.
        """
        query = Say(text=text, stays=True, guides=True, choices=tuple(choices), service=self._instance)
        now_s = asyncio.get_running_loop().time()
        previous, sent_s = self._guidance.get(user, (None, 0.0))
        if previous != query or now_s - sent_s > GUIDANCE_PERIOD_S:
            self._guidance[user] = (query, now_s)
            self._send(user, query)

    def end_guidance(self, user: str) -> None:
        """Lead `user` no longer."""
        previous = self._guidance.pop(user, None)
        if previous is not None:
            self._send(user, Say(text=previous[0].text, is_over=True, service=self._instance))

    def _send(self, user: str, query: Say) -> None:
        # The task is referenced here, since a loop alone would let it be collected
        task = asyncio.create_task(self._deliver(user, query))
        self._sending.add(task)
        task.add_done_callback(self._sending.discard)

    async def _deliver(self, user: str, query: Say) -> None:
        try:
            await self._bus.call(SAY, query, user)
        except PointItError as error:  # such as a person without a supervisor
            if query.stays:
                self._bus.call_later(RETRY_S, lambda: self._forget(user, query))
            self._bus.warn(UNTOLD, f"{user} was not told {query.text!r}: {error}", user)
        else:
            self._bus.clear(UNTOLD, user)

    def _forget(self, user: str, query: Say) -> None:
        if self._advice.get(user) == query.text:
            del self._advice[user]
        if query.guides and self._guidance.get(user, (None, 0.0))[0] == query:
            del self._guidance[user]
