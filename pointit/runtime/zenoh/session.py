"""Sessions of Zenoh: configuration, attempts to open them, time-outs of their TCP connections, closing.

Zenoh closes a link after a lease without messages, but first waits for a pending write (1.10). To a
disconnected peer, that write ends only when TCP gives up, after 15 minutes. Until then an unreachable user
would seem present, and their own machine would not report the lost router. Zenoh has no setting for this
timeout. On Linux, sockets have one, and accepted sockets inherit it from the listening socket.

When Zenoh closes a connection, it also waits until the peer has acknowledged all data (`SO_LINGER`), 40 ms to
10 s, in the thread that receives for the whole process. A hundred rejected peers would block all others for
seconds. Without lingering, the system completes the closing in the background.
"""

import asyncio
import contextlib
import dataclasses
import json
import logging
import os
import re
import socket
import struct
import sys
from collections.abc import Awaitable, Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import zenoh

from pointit.runtime.errors import BusError, ConfigError, ConnectError, ListenError, RejectedError
from pointit.runtime.host.advised_commands import advised_commands
from pointit.runtime.host.extras import is_there, load_object
from pointit.runtime.host.threads import in_daemon_thread
from pointit.runtime.link.link import LEASE_MS, Credentials, Link, PassingRefusal, check_addresses, ports_of
from pointit.schemas.topics import check_name

log = logging.getLogger(__name__)

OPEN_FILES = Path("/proc/self/fd")
LINGER = struct.Struct("ii")
"""Value of `SO_LINGER`: 1 if a closed connection lingers, and for how many seconds."""
CONNECT_TIMEOUT_MS = 1000
"""Duration limit of an attempt to open. Later attempts to reach a lost router take up to 10 s. A router
rejects only ten attempts a second: with a shorter limit, abandoned attempts would keep a router busy for ever
after a pause (github.com/eclipse-zenoh/zenoh/issues/2685)."""
SOON_S = 5.0
"""Shorter attempts to open are not logged."""
SYSTEM_REASON = re.compile(r"([^:\[\]\s][^:\[\]]*) \(os error \d+\)")
IN_USE = re.compile(r"\(os error (48|98|10048)\)")
"""Numbers by which macOS, Linux and Windows report that an address is in use."""
OPEN_RETRY_S = 0.5
REFUSAL = "pointit.runtime.link.refusal:connection_refusal"
"""Function that returns the reason why a router refuses credentials."""
PASSES_S = 10.0
"""Time after which a repeated `PassingRefusal` counts as permanent, s."""
CLOSE_TIMEOUT_S = 1.0
"""Timeout for closing a session, s. Closing takes some ms, but if the router is lost, it lasts as long as the
current attempt to reach it."""
RUNTIME = "(rx: (worker_threads: 1))"
"""One thread receives, not two: each message would wake both, and both need Python's lock."""


def set_tcp_timeouts(ports: Collection[int], after_ms: int) -> int:
    """Set how long connections from or to `ports` wait for a peer that does not answer.

    They end after `after_ms` without an acknowledgement. Closing one takes no time; what was written is sent
    all the same. This applies to the present sockets of this process. A connection that is accepted later
    has the first time-out, but lingers when it is closed, until this is called again. Any thread may call it.

    Returns:
        Number of sockets set, 0 where the system has no such timeout.
    """
    if sys.platform != "linux":
        return 0
    count = 0
    for connection in own_sockets():
        with contextlib.suppress(OSError):  # closed meanwhile
            if not ports_of_socket(connection).isdisjoint(ports):
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, after_ms)
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER.pack(0, 0))
                count += 1
    return count


def own_sockets(kind: socket.SocketKind = socket.SOCK_STREAM) -> Iterator[socket.socket]:
    """Yield this process's sockets of a `kind`, Zenoh's too, each only for the current iteration.

    Yields none where they cannot be listed: no /proc, or no descriptor left to read it by.

    No descriptor is duplicated and closed again: closing any descriptor of a file gives up all locks that the
    process has on it (POSIX), such as those by which SQLite excludes other writers. `dup` would also set the
    socket itself to wait, and with it the thread by which Zenoh receives.
    """
    try:
        entries = list(OPEN_FILES.iterdir())
    except OSError:
        return
    for entry in entries:
        try:
            own_socket = socket.socket(fileno=int(entry.name))
        except OSError:  # not a socket, or closed meanwhile
            continue
        try:
            is_internet = own_socket.family in (socket.AF_INET, socket.AF_INET6)
            if is_internet and own_socket.type == kind:
                yield own_socket
        finally:
            own_socket.detach()  # its owner closes it


def ports_of_socket(own_socket: socket.socket) -> set[int]:
    """Return the own port of a socket, and that of its peer if it is connected."""
    ports = {own_socket.getsockname()[1]}
    with contextlib.suppress(OSError):  # it listens
        ports.add(own_socket.getpeername()[1])
    return ports


def config_of(settings: Mapping[str, Any]) -> zenoh.Config:
    """Return Zenoh's configuration with `settings`, values by their paths in it.

    Raises:
        ConfigError: If Zenoh rejects a setting. The message quotes no secrets.
    """
    config = zenoh.Config()
    for key, value in settings.items():
        try:
            config.insert_json5(key, json.dumps(value))
        except zenoh.ZError as error:
            shown = "…" if key.startswith("transport/auth") else json.dumps(value)
            reason = short_reason(error)
            raise ConfigError(f"Zenoh does not take {key} = {shown}: {reason}") from error
    return config


async def open_first(
    configs: Sequence[zenoh.Config],
    endpoints: Sequence[str],
    problem_of: Callable[[zenoh.ZError], Awaitable[BusError]],
    *,
    patience_s: float | None,
    on_wait: Callable[[], None],
) -> zenoh.Session:
    """Return a session of the first of `configs` with which one opens. May be cancelled at any time.

    `zenoh.open` ignores signals while it blocks, so it should have a short timeout and is repeated.

    `endpoints` are the addresses to which it connects, or at which it listens. `problem_of` returns the error
    to raise when attempts end, or raises it to end them at once. `on_wait` is called once, before the second
    round of attempts.

    Raises:
        BusError: that of `problem_of`; a `ListenError` after the first round.
    """
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    has_warned = False
    # Each turn of the loop tries all addresses once. The caller decides by the problem whether to go on.
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
            # Zenoh's sockets would notice a peer that vanished only after minutes
            set_tcp_timeouts(ports_of(endpoints), LEASE_MS)
            return session


async def _open_by_turns(configs: Sequence[zenoh.Config]) -> zenoh.Session:
    *others, last = configs
    for config in others:
        with contextlib.suppress(zenoh.ZError):
            return await open_cancellable(config)
    return await open_cancellable(last)


async def open_cancellable(config: zenoh.Config, *, runtime: str = RUNTIME) -> zenoh.Session:
    """Return an open session. May be cancelled at any time: a session that still opens is closed again.

    `runtime`: settings of Zenoh's threads, `""` for Zenoh's defaults. Only the first session of a process
    sets them, and `ZENOH_RUNTIME` in the environment has precedence.

    Raises:
        zenoh.ZError: If it cannot be opened.
    """
    if runtime:
        os.environ.setdefault("ZENOH_RUNTIME", runtime)
    return await in_daemon_thread(lambda: zenoh.open(config), "zenoh-open", discard=_close)


def _close(session: zenoh.Session) -> None:
    session.close()


async def close_session(session: zenoh.Session, *, patience_s: float = CLOSE_TIMEOUT_S) -> None:
    """Close `session` in a thread, since closing waits for callbacks. Waits `patience_s` at most."""
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(patience_s):
            await in_daemon_thread(session.close, "zenoh-close")


def short_reason(error: Exception) -> str:
    """Return the innermost reason of a Zenoh error."""
    system = SYSTEM_REASON.search(str(error))
    if system:
        return system[1]
    return str(error).split(" at ")[0].rstrip(".")


def is_in_use(error: Exception) -> bool:
    """Return True if the error of Zenoh is that an address to listen on is in use."""
    return IN_USE.search(str(error)) is not None


def configuration(link: Link) -> zenoh.Config:
    """Return Zenoh's configuration for `link`.

    Processes that connect are clients: peers do not relay for peers, and gossip would bypass access rules.

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
    # Nothing is discovered: only the given addresses are used
    retry = {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5}
    settings: dict[str, Any] = {
        "mode": mode,
        "listen/endpoints": list(link.listen),
        "connect/endpoints": list(link.connect),
        "connect/retry": retry,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "timestamping/enabled": True,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": LEASE_MS,
    }
    # `zenoh.open` ignores signals while it blocks: the attempts of a client are short, and are repeated
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
    """Return an open session. Attempts end after `patience_s`, or never if it is None, which is logged once.

    Raises:
        ConfigError: as `configuration`.
        ListenError: If the address to listen on is in use.
        ConnectError: If no router answered within `patience_s`.
        RejectedError: If it refuses the credentials, or requires some.
    """
    addresses = ", ".join(link.connect or link.listen)
    refusal: str = ""
    has_waited = False
    loop = asyncio.get_running_loop()
    welcome_s = loop.time()
    """Time of the last attempt that was not refused."""

    async def problem_of(error: zenoh.ZError) -> BusError:
        nonlocal refusal, welcome_s
        if not link.connect:
            advice = "another PointIt may be running there: join it with --connect, or "
            hint = advice if is_in_use(error) else ""
            reason = short_reason(error)
            return ListenError(
                f"cannot listen on {addresses}: {reason}; {hint}choose another address with --listen"
            )
        refusal = await in_daemon_thread(lambda: refusals(link), "refusal")
        if not refusal:
            welcome_s = loop.time()
            return ConnectError(f"nobody answers at {addresses}; {_start_question()}")
        passes = isinstance(refusal, PassingRefusal) and loop.time() - welcome_s < PASSES_S
        if patience_s is not None and not passes:
            raise RejectedError(refusal) from error
        return RejectedError(refusal)

    def on_wait() -> None:
        nonlocal has_waited
        if patience_s is not None and patience_s <= SOON_S:
            return  # the final error says it
        has_waited = True
        if refusal:
            log.warning("%s; trying again until it does not", refusal)
        else:
            log.warning("nobody answers at %s yet; trying again until somebody does", addresses)

    session = await open_first(
        _configurations_by_turns(link),
        (*link.listen, *link.connect),
        problem_of,
        patience_s=patience_s,
        on_wait=on_wait,
    )
    if has_waited:
        log.info("connected to %s", addresses)
    return session


def _configurations_by_turns(link: Link) -> list[zenoh.Config]:
    """Return configurations with each address first in turn: once one has opened, Zenoh tries no other."""
    configs: list[zenoh.Config] = []
    for first in range(max(1, len(link.connect))):
        endpoints = (*link.connect[first:], *link.connect[:first])
        configs.append(configuration(dataclasses.replace(link, connect=endpoints)))
    return configs


def refusals(link: Link) -> str:
    """Return the first refusal of our credentials, or of none, if all routers of `link` refuse, else `""`.

    Blocks for up to 3 s per router.
    """
    module = REFUSAL.partition(":")[0]
    if link.credentials is None and not is_there(module):
        return ""
    refusal_at: Callable[[Credentials | None, str], str] = load_object(REFUSAL, "joining a secured site")
    reasons = [refusal_at(link.credentials, endpoint) for endpoint in link.connect]
    if not reasons or not all(reasons):
        return ""
    return reasons[0]


def _start_question() -> str:
    commands = advised_commands()
    if commands.containers:
        return f"is its router running? {commands.start_router()} starts it again"
    return "is `pointit run` or `pointit router` running there?"
