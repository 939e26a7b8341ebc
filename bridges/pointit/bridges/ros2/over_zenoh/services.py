"""Servers and clients of ROS services on Zenoh."""

import asyncio
import contextlib
from dataclasses import replace

from pointit.bridges.ros2.graph.backend import SERVICE, RosType, Server, check_cdr
from pointit.bridges.ros2.graph.node_backend import RosEndpoint, RosServiceServer
from pointit.bridges.ros2.over_zenoh.attachment import Attachment, packed, unpacked
from pointit.bridges.ros2.over_zenoh.endpoint_context import EndpointContext
from pointit.runtime.errors import RefusedError
from pointit.runtime.foreign_zenoh.queries import IncomingQuery, QueryReply

EMPTY_RETRY_S = (0.005, 0.02, 0.05)
"""Delays before a request that reached no server is repeated: a new server is not known at once."""
GONE = "its server was gone before it answered"
AT_ONCE_S = 0.05
"""A request that ended without an answer within this time (s) reached no server; later, the server died."""


class ZenohServiceServer(RosServiceServer[EndpointContext]):
    """Answers one service."""

    def __init__(self, context: EndpointContext, service: str, kind: RosType, server: Server) -> None:
        """Declare. The presence token comes last, so that clients that see it find a server."""
        super().__init__(context, service, server)
        self._queryable = context.session.queryable(
            context.rmw.key(service, kind), self._on_query, max_bytes=context.max_bytes
        )
        self._token = context.announce("server", service, kind, SERVICE)
        context.ends.add(self)

    def _undeclare(self) -> None:
        self._token.close()
        self._queryable.close()

    def _on_query(self, query: IncomingQuery) -> None:
        try:
            origin = unpacked(query.attachment)
        except ValueError as error:
            why = f"dropped a request to {self.name}: {error}"
            self._context.warnings.show_briefly(f"attachments of {self.name}", why)
            self._start(id(query), query.refuse(str(error)))
            return
        mark = origin.gid, origin.sequence
        if mark in self._tasks:
            self._start(id(query), query.refuse("duplicate sequence number"))
        else:
            self._start(mark, self._answer(query, origin))

    async def _answer(self, query: IncomingQuery, origin: Attachment) -> None:
        try:
            response = await self._response(query.payload, bytes)
        except asyncio.CancelledError:
            query.drop()
            raise
        except RefusedError as error:
            await query.refuse(str(error))
        else:
            await query.answer(response, packed(replace(origin, stamp_ns=self._context.now_ns())))


class ZenohServiceClient(RosEndpoint[EndpointContext]):
    """Client of one service."""

    def __init__(self, context: EndpointContext, service: str, kind: RosType) -> None:
        super().__init__(context, service)
        self._querier = context.session.querier(context.rmw.key(service, kind), max_bytes=context.max_bytes)
        self._token = context.announce("client", service, kind, SERVICE)
        context.ends.add(self)

    async def call(self, request: bytes, *, timeout_s: float) -> bytes:
        """Return the response's CDR.

        Raises:
            TimeoutError: If there is no server, or no answer of it in time.
        """
        check_cdr(request)
        loop = self._context.loop
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
            raise TimeoutError(f"ROS service {self.name}: {why}") from error
        why = "; ".join(dict.fromkeys(refusals)) or GONE
        raise TimeoutError(f"ROS service {self.name}: {why}")

    async def _ask(self, request: bytes, refusals: list[str]) -> bytes | None:
        """Return the first good response, or None, with the reasons of rejections added to `refusals`."""
        origin = self._token.next()
        async with contextlib.aclosing(self._querier.ask(request, packed(origin))) as answers:
            async for answer in answers:
                reason = answer.refusal or self._objection(answer, origin)
                if not reason:
                    return answer.payload
                refusals.append(reason)
        return None

    def _objection(self, answer: QueryReply, origin: Attachment) -> str:
        """Return the rejection of `answer` to the request from `origin`, or `""`."""
        try:
            echo = unpacked(answer.attachment)
        except ValueError as error:
            return f"its answer was dropped: {error}"
        if (echo.gid, echo.sequence) != (origin.gid, origin.sequence):
            return "its answer was dropped: it is to another request"
        return ""

    def _undeclare(self) -> None:
        self._token.close()
        self._querier.close()
