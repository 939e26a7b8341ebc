"""A Zenoh router in this process, which joins several machines where no zenohd is installed.

Zenoh reads access rules, passwords and certificates only when a session opens, so a router whose files have
changed is reopened. Its clients are back after 0.1 s, and repeat their declarations automatically.
"""

import asyncio
import contextlib
import json
import logging
import re
import sys
import threading
from collections import Counter
from collections.abc import AsyncGenerator, Callable, Iterable, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import zenoh
from zenoh.handlers import Callback

from pointit.runtime.errors import ConfigError, ListenError
from pointit.runtime.link.link import LEASE_MS, Link, ports_of
from pointit.runtime.router_health import RouterHealthPublisher
from pointit.runtime.router_sockets import Peer, cut, hold, peer, release_udp_ports
from pointit.runtime.socket_counters import SocketCounters, has_counters, socket_counters
from pointit.runtime.zenoh.session import (
    CLOSE_TIMEOUT_S,
    close_session,
    open_cancellable,
    open_session,
    set_tcp_timeouts,
)
from pointit.schemas.problems import Problem
from pointit.schemas.table_types import NAME

log = logging.getLogger(__name__)

Stamp = tuple[tuple[int, int, int], ...]

LOOK_S = 0.25
"""Period of polling the files, since not every system and file system reports changes."""
PORT_TIMEOUT_S = 60.0
"""Time for which its own port may stay in use after it was closed (QUIC: 30 s where it cannot be released).
A router that gave up sooner would end for everybody."""
PORT_RETRY_S = 0.05
REOPEN_TIMEOUT_S = 11.0
"""Time to wait for a session's end before the next one begins. Zenoh takes 10 s at most."""
RELATIVE = re.compile(r"(?<=_file=)(?![/\\]|[A-Za-z]:)")
"""Addresses that name a file by a path relative to the configuration's folder."""
PEER = re.compile(r"tls/\[?([^]#?]+?)]?:(\d+)(?:[#?]|$)")
"""Address and port of a peer that is connected by TLS."""


@asynccontextmanager
async def running_router(listen: tuple[str, ...]) -> AsyncGenerator[None]:
    """Route for every site at the addresses `listen` while inside.

    Raises:
        ListenError: an address is taken or not ours.
    """
    session = await open_session(Link(listen=listen, router=True))
    try:
        yield
    finally:
        await close_session(session)


def parse_config(text: str, folder: Path) -> zenoh.Config:
    """Return Zenoh's configuration from JSON5 whose files are named as seen from `folder`.

    Raises:
        ConfigError: it is none; the message has the reason, never its content.
    """
    try:
        config = zenoh.Config.from_json5(text)
        for key in ("listen/endpoints", "connect/endpoints"):
            prefix = f"{folder.absolute()}/"
            absolute = [RELATIVE.sub(prefix, endpoint) for endpoint in _endpoints(config, key)]
            config.insert_json5(key, json.dumps(absolute))
        key = "transport/auth/usrpwd/dictionary_file"
        users: Any = json.loads(config.get_json(key))
        if isinstance(users, str):
            users_file = str(folder.absolute() / users)
            config.insert_json5(key, json.dumps(users_file))
    except (zenoh.ZError, ValueError) as error:
        raise ConfigError(
            f"the router's configuration is none that Zenoh takes: {_config_mistake(error)}"
        ) from None
    return config


class Router:
    """Routes by a configuration that is made from files, and follows their changes."""

    def __init__(self, make: Callable[[], str], folder: Path, files: Sequence[Path]) -> None:
        """Prepare. Nothing is opened yet.

        `make` returns the configuration as it should be now, JSON5, or raises `ConfigError`. It names
        files as seen from `folder`. A change of `files` reopens the router.
        """
        self._make = make
        self._folder = folder
        self._files = tuple(files)
        self._stamp: Stamp = ()
        self._listens: tuple[str, ...] = ()
        self._sites: tuple[str, ...] = ()
        self._joins_another = False
        self._session: zenoh.Session | None = None
        self._link_listener: zenoh.LinkEventsListener[None] | None = None
        self.is_held: Callable[[str], bool] = lambda _: False
        """Returns True for a common name whose new connections are held. Called on Zenoh's threads."""
        self._new_connections = Counter[str]()
        """Number of connections by common name since `pop_new_connections`."""
        self._lock = threading.Lock()
        self.times_opened = 0
        """Number of times that it has opened. All clients connect again then."""
        self.has_counters = has_counters()
        """True if the system counts what each connection sends."""
        self.roles: dict[str, str] = {}
        """By identity, `SITE/NAME`; as `pointit site` has written them."""
        self.former: frozenset[str] = frozenset()
        """Common names of revoked and replaced certificates."""
        self._health_publishers: dict[str, RouterHealthPublisher] = {}
        """By site."""

    @property
    def listens(self) -> tuple[str, ...]:
        """Return the addresses it listens on."""
        return self._listens

    async def open(self) -> None:
        """Route.

        Raises:
            ConfigError: the configuration cannot be used.
            ListenError: an address is taken or not ours.
        """
        self._stamp = self._file_stamps()
        config = await asyncio.to_thread(self._read)
        self._begin(await _open(config))

    def report(
        self, of_site: Callable[[str], Sequence[Problem]], refused: int, sessions: Mapping[str, int]
    ) -> None:
        """Publish warnings, refused attempts and connections to each site, once a second."""
        for site, account in self._health_publishers.items():
            account.report(of_site(site), refused, sessions.get(site, 0))

    def links(self) -> list[tuple[str, str, str]]:
        """Return session, common name (empty where none is known) and address of all who are connected."""
        if self._session is None:
            return []
        links = self._session.info.links()
        connections: list[tuple[str, str, str]] = []
        for link in links:
            connections.append((str(link.zid), link.auth_identifier or "", link.dst))
        return connections

    def counters(self) -> dict[str, SocketCounters]:
        """Return the system's counters of connections by TLS, by the addresses that `links` returns.

        There are none where the system does not count.
        """
        by_peer = socket_counters(ports_of(self._listens))
        counters: dict[str, SocketCounters] = {}
        for _, _, address in self.links():
            for found in _peers([address]):
                if found in by_peer:
                    counters[address] = by_peer[found]
        return counters

    def pop_new_connections(self) -> Counter[str]:
        """Return and reset the number of new connections by common name, empty where none is known."""
        with self._lock:
            new_connections = self._new_connections
            self._new_connections = Counter()
        return new_connections

    def cut(self, addresses: Iterable[str]) -> None:
        """End the connections from `addresses`, as `links` returns them; those by QUIC stay."""
        peers = _peers(addresses)
        if peers:
            cut(peers)

    def hold(self, addresses: Iterable[str]) -> None:
        """Discard what comes by the connections from `addresses` until they end, a lease later."""
        peers = _peers(addresses)
        if peers:
            hold(peers)

    async def reload_on_change(self) -> None:
        """Route until cancelled, and reopen after a change of a file. Unusable changes are ignored."""
        previous = self._stamp
        while True:
            await asyncio.sleep(LOOK_S)
            set_tcp_timeouts(ports_of(self._listens), LEASE_MS)  # each that was accepted lingers before this
            stamp = self._file_stamps()
            is_written = stamp != previous
            previous = stamp
            if is_written or stamp == self._stamp:  # a change replaces several files, and is one
                continue
            self._stamp = stamp
            try:
                config = await asyncio.to_thread(self._read)
            except ConfigError as error:
                log.warning("%s; the router goes on by what it has read before", error)
                continue
            await self._reopen(config)

    async def close(self, timeout_s: float = CLOSE_TIMEOUT_S) -> None:
        """Stop routing; wait for up to this time until nothing of the session is left."""
        session = self._session
        self._session = None
        if self._link_listener is not None:
            self._link_listener.undeclare()
            self._link_listener = None
        self._health_publishers.clear()
        if session is not None:
            await close_session(session, patience_s=timeout_s)

    async def _reopen(self, config: zenoh.Config) -> None:
        await self.close(REOPEN_TIMEOUT_S)
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        while True:
            try:
                session = await _open(config)
            except ListenError:
                if loop.time() - began_s > PORT_TIMEOUT_S:
                    raise
                release_udp_ports(ports_of(self._listens))
                await asyncio.sleep(PORT_RETRY_S)
            else:
                self._begin(session)
                log.info("the router goes by the rules and certificates that there are now")
                return

    def _begin(self, session: zenoh.Session) -> None:
        self._session = session
        self.times_opened += 1
        on_link = Callback(self._on_link, indirect=False)
        self._link_listener = session.info.declare_link_events_listener(on_link, history=True)
        publishers: dict[str, RouterHealthPublisher] = {}
        for site in self._sites:
            publishers[site] = RouterHealthPublisher(session, site, joins_another=self._joins_another)
        self._health_publishers = publishers

    def _on_link(self, event: zenoh.LinkEvent) -> None:
        """Count a new connection, and hold that of a held identity.

        Zenoh reads none of its messages before this returns.
        """
        if event.kind == zenoh.SampleKind.PUT:
            set_tcp_timeouts(ports_of(self._listens), LEASE_MS)
            common_name = event.link.auth_identifier or ""
            with self._lock:
                self._new_connections[common_name] += 1
            if self.is_held(common_name):
                self.hold([event.link.dst])

    def _read(self) -> zenoh.Config:
        config = parse_config(self._make(), self._folder)
        endpoints = _endpoints(config, "listen/endpoints")
        self._listens = tuple(re.split("[?#]", endpoint)[0] for endpoint in endpoints)
        self._joins_another = bool(_endpoints(config, "connect/endpoints"))

        # Sites, roles and former certificates are in the names that `pointit site` gives to its rules
        subjects = _access_control(config, "subjects")
        self._sites = _site_names(subjects)
        self.roles = _roles(_access_control(config, "policies"))
        self.former = _former_names(subjects)
        return config

    def _file_stamps(self) -> Stamp:
        stamps: list[tuple[int, int, int]] = []
        for file in self._files:
            with contextlib.suppress(OSError):
                status = file.stat()
                stamps.append((status.st_mtime_ns, status.st_size, status.st_ino))
        return tuple(stamps)


def _peers(addresses: Iterable[str]) -> set[Peer]:
    """Return the peers of connections by TLS."""
    matches = [PEER.match(address) for address in addresses]
    peers = set[Peer]()
    for match in matches:
        if match is not None:
            peers.add(peer(match[1], int(match[2])))
    return peers


def _endpoints(config: zenoh.Config, key: str) -> list[str]:
    text = config.get_json(key)
    endpoints: list[str] | dict[str, list[str]] = json.loads(text)
    if isinstance(endpoints, dict):
        return endpoints.get("router", [])
    return endpoints


def _access_control(config: zenoh.Config, section: str) -> list[dict[str, Any]]:
    """Return the entries of a section of the access rules."""
    entries: list[dict[str, Any]] | None = json.loads(config.get_json(f"access_control/{section}"))
    return entries or []


def _site_names(subjects: Iterable[Mapping[str, Any]]) -> tuple[str, ...]:
    """Return the sites of `subjects`, each once."""
    names: dict[str, None] = {}
    for subject in subjects:
        site, slash, _ = str(subject["id"]).partition("/")
        if slash and NAME.match(site):
            names[site] = None
    return tuple(names)


def _roles(policies: Iterable[Mapping[str, Any]]) -> dict[str, str]:
    """Return the role of each identity that has one."""
    roles: dict[str, str] = {}
    for policy in policies:
        identity, _, role = str(policy.get("id") or "").rpartition("/")
        if identity:
            roles[identity] = role
    return roles


def _former_names(subjects: Iterable[Mapping[str, Any]]) -> frozenset[str]:
    """Return the common names, or users, of revoked and replaced credentials."""
    names = set[str]()
    for subject in subjects:
        if str(subject["id"]).endswith("/former ones"):
            names.update(subject.get("cert_common_names") or subject.get("usernames") or ())
    return frozenset(names)


async def _open(config: zenoh.Config) -> zenoh.Session:
    """Return a session; when this is cancelled, one that opens all the same is closed again."""
    try:
        session = await open_cancellable(config, runtime="")
    except zenoh.ZError as error:
        reason = str(error).partition(" at /")[0].rstrip(".")  # without the place in Zenoh's source
        raise ListenError(f"the router cannot be opened: {reason}") from error
    set_tcp_timeouts(ports_of(_endpoints(config, "listen/endpoints")), LEASE_MS)
    return session


def _config_mistake(error: Exception) -> str:
    """Return where a configuration is wrong, and no value of it: it may be a password."""
    text = str(error)
    if place := re.search(r"--> (\d+):(\d+)", text):
        return f"line {place[1]}, column {place[2]} is no JSON5"
    if field := re.search(r"unknown field `([\w/]+)`", text):
        return f"there is no {field[1]}"
    return "a value is not of the kind that stands there"


def raise_file_limit() -> None:
    """Raise the limit of open files to the system's maximum.

    The default is usually 1024. If the system has no such limit or refuses to raise it, nothing changes.
    """
    if sys.platform == "win32":
        return
    import resource  # noqa: PLC0415 - there is none on Windows

    _, hard_limit = resource.getrlimit(resource.RLIMIT_NOFILE)
    with contextlib.suppress(OSError, ValueError):  # macOS: "no limit" is more than it takes
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard_limit, hard_limit))
