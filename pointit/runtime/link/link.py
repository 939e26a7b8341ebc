"""Connection of a process to the network: site, addresses, credentials, lease. Loads no Zenoh.

A folder of credentials, made by `pointit site`, holds `link.json` (site, addresses, name, role), the
authority's certificate `ca.pem`, and `cert.pem` with `key.pem`, or `password` on a site with passwords.
"""

import datetime as dt
import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from pointit.runtime.config.config import Config
from pointit.runtime.config.validation_message import describe_validation_error
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.advised_commands import AdvisedCommands, advised_commands
from pointit.runtime.host.state_file import read_limited, read_secret

VARIABLE = "POINTIT_CREDENTIALS"
CA = "ca.pem"
CERTIFICATE = "cert.pem"
KEY = "key.pem"
LINK = "link.json"
PASSWORD = "password"  # noqa: S105 - the name of the file
MAX_BYTES = 64 * 1024
OBSERVERS = ("dashboard", "operator")
"""Roles that may write nothing of their own, not even that they are there."""
SOON = dt.timedelta(days=30)
"""Credentials that end sooner are warned of."""
SECURE = re.compile(r"(?:tls|quic)/(?:\[(?P<ipv6>[^\]]+)\]|(?P<host>[^/:]+)):(?P<port>\d+)")
PASSWORD_FORM = re.compile(rb"[A-Za-z0-9_-]+")
"""Characters of a password."""

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""The address where `pointit run` listens and every other command connects, on this machine only."""
DEFAULT_SITE = "lab"

MAX_PORT = 65535
ENDPOINT = re.compile(
    r"(tcp|udp|tls|quic|ws)/(\[[\w:.%]+\]|[^/:\s]+):(?P<port>\d{1,5})([?#]\S*)?|(serial|unixsock-stream|unixpipe|vsock)/\S+"
)
"""Addresses that Zenoh accepts: host and port, or those of other protocols (`serial//dev/ttyUSB0`)."""
ROUTER_LOST = "router at {where} lost {ago_s:.0f} s ago; trying again"
"""Sentence in the health of every service of a process that has lost its router."""
LEASE_MS = 3000
"""A peer that is silent this long is taken for gone: a stopped process is noticed within 5 s."""

ROOM = "@may"
"""The part of a key that stands before the identity and the permission under test."""
VERBS = ("writes", "reads", "serves", "asks")
"""The permissions."""
JOIN = "joins"
"""Permission to join, granted below `ROOM` to every identity with any right."""

SILENT_S = 3.0
"""Time without a report at which a present service is stopped, or too busy to report, s."""
MANY = 4
"""Minimum number of services that are gone together. Of fewer, each is named with its own remedy."""


class LinkFile(Config):
    """Content of `link.json`, without secrets."""

    site: str
    name: str
    role: str
    generation: int
    endpoints: tuple[str, ...]
    password: bool = False
    valid_from: dt.datetime
    valid_until: dt.datetime


@dataclass(frozen=True, kw_only=True)
class Credentials:
    """An identity of a site, ready to join it."""

    folder: Path
    link: LinkFile

    @property
    def description(self) -> str:
        """Return the identity for people."""
        return f"this identity ({self.link.name})"

    @property
    def is_observer(self) -> bool:
        """Return True if processes with this identity are not announced to others."""
        return self.link.role in OBSERVERS

    def check_endpoint(self, endpoint: str) -> None:
        """Check that `endpoint` is encrypted.

        Raises:
            ConfigError: If it is neither TLS nor QUIC.
        """
        if not SECURE.match(endpoint):
            encrypted = " or ".join(self.link.endpoints)
            raise ConfigError(
                f"{endpoint}: credentials are for encrypted addresses only, as "
                f"{encrypted}; leave --connect out, or do without --credentials"
            )

    def expiry_warning(self, now: dt.datetime) -> str:
        """Return a warning if the credentials end within 30 days, else `""`."""
        if self.link.password or self.link.valid_until - now >= SOON:
            return ""
        name = self.link.name
        end = f"{self.link.valid_until:%Y-%m-%d}"
        renewal = advised_commands().renewal(name)
        return f"the credentials of {name} end on {end}; before that, renew them with {renewal}"

    def settings(self) -> dict[str, Any]:
        """Return the settings for Zenoh's configuration. They hold secrets: never show them."""
        tls = "transport/link/tls"
        authority = str(self.folder / CA)
        settings: dict[str, Any] = {
            "transport/link/protocols": ["tls", "quic"],
            f"{tls}/root_ca_certificate": authority,
            f"{tls}/close_link_on_expiration": True,
        }
        if self.link.password:
            settings["transport/auth/usrpwd/user"] = self.user
            settings["transport/auth/usrpwd/password"] = _password(self.folder)
        else:
            settings[f"{tls}/enable_mtls"] = True
            settings[f"{tls}/connect_certificate"] = str(self.folder / CERTIFICATE)
            settings[f"{tls}/connect_private_key"] = str(self.folder / KEY)
        return settings

    @property
    def user(self) -> str:
        """Return the name by which the router knows this identity."""
        link = self.link
        return f"{link.site}/{link.name}/{link.generation}"


def read_credentials(folder: Path, now: dt.datetime) -> Credentials:
    """Return the credentials in `folder`, looked over as far as that goes without a router.

    Raises:
        ConfigError: a file is missing or holds something else, others can read a secret, or they are not
            valid now.
    """
    folder = folder.absolute()
    file = folder / LINK
    try:
        link = LinkFile.model_validate_json(_read(file))
    except ValidationError as error:
        raise ConfigError(f"{file}: {describe_validation_error(error, LinkFile)}") from error

    # With a password, the identity has no certificate
    public = [CA, CERTIFICATE]
    secret = KEY
    if link.password:
        public = [CA]
        secret = PASSWORD
    for name in public:
        _read(folder / name)
    _read(folder / secret, read_secret)
    if link.password:
        _password(folder)
        return Credentials(folder=folder, link=link)

    # Checked here, with the remedy: a router's refusal arrives as a time-out
    certificate = folder / CERTIFICATE
    if now < link.valid_from:
        begin = f"{link.valid_from:%Y-%m-%d %H:%M} UTC"
        raise ConfigError(
            f"{certificate}: is not valid before {begin} and "
            f"here it is {now:%Y-%m-%d %H:%M} UTC; set this machine's clock"
        )
    if now > link.valid_until:
        end = f"{link.valid_until:%Y-%m-%d}"
        remedy = f"renew it with {advised_commands().renewal(link.name)}"
        raise ConfigError(f"{certificate}: has expired on {end}; {remedy}")
    return Credentials(folder=folder, link=link)


class PassingRefusal(str):
    """A refusal that may pass: a router that is busy, or opens again, looks the same for a moment."""

    __slots__ = ()


def _read(path: Path, read: Callable[[Path, int], bytes] = read_limited) -> bytes:
    try:
        return read(path, MAX_BYTES)
    except FileNotFoundError as error:
        raise ConfigError(
            f"{path}: is missing; credentials are a folder made by `pointit site`, with all its files"
        ) from error


def _password(folder: Path) -> str:
    """Return the password in `folder`. Errors do not quote it."""
    path = folder / PASSWORD
    password = _read(path).strip()
    if not PASSWORD_FORM.fullmatch(password):
        raise ConfigError(f"{path}: is not a password made by `pointit site`; copy the folder here again")
    return password.decode()


@dataclass(frozen=True, kw_only=True)
class Link:
    """Connection of a process: it listens and relays for its clients, or connects, or neither."""

    site: str = DEFAULT_SITE
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    router: bool = False
    """Route for everybody, without being a member of the site."""
    credentials: Credentials | None = None
    """Proof of identity for a router that requires it."""

    @property
    def addresses(self) -> tuple[str, ...]:
        """Return the addresses to listen on, or if there are none, to connect to."""
        return self.listen or self.connect


def check_addresses(link: Link) -> None:
    """Check the addresses of `link`, and that its credentials allow them.

    Raises:
        ConfigError: If one is no address, or does not fit the credentials.
    """
    for endpoint in (*link.listen, *link.connect):
        address = ENDPOINT.fullmatch(endpoint)
        if not address:
            raise ConfigError(f"{endpoint!r} is no address; write one like {DEFAULT_ENDPOINT}")
        port = address["port"]
        # a listener at port 0 lets the system choose one
        min_port = int(endpoint in link.connect)
        if port and not min_port <= int(port) <= MAX_PORT:
            raise ConfigError(f"{endpoint!r}: there is no port {port}; use one up to {MAX_PORT}")
    if link.credentials is not None:
        for endpoint in link.connect:
            link.credentials.check_endpoint(endpoint)


def ports_of(endpoints: Sequence[str]) -> set[int]:
    """Return the ports of addresses that have one."""
    ports = set[int]()
    for endpoint in endpoints:
        address = ENDPOINT.fullmatch(endpoint.partition("#")[0])
        if address and address["port"]:
            ports.add(int(address["port"]))
    return ports


@dataclass(frozen=True)
class Outage:
    """One cause for which services are out of reach, and its remedy."""

    sentence: str
    remedy: str
    is_of_router: bool
    """True if the router is lost, False if most of the site vanished while it answers."""


def restart_router_remedy(commands: AdvisedCommands) -> str:
    """Return the remedy of a router that does not answer."""
    if commands.containers:
        return f"start it again: {commands.start_router()}; the services come back by themselves"
    return (
        "is its process stopped (`kill -CONT PID`), or its machine off or cut off? Else start it again where "
        "it ran, with `pointit run` or `pointit router`; the services come back by themselves"
    )


def find_outage(
    known: Collection[str], gone: Collection[str], lost_router: str, commands: AdvisedCommands
) -> Outage | None:
    """Return the outage if the router is lost or most of the site vanished together, else None.

    `known`: instances that run or should run; `gone`: those of them that left, are absent or silent;
    `lost_router`: the address of the router that a service has lost, or `""`; `commands`: as the reader of
    the remedy types them.
    """
    majority = f"{len(gone)} of {len(known)} services are"
    is_majority = len(gone) >= MANY and 2 * len(gone) > len(known)
    if lost_router:
        sentence = f"the router at {lost_router} does not answer: "
        sentence += f"{majority} out of reach" if is_majority else "nothing arrives from other machines"
        return Outage(sentence, restart_router_remedy(commands), is_of_router=True)
    if not is_majority:
        return None
    remedy = (
        "look there: continue it (`kill -CONT PID`), or start it again; the log of what started them has the "
        "command"
    )
    if commands.containers:
        remedy = f"start what has ended: {commands.compose('up -d')}"
    return Outage(
        f"{majority} gone together: what started them has ended, is stopped, or is cut off from the router",
        remedy,
        is_of_router=False,
    )
