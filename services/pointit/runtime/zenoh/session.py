# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave types out)
"""Sessions of Zenoh, of any configuration or of a process of a site; opening holds up no loop."""

import asyncio
import contextlib
import dataclasses
import json
import logging
import os
import re
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Any

import zenoh

from pointit.runtime.errors import BusError, ConfigError, ConnectError, ListenError
from pointit.runtime.host.tcp_timeouts import set_user_timeout
from pointit.runtime.host.threads import in_daemon_thread
from pointit.runtime.link.credentials import PassingRefusal, connection_refusal
from pointit.runtime.link.link import LEASE_MS, Link, check_addresses, ports_of
from pointit.schemas.topics import check_name

log = logging.getLogger(__name__)

CONNECT_TIMEOUT_MS = 1000
"""Duration limit of an attempt to open. Later attempts to reach a lost router take up to 10 s: with less, the
attempts that clients have given up would keep a router that stood still busy for good, which turns away ten a
second (github.com/eclipse-zenoh/zenoh/issues/2685)."""
SOON_S = 5.0
"""Shorter attempts to open are not logged."""
SYSTEM_REASON = re.compile(r"([^:\[\]\s][^:\[\]]*) \(os error \d+\)")
IN_USE = re.compile(r"\(os error (48|98|10048)\)")
"""Numbers by which macOS, Linux and Windows report that an address is in use."""
OPEN_RETRY_S = 0.5
PASSES_S = 10.0
"""Time after which a `PassingRefusal` counts as one that does not pass."""
CLOSE_TIMEOUT_S = 1.0
"""Time to wait for the closing of a session. It takes some ms, but with a lost router as long as the current
attempt to reach it."""
RUNTIME = "(rx: (worker_threads: 1))"
"""One thread receives, not two: each message would wake both, and both need Python's lock."""


def config_of(settings: Mapping[str, Any]) -> zenoh.Config:
    """Return Zenoh's configuration with `settings`, by their paths in it.

    Raises:
        ConfigError: Zenoh does not take one. Secrets are not quoted.
    """
    config = zenoh.Config()
    for key, value in settings.items():
        try:
            config.insert_json5(key, json.dumps(value))
        except zenoh.ZError as error:
            shown = "…" if key.startswith("transport/auth") else json.dumps(value)
            raise ConfigError(f"Zenoh does not take {key} = {shown}: {short_reason(error)}") from error
    return config


async def open_first(
    configs: Sequence[zenoh.Config],
    endpoints: Sequence[str],
    problem_of: Callable[[zenoh.ZError], Awaitable[BusError]],
    *,
    patience_s: float | None,
    on_wait: Callable[[], None],
) -> zenoh.Session:
    """Return the session that the first of `configs` opens that can; may be cancelled at any time.

    `zenoh.open` ignores signals while it blocks, so it should have a short time-out, and is tried again.

    It connects to `endpoints`, or listens there. `problem_of` returns the error to raise if no more attempts
    are made, or raises it to make none. `on_wait` is called once, before the second round of attempts.

    Raises:
        BusError: that of `problem_of`; a `ListenError` after the first round.
    """
    loop = asyncio.get_running_loop()
    began_s, has_warned = loop.time(), False
    while True:
        try:
            session = await _open_by_turns(configs)
        except zenoh.ZError as error:
            problem = await problem_of(error)
            is_over = patience_s is not None and loop.time() - began_s >= patience_s
            if is_over or isinstance(problem, ListenError):
                raise problem from error
            if not has_warned:
                has_warned = True
                on_wait()
            await asyncio.sleep(OPEN_RETRY_S)
        else:
            set_user_timeout(ports_of(endpoints), LEASE_MS)
            return session


async def _open_by_turns(configs: Sequence[zenoh.Config]) -> zenoh.Session:
    *others, last = configs
    for config in others:
        with contextlib.suppress(zenoh.ZError):
            return await open_cancellable(config)
    return await open_cancellable(last)


async def open_cancellable(config: zenoh.Config, *, runtime: str = RUNTIME) -> zenoh.Session:
    """Return an open session; may be cancelled at any time: one that opens all the same is closed again.

    `runtime`: Zenoh's threads, empty for as many as it likes. The first session of a process decides, and
    `ZENOH_RUNTIME` in the environment goes before it.

    Raises:
        zenoh.ZError: it cannot be opened.
    """
    if runtime:
        os.environ.setdefault("ZENOH_RUNTIME", runtime)
    return await in_daemon_thread(
        lambda: zenoh.open(config), "zenoh-open", discard=lambda session: session.close()
    )


async def close_session(session: zenoh.Session, *, patience_s: float = CLOSE_TIMEOUT_S) -> None:
    """Close `session`, in a thread, since that waits for callbacks that run; go on after `patience_s`."""
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(patience_s):
            await in_daemon_thread(session.close, "zenoh-close")


def short_reason(error: Exception) -> str:
    """Return the innermost reason of a Zenoh error."""
    system = SYSTEM_REASON.search(str(error))
    return system[1] if system else str(error).split(" at ")[0].rstrip(".")


def is_in_use(error: Exception) -> bool:
    """Return True if the error of Zenoh is that an address to listen on is in use."""
    return IN_USE.search(str(error)) is not None


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
    return config_of(settings)


async def open_session(link: Link, *, patience_s: float | None = None) -> zenoh.Session:
    """Return an open session, tried for `patience_s`, or for ever (said once).

    Raises:
        ConfigError: as `configuration`.
        ListenError: the address to listen on is taken.
        ConnectError: nobody answered within `patience_s`, or the router refuses the credentials.
    """
    where = ", ".join(link.connect or link.listen)
    refusal, has_waited = "", False
    loop = asyncio.get_running_loop()
    welcome_s = loop.time()
    """Time of the last attempt that was not refused."""

    async def problem_of(error: zenoh.ZError) -> BusError:
        nonlocal refusal, welcome_s
        if not link.connect:
            taken = "another PointIt may be running there: join it with --connect, or "
            hint = taken if is_in_use(error) else ""
            reason = short_reason(error)
            return ListenError(
                f"cannot listen on {where}: {reason}; {hint}choose another address with --listen"
            )
        refusal = await in_daemon_thread(lambda: refusals(link), "refusal")
        if not refusal:
            welcome_s = loop.time()
        passes = isinstance(refusal, PassingRefusal) and loop.time() - welcome_s < PASSES_S
        if refusal and not passes and patience_s is not None:
            raise ConnectError(refusal) from error
        return ConnectError(
            refusal or f"nobody answers at {where}; is `pointit run` or `pointit router` running there?"
        )

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
    session = await open_first(
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
