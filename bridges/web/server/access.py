"""Access control of the page: tokens, cookies, hosts, origins, response headers, and who could reach it."""

import hashlib
import hmac
import os
import secrets
from collections import OrderedDict
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from pointit.bridges.web.config import WebConfig
from pointit.bridges.web.wire import Role
from pointit.runtime.address_config import is_loopback
from pointit.runtime.errors import ConfigError
from pointit.schemas.text import one_line

LOOPBACK = frozenset({"127.0.0.1", "localhost", "[::1]"})
"""Names of this machine in a Host header."""

MAX_GUESSES = 10
"""Different wrong tokens that an address may try within `GUESSES_S`."""

GUESSES_S = 60.0

MAX_ADDRESSES = 1024
"""Maximum number of remembered addresses with wrong tokens; the oldest are dropped."""

TOKEN_BYTES = 18

MAX_ORIGIN = 100
"""Maximum number of characters of a foreign address in a sentence."""
PROXY_HELP = "The lines for nginx, Caddy and Traefik are in docs/how-to/network.md, *Behind a proxy*."

CONTAINER = "container"
"""Environment variable that marks a container; set by PointIt's image and podman."""
CONTAINER_MARKS = (Path("/.dockerenv"), Path("/run/.containerenv"))
"""Files that container engines create."""

MIN_TOKEN = 8
"""Minimum length of a token; shorter ones can be guessed."""


def new_token() -> str:
    """Return a random token."""
    return secrets.token_urlsafe(TOKEN_BYTES)


@dataclass(frozen=True, kw_only=True)
class RequestInfo:
    """Fields of a request that matter for access."""

    scheme: str
    """`http` or `https`, also of a websocket."""
    host: str
    """The Host header."""
    address: str
    """Address of the client."""
    origin: str = ""
    site: str = ""
    """Sec-Fetch-Site: relation of the requesting page to this server; `""` if the client does not send it."""
    destination: str = ""
    """Sec-Fetch-Dest: what it is for."""
    cookies: "dict[str, str]" = field(default_factory=dict[str, str])
    bearer: str = ""
    """Token of an Authorization header, or `""`."""

    @property
    def is_navigation(self) -> bool:
        """Return True if a person follows a link, or the client cannot embed pages."""
        return self.destination in ("", "document")


class Access:
    """The tokens, and wrong guesses by address."""

    def __init__(self, operator: str, viewer: str) -> None:
        self._secrets: tuple[tuple[str, Role], ...] = ()
        self.change_tokens(operator, viewer)
        self._hosts = set(LOOPBACK)
        self._public_host = ""
        self._guesses: OrderedDict[str, dict[bytes, float]] = OrderedDict()
        """Digests of wrong tokens and when they were tried, by address."""

    def change_tokens(self, operator: str, viewer: str) -> None:
        """Accept these tokens from now on, and no others."""
        self._secrets = ((cookie_value(operator), "operator"), (cookie_value(viewer), "viewer"))

    def know_hosts(self, names: Iterable[str]) -> None:
        """Accept these names or addresses in the Host header too."""
        for name in names:
            self._hosts.add(f"[{name}]" if ":" in name else name.lower())

    def know_proxy(self, public_url: str) -> None:
        """Accept requests that a reverse proxy passes on from `public_url`, `https://HOST`."""
        self._public_host = public_url.removeprefix("https://")
        name, _ = split_host(self._public_host)
        self.know_hosts([name.strip("[]")])

    def scheme(self, scheme: str, host: str) -> str:
        """Return the scheme of a request to `host` at the browser: a proxy may have ended the encryption."""
        if not self._public_host or host.lower() != self._public_host:
            return scheme
        encrypted = {"http": "https", "ws": "wss"}
        return encrypted.get(scheme, scheme)

    def is_known_host(self, host: str) -> bool:
        """Return True if the Host header names this server: a foreign name may have been bound to it."""
        name, _ = split_host(host)
        return name.lower() in self._hosts

    def is_own_origin(self, info: RequestInfo) -> bool:
        """Return True if the request comes from a page of this server."""
        own_origin = f"{info.scheme}://{info.host}"
        return bool(info.origin) and info.origin.lower() == own_origin.lower()

    def enter(self, token: str, info: RequestInfo, now_s: float) -> Role | None:
        """Return the role of a link's `token`, or None if it is wrong or the page is embedded.

        The right token always works: others on this machine have the same address and must not lock it out.
        """
        if not info.is_navigation:
            return None
        return self._role_of(cookie_value(token), info.address, now_s)

    def admit(self, info: RequestInfo, now_s: float) -> Role | None:
        """Return the role that the request's cookie gives, or else its bearer token."""
        secret = info.cookies.get(cookie_name(info), "")
        if not secret and info.bearer:
            secret = cookie_value(info.bearer)
        if not secret:
            return None
        return self._role_of(secret, info.address, now_s)

    def is_rate_limited(self, address: str, now_s: float) -> bool:
        """Return True if `address` has guessed too often and refusals are to be slow.

        The same wrong token counts once.
        """
        guesses = self._guesses.get(address)
        if guesses is None:
            return False
        for digest, guessed_s in list(guesses.items()):
            if now_s - guessed_s > GUESSES_S:
                del guesses[digest]
        if not guesses:
            del self._guesses[address]
        return len(guesses) >= MAX_GUESSES

    def _role_of(self, secret: str, address: str, now_s: float) -> Role | None:
        """Return the role of `secret`, or None after counting a guess of `address`."""
        # All are compared, so that the time does not depend on which one is right
        given = secret.encode(errors="replace")
        roles: list[Role] = []
        for known, role in self._secrets:
            if hmac.compare_digest(given, known.encode()):
                roles.append(role)
        if roles:
            return roles[0]

        # Beyond the limit, further guesses are not stored, which bounds memory
        if self.is_rate_limited(address, now_s):
            return None
        guesses = self._guesses.setdefault(address, {})
        self._guesses.move_to_end(address)
        guesses.setdefault(hashlib.sha256(given).digest(), now_s)
        if len(self._guesses) > MAX_ADDRESSES:
            self._guesses.popitem(last=False)
        return None


def socket_problem(info: RequestInfo, origin: str) -> str:
    """Return the reason for which the page of a browser at `origin` gets no websocket, with the remedy.

    Args:
        info: a request of that page which has reached the server.
        origin: scheme, host and port of the page's address.
    """
    own = f"{info.scheme}://{info.host}"
    if origin.lower() == own.lower():
        return (
            "The server is reached, and its websocket is not: let the proxy in front of PointIt pass "
            f"websockets on. {PROXY_HELP}"
        )
    shown = one_line(origin, MAX_ORIGIN)
    return (
        f"This page is opened at {shown}, and the proxy in front of PointIt passes it on as {own}: let it "
        f"pass on the Host, and start PointIt with --set web.public_url={shown}. {PROXY_HELP}"
    )


def split_host(host: str) -> tuple[str, str]:
    """Return name and port of a Host header; an IPv6 address keeps its brackets, a missing port is empty."""
    if host.startswith("["):
        name, bracket, port = host.partition("]")
        return name + bracket, port.removeprefix(":")
    name, _, port = host.partition(":")
    return name, port


def cookie_name(info: RequestInfo) -> str:
    """Return the cookie's name; browsers keep those of all ports of a host together."""
    _, port = split_host(info.host)
    if not port.isdecimal():
        port = ""
    suffix = "-tls" if info.scheme == "https" else ""
    return f"pointit-{port}{suffix}"


def cookie_value(token: str) -> str:
    """Return the cookie's value: a digest, since the token may have any characters."""
    content = b"pointit page " + token.encode(errors="replace")
    return hashlib.sha256(content).hexdigest()


def cookie(info: RequestInfo, token: str) -> str:
    """Return the Set-Cookie header for `token`, for this server alone and invisible to scripts."""
    secure = "; Secure" if info.scheme == "https" else ""
    return f"{cookie_name(info)}={cookie_value(token)}; Path=/; HttpOnly; SameSite=Strict{secure}"


def headers(info: RequestInfo) -> dict[str, str]:
    """Return the security headers of every response: no foreign or inline content, no embedding."""
    scheme = "wss" if info.scheme == "https" else "ws"
    socket = f"{scheme}://{info.host}"
    policy = (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data:",
        "font-src 'self'",
        "manifest-src 'self'",
        f"connect-src 'self' {socket}",  # older Safaris do not count websockets as 'self'
        "frame-ancestors 'none'",
        "base-uri 'none'",
        "form-action 'none'",
    )
    # Sensors, microphone and headset are for people's arms and words, the camera for scans of the room
    return {
        "Content-Security-Policy": "; ".join(policy),
        "X-Content-Type-Options": "nosniff",
        "X-Frame-Options": "DENY",
        "Referrer-Policy": "no-referrer",
        "Cross-Origin-Opener-Policy": "same-origin",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Permissions-Policy": "accelerometer=(self), gyroscope=(self), magnetometer=(self), "
        "screen-wake-lock=(self), camera=(self), microphone=(self), xr-spatial-tracking=(self), "
        "geolocation=(), payment=(), usb=()",
    }


def check(config: WebConfig) -> None:
    """Check that the page is not reachable unencrypted from elsewhere, and that tokens are strong.

    Raises:
        ConfigError: If it is not; names the parameter and what to do.
    """
    is_local = is_loopback(config.host) or (config.published_port and _is_contained())
    if not is_local:
        raise ConfigError(
            f"host: {config.host} can be reached from other machines, and what goes there is not "
            "encrypted; leave it at 127.0.0.1 and use lan: true, which opens the page by HTTPS "
            "(or published_port in a container)"
        )
    for name, token in (("operator_token", config.operator_token), ("viewer_token", config.viewer_token)):
        if token and len(token) < MIN_TOKEN:
            raise ConfigError(f"{name}: has {len(token)} characters, use at least {MIN_TOKEN}")
    if config.operator_token and config.operator_token == config.viewer_token:
        raise ConfigError("viewer_token: equals operator_token; choose another, or leave it empty")


def address(config: WebConfig, port: int) -> tuple[str, int]:
    """Return host and port of the page's address if it listens at `port`."""
    host = config.host if is_loopback(config.host) else "127.0.0.1"
    return host, config.published_port or port


def _is_contained() -> bool:
    return bool(os.environ.get(CONTAINER)) or any(mark.exists() for mark in CONTAINER_MARKS)
