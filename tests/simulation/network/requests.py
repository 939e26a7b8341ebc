"""Requests on the network: sent again while no server answers, as `send_query` of the Zenoh bus does."""

import asyncio
import functools
from collections.abc import Callable
from typing import Any

from pointit.runtime.bus.memory_bus import no_answer, shutting_down
from pointit.runtime.errors import RefusedError
from pointit.schemas.topics import Request
from tests.simulation.network.router import Router, Session

RETRY_WAITS_S = (0.01, 0.03, 0.1, 0.3)

Verdict = tuple[str, Any]
"""`ok` with the reply, `refused` with the sentence, or `none`: there is no server."""
NO_SERVER = ("none", None)


class RequestNetwork:
    """Questions and answers between processes."""

    def __init__(self, router: Router) -> None:
        self._router = router

    async def ask(self, caller: Session, request: Request[Any, Any], query: Any, name: str) -> Any:
        """Return the reply to `query`.

        Raises:
            RefusedError: The server refused.
            NoAnswerError: No server answered.
        """
        for wait_s in (*RETRY_WAITS_S, None):
            verdict, value = await self._ask_once(caller, request, query, name)
            if verdict == "ok":
                return value
            if verdict == "refused":
                raise RefusedError(value)
            if wait_s is not None:
                await asyncio.sleep(wait_s)
        raise no_answer(request, request.at(name))

    async def _ask_once(self, caller: Session, request: Request[Any, Any], query: Any, name: str) -> Verdict:
        server = self._server_of(caller, request, name)
        if server is None or not caller.is_connected:
            await asyncio.sleep(2 * self._router.delay_s(caller))
            return NO_SERVER
        answer: asyncio.Future[Verdict] = asyncio.get_running_loop().create_future()
        caller.answers.add(answer)
        server.answers.add(answer)
        reply = functools.partial(self._send_answer, server, caller, answer)
        work = functools.partial(self._serve, server, request, query, name, reply)
        self._router.carry(caller, server, "query", work)
        try:
            return await answer
        finally:
            caller.answers.discard(answer)
            server.answers.discard(answer)

    def _server_of(self, caller: Session, request: Request[Any, Any], name: str) -> Session | None:
        for session in self._router.sessions.values():
            if session is caller or not session.is_connected:
                continue
            if session.bus.exchange.handler_for(request, name) is not None:
                return session
        return None

    @staticmethod
    def _serve(
        server: Session, request: Request[Any, Any], query: Any, name: str, reply: Callable[[Verdict], object]
    ) -> None:
        handler = server.bus.exchange.handler_for(request, name)
        if handler is None:
            reply(NO_SERVER)
            return

        def on_done(task: "asyncio.Task[Any]") -> None:
            server.process.pass_point("reply")
            if server.process.is_dead:
                return
            if task.cancelled():
                reply(("refused", shutting_down(request)))
            elif task.exception() is not None:
                reply(("refused", str(task.exception())))
            else:
                reply(("ok", task.result()))

        handler.handle(query, name).add_done_callback(on_done)

    def _send_answer(
        self, server: Session, caller: Session, answer: asyncio.Future[Verdict], verdict: Verdict
    ) -> None:
        def deliver() -> None:
            if not answer.done():
                answer.set_result(verdict)

        self._router.carry(server, caller, "query", deliver)
