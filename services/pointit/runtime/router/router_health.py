# pyright: reportUnknownMemberType=false
# (the stubs of zenoh leave return types out)
"""A router's account of itself on a site it routes for: present as a service is, with its health."""

import os
import re
import socket
import time
from collections.abc import Sequence

import zenoh

from pointit.runtime.zenoh.wire_format import encoding_of
from pointit.schemas import Figure, Health, encode
from pointit.schemas.text import hide_secrets
from pointit.schemas.topics import HEALTH, SERVICE_ALIVE

SERVICE = "router"
NO_NAME = re.compile(r"[^A-Za-z0-9_-]")
LONGEST_HOST = 48


class RouterHealthPublisher:
    """Health of a router for `pointit doctor` and the page. Access rules let only routers write it."""

    def __init__(self, session: zenoh.Session, site: str, *, joins_another: bool) -> None:
        """Be present at `site`, as long as `session` is open.

        `joins_another`: it is one of several routers of the site, which are told apart by their machines.
        """
        host = NO_NAME.sub("-", socket.gethostname())[:LONGEST_HOST]
        self._instance = f"{SERVICE}-{host}" if joins_another else SERVICE
        self._session = session
        self._root = f"pointit/{site}"
        self._began_s = time.monotonic()
        self._seq = 0
        self._token = session.liveliness().declare_token(f"{self._root}/{SERVICE_ALIVE.at(self._instance)}")

    def report(self, warnings: Sequence[str], refused: int, sessions: int) -> None:
        """Publish the warnings, the number of refused attempts, and the number of connections."""
        self._seq += 1
        health = Health(
            stamp_ns=time.time_ns(),
            seq=self._seq,
            service=SERVICE,
            instance=self._instance,
            pid=os.getpid(),
            host=socket.gethostname(),
            uptime_s=time.monotonic() - self._began_s,
            status="degraded" if warnings else "ok",
            warnings=tuple(map(hide_secrets, warnings)),
            figures=(
                Figure(name="refused", value=float(refused)),
                Figure(name="sessions", value=float(sessions)),
            ),
        )
        self._session.put(
            f"{self._root}/{HEALTH.at(self._instance)}",
            encode(health),
            encoding=encoding_of(Health),
            congestion_control=zenoh.CongestionControl.DROP,
        )
