"""Servers of requests within this process."""

import asyncio
import logging
from typing import Any, Generic, TypeVar

from pointit.runtime.bus.contract import MAX_IN_FLIGHT, Server
from pointit.runtime.bus.endpoints import Declaration
from pointit.runtime.bus.local_broker import Participant
from pointit.runtime.errors import NoAnswerError, PointItError, RefusedError
from pointit.schemas import Query, Reply
from pointit.schemas.topics import ANY, Request

Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)

log = logging.getLogger(__name__)


class RequestHandler(Generic[Q, R]):
    """The server of one request. Each answer is a task that ends with the server, not with its caller."""

    def __init__(self, bus: Participant, request: Request[Q, R], server: Server[Q, R], name: str) -> None:
        self.request = request
        self.wanted = name if request.placeholder else ANY
        self._bus = bus
        self._server = server
        self._answers: set[asyncio.Task[R]] = set()
        self._desks = bus.exchange.desks.setdefault(request.key, [])
        self._desks.append(self)
        self._declaration = Declaration(bus, self._undeclare)

    def handle(self, query: Q, name: str) -> asyncio.Task[R]:
        """Begin to answer `query`; the task raises nothing but `RefusedError`."""
        is_busy = len(self._answers) >= MAX_IN_FLIGHT
        task = self._bus.spawn(self._answer(query, name, is_busy=is_busy), f"serve {self.request.key}")
        self._answers.add(task)
        task.add_done_callback(self._answers.discard)
        return task

    def close(self) -> None:
        """Answer no longer; callers that wait are told."""
        self._declaration.close()

    def _undeclare(self) -> None:
        self._desks.remove(self)
        for answer in self._answers:
            answer.cancel()

    async def _answer(self, query: Q, name: str, *, is_busy: bool) -> R:
        server, key = self.request.server, self.request.key
        if is_busy:
            raise RefusedError(f"{server} is busy with {MAX_IN_FLIGHT} other requests for {key}; ask later")
        try:
            reply = await self._server(query, name)
            if not isinstance(reply, self.request.reply):
                raise TypeError(f"the reply is a {type(reply).__name__}, not a {self.request.reply.__name__}")  # noqa: TRY301
        except RefusedError:
            raise
        except PointItError as error:  # a sentence for a person already
            raise RefusedError(str(error)) from error
        except Exception as error:
            log.exception("%s failed", key)
            raise RefusedError(f"{server} failed on {key}: {type(error).__name__}: {error}") from error
        return reply


def shutting_down(request: Request[Any, Any]) -> str:
    """Return the refusal for callers of a server that ends."""
    return f"{request.server} is shutting down"


def no_answer(request: Request[Any, Any], key: str, timeout_s: float | None = None) -> NoAnswerError:
    """Return the error that says who should have answered `key`."""
    waited = "" if timeout_s is None else f" within {timeout_s:g} s"
    return NoAnswerError(
        f"{request.server} does not answer {key}{waited}; is it running? See `pointit doctor`"
    )
