"""The Zenoh session of a process of a site."""

import dataclasses
import logging
from typing import Any

import zenoh

from pointit.runtime.errors import BusError, ConnectError, ListenError
from pointit.runtime.host.threads import in_daemon_thread
from pointit.runtime.link.credentials import connection_refusal
from pointit.runtime.link.link import LEASE_MS, Link, check_addresses
from pointit.runtime.transport import session as transport
from pointit.schemas.topics import check_name

log = logging.getLogger(__name__)

CONNECT_TIMEOUT_MS = 1000
"""Duration limit of an attempt to open. Later attempts to reach a lost router take up to 10 s: with less, the
attempts that clients have given up would keep a router that stood still busy for good, which turns away ten a
second (github.com/eclipse-zenoh/zenoh/issues/2685)."""

SOON_S = 5.0
"""Shorter attempts to open are not logged."""


def configuration(link: Link) -> zenoh.Config:
    """Return Zenoh's configuration for `link`.

    Who connects is a client: peers do not relay for peers, and gossip would pass by access rules.

    Raises:
        ConfigError: an endpoint is not one.
        KeyNameError: the site's name cannot stand in a key.
    """
    check_name(link.site, "site")
    check_addresses(link)
    if link.router:
        mode = "router"
    elif link.connect:
        mode = "client"
    else:
        mode = "peer"
    settings: dict[str, Any] = {
        "mode": mode,
        "listen/endpoints": list(link.listen),
        "connect/endpoints": list(link.connect),
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "timestamping/enabled": True,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": LEASE_MS,
    }
    if mode == "client":
        settings["connect/timeout_ms"] = CONNECT_TIMEOUT_MS
    else:
        settings["scouting/delay"] = 0
    if link.credentials is not None:
        settings |= link.credentials.settings()
    if not link.router:
        settings["namespace"] = f"pointit/{link.site}"
    return transport.config_of(settings)


async def open_session(link: Link, *, patience_s: float | None = None) -> zenoh.Session:
    """Return an open session, tried for `patience_s`, or for ever (said once).

    Raises:
        ConfigError: as `configuration`.
        ListenError: the address to listen on is taken.
        ConnectError: nobody answered within `patience_s`, or the router refuses the credentials.
    """
    where = ", ".join(link.connect or link.listen)
    refusal, has_waited = "", False

    async def problem_of(error: zenoh.ZError) -> BusError:
        nonlocal refusal
        if not link.connect:
            taken = "another PointIt may be running there: join it with --connect, or "
            hint = taken if transport.is_in_use(error) else ""
            reason = transport.short_reason(error)
            return ListenError(
                f"cannot listen on {where}: {reason}; {hint}choose another address with --listen"
            )
        refusal = await in_daemon_thread(lambda: refusals(link), "refusal")
        if refusal and patience_s is not None:
            raise ConnectError(refusal) from error
        return ConnectError(f"nobody answers at {where}; is `pointit run` or `pointit router` running there?")

    def on_wait() -> None:
        nonlocal has_waited
        if patience_s is not None and patience_s <= SOON_S:
            return  # the error at the end is enough
        has_waited = True
        if refusal:
            log.warning("%s; trying again until it does not", refusal)
        else:
            log.warning("nobody answers at %s yet; trying again until somebody does", where)

    # Each address first in turn: when it opens a session, Zenoh tries no other.
    turns = [
        dataclasses.replace(link, connect=(*link.connect[first:], *link.connect[:first]))
        for first in range(max(1, len(link.connect)))
    ]
    session = await transport.open_session(
        [configuration(turn) for turn in turns],
        (*link.listen, *link.connect),
        problem_of,
        patience_s=patience_s,
        on_wait=on_wait,
    )
    if has_waited:
        log.info("connected to %s", where)
    return session


def refusals(link: Link) -> str:
    """Return the first refusal of our credentials by `link`, or `""` unless all its routers refuse them.

    Blocks for up to 3 s each.
    """
    if link.credentials is None:
        return ""
    reasons = [connection_refusal(link.credentials, endpoint) for endpoint in link.connect]
    return reasons[0] if reasons and all(reasons) else ""
