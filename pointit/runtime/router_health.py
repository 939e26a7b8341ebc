"""Health of a router for `pointit doctor` and the page."""

import re
import time
from collections.abc import Sequence

import zenoh

from pointit.runtime.machine import this_machine
from pointit.runtime.zenoh.declarations import encoding_of
from pointit.schemas import Figure, Health, encode
from pointit.schemas.problems import Problem
from pointit.schemas.topics import HEALTH, SERVICE_ALIVE

SERVICE = "router"
NO_NAME = re.compile(r"[^A-Za-z0-9_-]")
LONGEST_HOST = 48


class RouterHealthPublisher:
    """Health of a router for `pointit doctor` and the page. Access rules let only routers write it."""

    def __init__(self, session: zenoh.Session, site: str, *, joins_another: bool) -> None:
        """Be present at `site` while `session` is open.

        `joins_another`: the site has several routers, which get the names of their machines.
        """
        host = NO_NAME.sub("-", this_machine().host_name)[:LONGEST_HOST]
        self._instance = f"{SERVICE}-{host}" if joins_another else SERVICE
        self._session = session
        self._root = f"pointit/{site}"
        self._began_s = time.monotonic()
        self._seq = 0
        key = f"{self._root}/{SERVICE_ALIVE.at(self._instance)}"
        self._token = session.liveliness().declare_token(key)

    def report(self, problems: Sequence[Problem], refused: int, sessions: int) -> None:
        """Publish the problems, the number of refused attempts, and the number of connections."""
        self._seq += 1
        shown_problems = tuple(problem.without_secrets() for problem in problems)
        warnings = tuple(problem.sentence for problem in shown_problems if problem.severity == "warning")
        figures = (
            Figure(name="refused", value=float(refused)),
            Figure(name="sessions", value=float(sessions)),
        )
        health = Health(
            stamp_ns=this_machine().now_ns(),
            seq=self._seq,
            service=SERVICE,
            instance=self._instance,
            pid=this_machine().process_id,
            host=this_machine().host_name,
            uptime_s=time.monotonic() - self._began_s,
            status="degraded" if warnings else "ok",
            warnings=warnings,
            problems=shown_problems,
            figures=figures,
        )
        self._session.put(
            f"{self._root}/{HEALTH.at(self._instance)}",
            encode(health),
            encoding=encoding_of(Health),
            congestion_control=zenoh.CongestionControl.DROP,
        )
