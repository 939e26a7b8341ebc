"""Servers and clients of ROS services through rclpy, which handles them only as values of built types."""

import asyncio
import contextlib
import logging
import threading
from typing import Any

from pointit.bridges.ros2.graph.backend import Server, check_cdr
from pointit.bridges.ros2.graph.node_backend import RosEndpoint, RosServiceServer
from pointit.bridges.ros2.over_rclpy.dds_context import DdsContext
from pointit.bridges.ros2.over_rclpy.rclpy_types import Reply, ServiceClass
from pointit.runtime.errors import RefusedError

log = logging.getLogger(__name__)

MAX_OPEN = 64
"""Maximum number of open requests to one service; further ones get an empty response."""
LOOK_S = 0.05
"""Interval (s) of checking for a server, of which rclpy does not notify."""


class DdsServiceServer(RosServiceServer[DdsContext]):
    """Answers one service."""

    def __init__(self, context: DdsContext, service: str, types: ServiceClass, server: Server) -> None:
        """Declare.

        rclpy sends what a callback returns. A waiting callback would block all others, and a coroutine makes
        the executor repeat the request. So the callback returns the request, and `send_response`, which the
        executor calls with that and the header to answer to, hands both to the loop.
        """
        super().__init__(context, service, server)
        self._types = types
        self._is_made = threading.Event()
        self._service = context.node.create_service(types, service, self._on_request)
        self._send = self._service.send_response
        self._service.send_response = self._on_header
        self._is_made.set()
        context.ends.add(self)

    def _undeclare(self) -> None:
        self._context.node.destroy_service(self._service)

    def _on_request(self, request: object, _response: object) -> bytes:  # on the executor's thread
        self._is_made.wait()
        return self._context.rclpy.serialize(request)

    def _on_header(self, request: bytes, header: object) -> None:  # on the executor's thread
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._context.loop.call_soon_threadsafe(self._begin, request, header)

    def _begin(self, request: bytes, header: object) -> None:
        if self.is_closed or self._context.is_closed:
            return
        if len(self._tasks) >= MAX_OPEN or len(request) > self._context.max_bytes:
            what = "too many requests are open" if len(self._tasks) >= MAX_OPEN else "it was too long"
            self._context.warnings.show_briefly(
                f"requests to {self.name}", f"a request to {self.name} was refused: {what}"
            )
            self._answer(self._types.Response(), header)
            return
        self._start(id(header), self._work(request, header))

    async def _work(self, request: bytes, header: object) -> None:
        types = self._types
        try:
            response = await self._response(
                request, lambda cdr: self._context.rclpy.deserialize(cdr, types.Response)
            )
        except RefusedError:  # DDS has no place for the reason, which the bridge's warnings have
            response = types.Response()
        self._answer(response, header)

    def _answer(self, response: object, header: object) -> None:
        if self.is_closed or self._context.is_closed:
            return
        try:
            self._send(response, header)
        except RuntimeError as error:  # an error of rcl: the client may be gone
            log.warning("an answer of %s could not be sent: %s", self.name, error)


class DdsClient(RosEndpoint[DdsContext]):
    """Client of one service."""

    def __init__(self, context: DdsContext, service: str, types: ServiceClass) -> None:
        super().__init__(context, service)
        self._types = types
        self._client = context.node.create_client(types, service)
        context.ends.add(self)

    async def call(self, request: bytes, *, timeout_s: float) -> bytes:
        """Return the response's CDR.

        Raises:
            ValueError: If `request` is not CDR.
            TimeoutError: If there is no server, or no answer of it in time.
        """
        check_cdr(request)
        try:
            value = self._context.rclpy.deserialize(request, self._types.Request)
        except Exception as error:  # any error of the installed version
            raise ValueError(f"{self.name}: this ROS cannot read the request ({error})") from error
        lacking = "no node serves it"
        reply: Reply | None = None
        try:
            async with asyncio.timeout(timeout_s):
                while not self._client.service_is_ready():  # noqa: ASYNC110 - rclpy has no event for it
                    await asyncio.sleep(LOOK_S)
                lacking = "its server did not answer"
                outcome: asyncio.Future[object] = self._context.loop.create_future()
                reply = self._client.call_async(value)
                reply.add_done_callback(lambda done: self._on_reply(done, outcome))
                return self._context.rclpy.serialize(await outcome)
        except TimeoutError as error:
            raise TimeoutError(f"ROS service {self.name}: {lacking} within {timeout_s:g} s") from error
        finally:
            if reply is not None and not self.is_closed and not self._context.is_closed:
                self._client.remove_pending_request(reply)

    def _undeclare(self) -> None:
        self._context.node.destroy_client(self._client)

    def _on_reply(self, reply: Reply, outcome: "asyncio.Future[object]") -> None:  # on the executor's thread
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._context.loop.call_soon_threadsafe(_settle, reply, outcome)


def _settle(reply: Reply, outcome: "asyncio.Future[Any]") -> None:
    if outcome.done():
        return
    try:
        outcome.set_result(reply.result())
    except Exception as error:  # noqa: BLE001 - handed to the caller
        outcome.set_exception(error)
