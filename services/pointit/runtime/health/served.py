"""A service's account of the requests that it has answered, for who records the site."""

import logging
from typing import TypeVar

from pointit.runtime.bus.contract import Publisher, Server
from pointit.runtime.clock import Clock
from pointit.runtime.errors import BusClosedError
from pointit.schemas import Query, Reply, ServedRequest
from pointit.schemas.topics import Request

Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)

MAX_REPLY = ServedRequest.max_bytes // 8
"""Most characters of a reply that are published: each has up to four bytes."""

MAX_REFUSAL = 4096

log = logging.getLogger(__name__)


class ServedPublisher:
    """Publishes each request of one service after it was answered."""

    def __init__(
        self, publisher: Publisher[ServedRequest], clock: Clock, *, service: str, instance: str
    ) -> None:
        self._publisher = publisher
        self._clock = clock
        self._service = service
        self._instance = instance
        self._seq = 0

    def reporting(self, request: Request[Q, R], server: Server[Q, R]) -> Server[Q, R]:
        """Return `server`, whose queries, replies and refusals are also published."""

        async def answer(query: Q, name: str) -> R:
            asked_ns = self._clock.now_ns()
            try:
                reply = await server(query, name)
            except Exception as error:
                self._put(asked_ns, request.at(name), query, None, str(error) or type(error).__name__)
                raise
            self._put(asked_ns, request.at(name), query, reply, "")
            return reply

        return answer

    def _put(self, asked_ns: int, key: str, query: Query, reply: Reply | None, refusal: str) -> None:
        """Publish; whatever is wrong with it is logged, since the request itself is answered."""
        self._seq += 1
        try:
            text = "" if reply is None else reply.model_dump_json()
            if len(text) > MAX_REPLY:
                log.warning("the reply to %s is too large to be recorded: %d characters", key, len(text))
                text = ""
            self._publisher.put(
                ServedRequest(
                    stamp_ns=asked_ns,
                    seq=self._seq,
                    service=self._service,
                    instance=self._instance,
                    request=key,
                    query=query.model_dump_json(),
                    reply=text,
                    refusal=refusal[:MAX_REFUSAL],
                )
            )
        except BusClosedError:
            pass
        except Exception:
            log.exception("a request to %s is answered, but not published for recordings", key)
