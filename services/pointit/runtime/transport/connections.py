# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false
# (the stubs of zenoh leave return types out)
"""The sessions that a session is connected to."""

import asyncio
import contextlib
from collections.abc import Callable, Sequence

import zenoh
from zenoh.handlers import Callback

from pointit.runtime.host.tcp_timeouts import set_user_timeout
from pointit.runtime.link.link import LEASE_MS, ports_of


class Connections:
    """Follows connections as they come and go, and sets their timeouts."""

    def __init__(
        self, session: zenoh.Session, endpoints: Sequence[str], on_change: Callable[[], None]
    ) -> None:
        """Call `on_change` in the loop for each connection there is now, and after each change.

        Args:
            session: whose connections.
            endpoints: to which it connects, or where it listens.
            on_change: called after `routers` has changed.
        """
        self.routers: dict[str, bool] = {}
        """Connected sessions by id: True for a router."""
        self._on_change = on_change
        self._ports = ports_of(endpoints)
        self._is_open = True
        self._loop = asyncio.get_running_loop()
        self._listener = session.info.declare_transport_events_listener(
            Callback(self._on_event, indirect=False), history=True
        )

    def __bool__(self) -> bool:
        return bool(self.routers)

    def close(self) -> None:
        """Follow no more."""
        if self._is_open:
            self._is_open = False
            self._listener.undeclare()

    def _on_event(self, event: zenoh.TransportEvent) -> None:  # on Zenoh's thread
        is_router = event.transport.whatami == zenoh.WhatAmI.ROUTER
        up = event.kind == zenoh.SampleKind.PUT
        with contextlib.suppress(RuntimeError):  # the loop is gone
            self._loop.call_soon_threadsafe(self._count, str(event.transport.zid), is_router, up)

    def _count(self, zid: str, is_router: bool, up: bool) -> None:  # noqa: FBT001
        if not self._is_open:
            return
        if up:
            set_user_timeout(self._ports, LEASE_MS)
            self.routers[zid] = is_router
        else:
            self.routers.pop(zid, None)
        self._on_change()
