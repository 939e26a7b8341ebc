"""Bus of a process on a secured site, which knows the rights of its identity."""

import contextlib
from collections.abc import AsyncGenerator
from typing import TypeVar

import zenoh

from pointit.runtime.bus.contract import REQUEST_TIMEOUT_S, AnyTopic
from pointit.runtime.errors import AccessDeniedError, NoAnswerError
from pointit.runtime.link.credentials import Credentials
from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.permission_probe import PermissionProbe
from pointit.runtime.zenoh.session import close_session, open_session
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Query, Reply
from pointit.schemas.topics import Request

Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)


class RestrictedBus(ZenohBus):
    """A bus that tests each right that it uses, and says which are denied: the router says nothing."""

    def __init__(self, session: zenoh.Session, link: Link, credentials: Credentials) -> None:
        """Create a bus on `session`, which the bus closes."""
        super().__init__(session, link)
        self._probe = PermissionProbe(session, credentials, self._second, lambda: self.connected)

    @property
    def problem(self) -> str:
        """Return a message if the router is lost, a right is denied or queries are rejected, else `""`."""
        denied = self._probe.problem if self.connected else ""
        return denied or super().problem

    @property
    def is_restricted(self) -> bool:
        """Return True: access rules of a router apply."""
        return True

    async def denial_reason(self, verb: str, topic: AnyTopic, name: str) -> str:
        """Return the reason if a right of this identity is denied, else `""`. The test takes 2 s.

        `verb`: `writes` or `reads`. `name`: the placeholder, or `*` for any.

        Returns:
            `""` also without a router.
        """
        return await self._probe.denial_reason(verb, topic.at(name))

    async def call(
        self, request: Request[Q, R], query: Q, name: str = "", *, timeout_s: float = REQUEST_TIMEOUT_S
    ) -> R:
        """Return the reply of the server of `request`, in this process or another."""
        try:
            return await super().call(request, query, name, timeout_s=timeout_s)
        except NoAnswerError as error:
            may_be_denied = self.connected and self.exchange.handler_for(request, name) is None
            if may_be_denied and (denied := await self._probe.denial_reason("asks", request.at(name))):
                raise AccessDeniedError(denied) from error
            raise

    async def close(self) -> None:
        """Close everything that was declared here, and the session."""
        await self._probe.close()
        await super().close()

    def _want(self, verb: str, key: str) -> None:
        self._probe.add(verb, key)

    def _on_back(self) -> None:
        self._probe.retest()

    @contextlib.asynccontextmanager
    async def _second(self) -> AsyncGenerator[zenoh.Session]:
        session = await open_session(self.link, patience_s=0.0)
        try:
            yield session
        finally:
            await close_session(session)
