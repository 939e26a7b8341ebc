"""Servers and clients of ROS services on Zenoh."""

import asyncio
import contextlib
import logging
from collections.abc import Coroutine
from dataclasses import replace
from typing import Any

from pointit.bridges.ros2.graph.backend import SERVICE, RosType, Server, check_cdr
from pointit.bridges.ros2.over_zenoh.attachment import Attachment
from pointit.bridges.ros2.over_zenoh.endpoint_context import EndpointContext, SequenceCounter
from pointit.runtime.errors import RefusedError
from pointit.runtime.foreign_zenoh.queries import IncomingQuery, QueryReply

log = logging.getLogger(__name__)

EMPTY_RETRY_S = (0.005, 0.02, 0.05)
"""Delays before a request that reached no server is repeated: a new server is not known at once."""
GONE = "its server was gone before it answered"
AT_ONCE_S = 0.05
"""A request that ended without an answer within this time (s) reached no server; later, the server died."""


class RosServiceServer:
    """Answers one service."""

    def __init__(self, context: EndpointContext, service: str, kind: RosType, server: Server) -> None:
        """Declare. The presence token comes last, so that clients that see it find a server."""
        self._context = context
        self._service = service
        self._server = server
        self._answering: dict[tuple[bytes, int] | int, asyncio.Task[None]] = {}
        self._queryable = context.session.queryable(
            context.rmw.key(service, kind), self._on_query, max_bytes=context.max_bytes
        )
        self._token = context.announce(context.rmw.endpoint_token("server", service, kind, SERVICE))
        context.ends.add(self)

    def close(self) -> None:
        """Stop serving; open requests are dropped."""
        if not self._context.session.is_closed:
            self._token.close()
            self._queryable.close()
        for task in self._answering.values():
            task.cancel()
        self._context.ends.discard(self)

    def _on_query(self, query: IncomingQuery) -> None:
        try:
            origin = self._context.rmw.unpack(query.attachment)
        except ValueError as error:
            why = f"dropped a request to {self._service}: {error}"
            self._context.warnings.show_briefly(f"attachments of {self._service}", why)
            self._start(id(query), query.refuse(str(error)))
            return
        mark = origin.gid, origin.sequence
        if mark in self._answering:
            self._start(id(query), query.refuse("duplicate sequence number"))
        else:
            self._start(mark, self._answer(query, origin))

    def _start(self, mark: tuple[bytes, int] | int, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.get_running_loop().create_task(work, name=f"answer {self._service}")
        self._answering[mark] = task
        task.add_done_callback(lambda _task: self._answering.pop(mark, None))

    async def _answer(self, query: IncomingQuery, origin: Attachment) -> None:
        try:
            response = await self._server(query.payload)
            check_cdr(response)
        except asyncio.CancelledError:
            query.drop()
            raise
        except RefusedError as error:
            await query.refuse(str(error))
            return
        except Exception as error:  # a server must not raise, but its client must not wait for ever either
            log.exception("a request to %s could not be answered", self._service)
            await query.refuse(f"{type(error).__name__}: {error}")
            return
        await query.answer(response, self._context.rmw.pack(replace(origin, stamp_ns=self._context.now_ns())))


class ServiceClient:
    """Client of one service."""

    def __init__(self, context: EndpointContext, service: str, kind: RosType) -> None:
        self._context = context
        self._service = service
        token = context.rmw.endpoint_token("client", service, kind, SERVICE)
        self._querier = context.session.querier(context.rmw.key(service, kind), max_bytes=context.max_bytes)
        self._sender = SequenceCounter(context, token)
        self._token = context.announce(token)
        context.ends.add(self)

    async def call(self, request: bytes, *, timeout_s: float) -> bytes:
        """Return the response's CDR.

        Raises:
            TimeoutError: If there is no server, or no answer of it in time.
        """
        check_cdr(request)
        loop = asyncio.get_running_loop()
        refusals: list[str] = []
        lacking = "no node serves it"
        try:
            async with asyncio.timeout(timeout_s):
                for wait_s in (*EMPTY_RETRY_S, None):
                    await self._querier.wait_for_server()
                    lacking = "its server did not answer"
                    began_s = loop.time()
                    response = await self._ask(request, refusals)
                    if response is not None:
                        return response
                    lacking = GONE
                    if wait_s is None or refusals or loop.time() - began_s > AT_ONCE_S:
                        break
                    await asyncio.sleep(wait_s)
        except TimeoutError as error:
            why = "; ".join(dict.fromkeys([*refusals, f"{lacking} within {timeout_s:g} s"]))
            raise TimeoutError(f"ROS service {self._service}: {why}") from error
        why = "; ".join(dict.fromkeys(refusals)) or GONE
        raise TimeoutError(f"ROS service {self._service}: {why}")

    async def _ask(self, request: bytes, refusals: list[str]) -> bytes | None:
        """Return the first good response, or None, with the reasons of rejections added to `refusals`."""
        origin = self._sender.next()
        attachment = self._context.rmw.pack(origin)
        async with contextlib.aclosing(self._querier.ask(request, attachment)) as answers:
            async for answer in answers:
                reason = answer.refusal or self._objection(answer, origin)
                if not reason:
                    return answer.payload
                refusals.append(reason)
        return None

    def _objection(self, answer: QueryReply, origin: Attachment) -> str:
        """Return the rejection of `answer` to the request from `origin`, or `""`."""
        try:
            echo = self._context.rmw.unpack(answer.attachment)
        except ValueError as error:
            return f"its answer was dropped: {error}"
        if (echo.gid, echo.sequence) != (origin.gid, origin.sequence):
            return "its answer was dropped: it is to another request"
        return ""

    def close(self) -> None:
        """Stop calling."""
        if not self._context.session.is_closed:
            self._token.close()
            self._querier.close()
        self._sender.close()
        self._context.ends.discard(self)
