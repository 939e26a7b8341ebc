"""Credentials by which a process proves its identity to a router: a folder made by `pointit site`.

It holds `link.json` (site, addresses, name, role), the authority's certificate `ca.pem`, and `cert.pem` with
`key.pem`, or `password` on a site with passwords.
"""

import datetime as dt
import os
import re
import socket
import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from pointit.runtime.config.config import Config
from pointit.runtime.config.validation_message import describe_validation_error
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.atomic_file import read_limited

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
HANDSHAKE_S = 1.0
"""Time limit of each step when probing for the reason of a refusal."""
SECURE = re.compile(r"(?:tls|quic)/(?:\[(?P<ipv6>[^\]]+)\]|(?P<host>[^/:]+)):(?P<port>\d+)")
PASSWORD_FORM = re.compile(rb"[A-Za-z0-9_-]+")
"""Characters of a password."""

NO_SECURED_ROUTER = "{} is not a router of a secured site; give its address with --connect"
X509_TOO_OLD, X509_TOO_YOUNG, X509_OTHER_HOST = 10, 9, (62, 64)
"""OpenSSL's verify codes: expired; not yet valid; the certificate names another host or address."""

REFUSALS = {
    "CERTIFICATE_EXPIRED": "has expired or is not valid yet, by the router's clock",
    "UNKNOWN_CA": "is of another authority than the router's site",
    "BAD_CERTIFICATE": "is none that the router takes",
    "CERTIFICATE_UNKNOWN": "is none that the router takes",
    "DECRYPT_ERROR": "is of another authority of the same name",
    "CERTIFICATE_REQUIRED": "was not shown, and the router wants one",
}
"""Meaning of a router's alert on our certificate, by the end of OpenSSL's name for it."""


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
            raise ConfigError(
                f"{endpoint}: credentials are for encrypted addresses only, as "
                f"{' or '.join(self.link.endpoints)}; leave --connect out, or do without --credentials"
            )

    def expiry_warning(self, now: dt.datetime) -> str:
        """Return a warning if the credentials end within 30 days, else `""`."""
        if self.link.password or self.link.valid_until - now >= SOON:
            return ""
        name = self.link.name
        return (
            f"the credentials of {name} end on {self.link.valid_until:%Y-%m-%d}; renew them with "
            f"`pointit site renew {name}` before, and copy the folder here"
        )

    def settings(self) -> dict[str, Any]:
        """Return the settings for Zenoh's configuration. They hold secrets: never show them."""
        tls = "transport/link/tls"
        settings: dict[str, Any] = {
            "transport/link/protocols": ["tls", "quic"],
            f"{tls}/root_ca_certificate": str(self.folder / CA),
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
        return f"{self.link.site}/{self.link.name}/{self.link.generation}"


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
    public, secret = ([CA], PASSWORD) if link.password else ([CA, CERTIFICATE], KEY)
    for name in public:
        _read(folder / name)
    path = folder / secret
    _read(path)
    if os.name == "posix" and path.stat().st_mode & 0o077:
        raise ConfigError(
            f"{path}: others can read it, so it proves nothing; make it yours alone with `chmod 600 {path}`"
        )
    if link.password:
        _password(folder)
    again = f"renew it with `pointit site renew {link.name}` and copy the folder here"
    if not link.password and now < link.valid_from:
        raise ConfigError(
            f"{folder / CERTIFICATE}: is not valid before {link.valid_from:%Y-%m-%d %H:%M} UTC and "
            f"here it is {now:%Y-%m-%d %H:%M} UTC; set this machine's clock"
        )
    if not link.password and now > link.valid_until:
        raise ConfigError(f"{folder / CERTIFICATE}: has expired on {link.valid_until:%Y-%m-%d}; {again}")
    return Credentials(folder=folder, link=link)


class PassingRefusal(str):
    """A refusal that may pass: a router that is busy, or opens again, looks the same for a moment."""

    __slots__ = ()


def connection_refusal(credentials: Credentials, endpoint: str) -> str:
    """Return a message if the router at `endpoint` rejects a connection, else `""` (also without an answer).

    A `PassingRefusal` is not certain. Zenoh reports every refusal as a time-out, so the handshake is tried
    again without it. Blocks for up to 3 s: call it in a thread.
    """
    found = SECURE.match(endpoint)
    if not found:
        return ""
    host, port = found["ipv6"] or found["host"], int(found["port"])
    name = credentials.link.name
    try:
        context = _context(credentials)
    except (OSError, ssl.SSLError) as error:
        return f"{credentials.folder}: its certificates cannot be used ({_reason(error)})"
    try:
        plain = socket.create_connection((host, port), timeout=HANDSHAKE_S)
    except OSError:
        return ""  # no answer or no route: the usual message fits
    is_secured = False
    try:
        with plain, context.wrap_socket(plain, server_hostname=host) as secured:
            is_secured = True
            secured.recv(1)  # the router's verdict on our certificate follows the handshake
    except ssl.SSLError as error:
        if is_secured or not isinstance(error, ssl.SSLEOFError | ssl.SSLZeroReturnError):  # to OpenSSL 3.5
            return _handshake_problem(error, endpoint, credentials)
        return PassingRefusal(NO_SECURED_ROUTER.format(endpoint))
    except OSError:  # includes a time-out, which means success once the connection is secured
        if not is_secured:
            return PassingRefusal(NO_SECURED_ROUTER.format(endpoint))
    if credentials.link.password:
        return PassingRefusal(
            f"the router at {endpoint} refuses {name}'s password, or is too busy to check it; if that "
            f"persists, renew it with `pointit site renew {name}` and copy the folder here"
        )
    return ""


def _context(credentials: Credentials) -> ssl.SSLContext:
    context = ssl.create_default_context(cafile=str(credentials.folder / CA))
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    if not credentials.link.password:
        context.load_cert_chain(credentials.folder / CERTIFICATE, credentials.folder / KEY)
    return context


def _handshake_problem(error: ssl.SSLError, endpoint: str, credentials: Credentials) -> str:
    if isinstance(error, ssl.SSLCertVerificationError):
        return _distrust(error, endpoint, credentials)
    name = credentials.link.name
    for alert, why in REFUSALS.items():
        if (error.reason or "").endswith(alert):
            return (
                f"the router at {endpoint} refuses {name}'s certificate: it {why}; "
                f"renew it with `pointit site renew {name}`"
            )
    return PassingRefusal(f"{endpoint} does not speak TLS as a router does ({_reason(error)})")


def _distrust(error: ssl.SSLCertVerificationError, endpoint: str, credentials: Credentials) -> str:
    router = f"the router at {endpoint}"
    if error.verify_code == X509_TOO_OLD:
        return f"{router} has a certificate that expired; renew it with `pointit site renew router`"
    if error.verify_code == X509_TOO_YOUNG:
        return f"{router} has a certificate that is not valid yet by this machine's clock; set the clock"
    if error.verify_code in X509_OTHER_HOST:
        return (
            f"{router} has a certificate for other names; "
            "add this one with `pointit site renew router --host NAME`"
        )
    return (
        f"{router} is not the one of site {credentials.link.site}: another authority certified it; "
        "use that site's credentials, or the right address"
    )


def _read(path: Path) -> bytes:
    try:
        return read_limited(path, MAX_BYTES)
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


def _reason(error: Exception) -> str:
    return getattr(error, "reason", None) or getattr(error, "strerror", None) or type(error).__name__
