# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)
"""Opening and watching the one Zenoh session of a process."""

import asyncio
import contextlib
import dataclasses
import json
import logging
import os
import re
from collections.abc import Sequence
from typing import Any

import zenoh

from pointit.runtime.errors import ConfigError, ConnectError, ListenError
from pointit.runtime.host.tcp_timeouts import set_user_timeout
from pointit.runtime.host.threads import in_daemon_thread
from pointit.runtime.link.credentials import connection_refusal
from pointit.runtime.link.link import LEASE_MS, Link, check_addresses, ports_of
from pointit.schemas.topics import check_name

log = logging.getLogger(__name__)

SYSTEM_REASON = re.compile(r"([^:\[\]\s][^:\[\]]*) \(os error \d+\)")
IN_USE = re.compile(r"\(os error (48|98|10048)\)")
"""Numbers by which macOS, Linux and Windows report that an address is in use."""

OPEN_RETRY_S = 0.5
CONNECT_TIMEOUT_MS = 1000
"""Duration limit of an attempt to open. Later attempts to reach a lost router take up to 10 s: with less, the
attempts that clients have given up would keep a router that stood still busy for good, which turns away ten a
second (github.com/eclipse-zenoh/zenoh/issues/2685)."""
CLOSE_PATIENCE_S = 1.0
"""Time to wait for the closing of a session. It takes some ms, but with a lost router as long as the current
attempt to reach it."""

RUNTIME = "(rx: (worker_threads: 1))"
"""One thread receives, not two: each message would wake both, and both need Python's lock."""


def configuration(link: Link) -> zenoh.Config:
    """Return Zenoh's configuration for `link`.

    Who connects is a client: peers do not relay for peers, and gossip would pass by access rules.

    Raises:
        ConfigError: an endpoint is not one.
        KeyNameError: the site's name cannot stand in a key.
    """
    check_name(link.site, "site")
    check_addresses(link)
    config = zenoh.Config()
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
    for key, value in settings.items():
        try:
            config.insert_json5(key, json.dumps(value))
        except zenoh.ZError as error:
            shown = "…" if key.startswith("transport/auth") else json.dumps(value)
            raise ConfigError(f"Zenoh does not take {key} = {shown}: {_short(error)}") from error
    return config


async def open_session(link: Link, *, patience_s: float | None = None) -> zenoh.Session:
    """Return an open session.

    `zenoh.open` ignores signals while it blocks, so it runs in a thread of its own with a short time-out,
    and is tried again: for `patience_s`, or for ever (said once).

    Raises:
        ListenError: the address to listen on is taken.
        ConnectError: nobody answered within `patience_s`, or the router refuses the credentials.
    """
    loop = asyncio.get_running_loop()
    began = loop.time()
    told = False
    turns = [configuration(turn) for turn in _turns(link)]
    while True:
        try:
            session = await _open_by_turns(turns)
        except zenoh.ZError as error:
            if not link.connect:
                where = ", ".join(link.listen)
                taken = "another PointIt may be running there: join it with --connect, or "
                hint = taken if IN_USE.search(str(error)) else ""
                raise ListenError(
                    f"cannot listen on {where}: {_short(error)}; {hint}choose another address with --listen"
                ) from error
            where = ", ".join(link.connect)
            why = await in_daemon_thread(lambda: refusals(link), "refusal")
            if patience_s is not None and why:
                raise ConnectError(why) from error
            if patience_s is not None and loop.time() - began >= patience_s:
                raise ConnectError(
                    f"nobody answers at {where}; is `pointit run` or `pointit router` running there?"
                ) from error
            if not told:
                told = True
                if why:
                    log.warning("%s; trying again until it does not", why)
                else:
                    log.warning("nobody answers at %s yet; trying again until somebody does", where)
            await asyncio.sleep(OPEN_RETRY_S)
        else:
            if told:
                log.info("connected to %s", ", ".join(link.connect))
            set_user_timeout(ports_of((*link.listen, *link.connect)), LEASE_MS)
            return session


def _turns(link: Link) -> list[Link]:
    """Return `link` with each of its addresses first: when it opens a session, Zenoh tries no other."""
    return [
        dataclasses.replace(link, connect=(*link.connect[first:], *link.connect[:first]))
        for first in range(max(1, len(link.connect)))
    ]


async def _open_by_turns(turns: Sequence[zenoh.Config]) -> zenoh.Session:
    """Return the session that the first of `turns` opens that can.

    Raises:
        ZError: none can; says why the last one cannot.
    """
    *others, last = turns
    for turn in others:
        with contextlib.suppress(zenoh.ZError):
            return await open_cancellable(turn)
    return await open_cancellable(last)


def refusals(link: Link) -> str:
    """Return the first refusal of our credentials by `link`, or `""` unless all its routers refuse them.

    Blocks for up to 3 s each.
    """
    if link.credentials is None:
        return ""
    reasons = [connection_refusal(link.credentials, endpoint) for endpoint in link.connect]
    return reasons[0] if reasons and all(reasons) else ""


async def close_session(session: zenoh.Session, *, patience_s: float = CLOSE_PATIENCE_S) -> None:
    """Close `session`, in a thread, since that waits for callbacks that run; go on after `patience_s`."""
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(in_daemon_thread(session.close, "zenoh-close"), patience_s)


def _short(error: Exception) -> str:
    """Return the innermost reason of a Zenoh error."""
    system = SYSTEM_REASON.search(str(error))
    return system[1] if system else str(error).split(" at ")[0].rstrip(".")


async def open_cancellable(config: zenoh.Config) -> zenoh.Session:
    """Return an open session; may be cancelled at any time: one that opens all the same is closed again.

    `ZENOH_RUNTIME` in the environment goes before our choice of threads; Zenoh reads it when it first opens
    a session in a process.

    Raises:
        zenoh.ZError: it cannot be opened.
    """
    os.environ.setdefault("ZENOH_RUNTIME", RUNTIME)
    return await in_daemon_thread(
        lambda: zenoh.open(config), "zenoh-open", discard=lambda session: session.close()
    )
