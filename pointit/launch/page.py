"""The page of a run or a dashboard: its service, a free port, its URLs and stored tokens."""

import contextlib
import logging
import os
import secrets
import socket
import sys
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, TextIO
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pointit.bridges.web.config import WebConfig
from pointit.bridges.web.lan_address import choose_address
from pointit.bridges.web.server.link_file import keep_link, without_token
from pointit.launch.plan.launches import PAGE, Settings, layers_of, service_of
from pointit.runtime.address_config import is_loopback
from pointit.runtime.errors import ConfigError, ListenError
from pointit.runtime.host.extras import has_extra, remedy
from pointit.runtime.host.name_lookup import lan_addresses, resolve
from pointit.runtime.host.state_file import (
    NO_MODES,
    VARIABLE,
    create_atomically,
    keeps_modes,
    site_folder,
    write_atomically,
)
from pointit.runtime.service.service import AnyService, Launch, Scope, Service
from pointit.schemas.text import system_reason
from pointit.services import registry

log = logging.getLogger(__name__)

Token = Annotated[str, Field(min_length=22, max_length=64, pattern=r"^[\w-]+$")]

TOKEN_BYTES = 18
"""Length of a token: 144 bits, and the URL fits a line of 80 columns."""
FILE = "tokens.json"
MAX_BYTES = 4096
OTHERS = 0o077
"""Mode bits of a file for its group and others."""
REMEDY = f"the page needs {remedy(registry.process(PAGE).extra)}"
"""Advice if the extra is not installed."""
PORT = 8090
LAN_PORT = 8443
CONNECT_S = 0.5
"""Timeout of a connection to an address of this machine, s."""
MAX_PAGES_IN_RUN = 16
"""Maximum number of open pages, unless set by hand, of a page in the run's process. It may be opened to the
local network later, and each page that looks on takes time of the process that computes cursors."""
PORTS_TO_TRY = 10
"""Consecutive ports to try, from the default one, if none was requested."""
EVERYWHERE_IPV6 = "::"
EVERYWHERE = frozenset({"", "0.0.0.0", EVERYWHERE_IPV6})  # noqa: S104 - told apart, not listened at


def _new() -> str:
    return secrets.token_urlsafe(TOKEN_BYTES)


class PageTokens(BaseModel):
    """Tokens for control and for viewing; random unless given."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)

    operator: Token = Field(default_factory=_new)
    viewer: Token = Field(default_factory=_new)


def stored_tokens(site: str, *, renew: bool = False) -> tuple[PageTokens, Sequence[str]]:
    """Return the tokens of the pages of `site`, the same at every start, and notices about them.

    They are in a file of the site's state that only its owner may read. A missing or untrusted file is
    replaced by one with new tokens.

    `renew`: replace the stored tokens, which revokes earlier links.

    Raises:
        KeyNameError: If `site` is not a valid name.
    """
    path = site_folder(site, PAGE) / FILE
    notes: list[str] = []
    problem = ""
    if not renew:
        try:
            return _read_or_create(path), ()
        except FileNotFoundError:  # it cannot be created
            pass
        except OSError as error:
            problem = f"cannot be read ({system_reason(error)})"
        except ValueError as error:
            problem = str(error)
        if problem:
            notes.append(f"the page has a new link, the old one is revoked: {path} {problem}")
            if not keeps_modes(path.parent):
                notes.append(f"{NO_MODES}: set the variable {VARIABLE} to a folder in your home directory")

    # Without a file, the next start has other tokens: the link ends with the run
    tokens = PageTokens()
    try:
        write_atomically(path, _content(tokens))
    except ConfigError as error:
        notes.append(f"the link of the page is valid for this run only: {error}")
    return tokens, notes


class TokenFile:
    """The tokens of the pages of a site as their file has them now, for a process that shares them."""

    def __init__(self, site: str) -> None:
        """Read the file, or create it, as `stored_tokens` does."""
        self._path = site_folder(site, PAGE) / FILE
        self._tokens, self.notes = stored_tokens(site)
        self._identity = self._file_identity()

    def current(self) -> PageTokens:
        """Return the tokens. The file is read again if it was replaced, such as by `--new-link` of a page.

        While it is missing or cannot be trusted, the last ones are valid.
        """
        identity = self._file_identity()
        if identity != self._identity:
            with contextlib.suppress(OSError, ValueError):
                self._tokens = _read(self._path)
                self._identity = identity
        return self._tokens

    def _file_identity(self) -> tuple[int, int, int] | None:
        try:
            status = self._path.stat()
        except OSError:
            return None
        return status.st_ino, status.st_mtime_ns, status.st_size


def _content(tokens: PageTokens) -> bytes:
    return f"{tokens.model_dump_json()}\n".encode()


def _read_or_create(path: Path) -> PageTokens:
    """Return the tokens in the file at `path`, which is created if it is missing.

    Raises:
        OSError: If it cannot be read.
        ValueError: If it cannot be trusted, as of `_read`, or created.
    """
    try:
        return _read(path)
    except FileNotFoundError:
        pass
    with contextlib.suppress(ConfigError):  # it cannot be written, which the caller tries again, and tells
        create_atomically(path, _content(PageTokens()))
    return _read(path)  # of another process that has created it meanwhile


def _read(path: Path) -> PageTokens:
    """Return the tokens in the file at `path`.

    Raises:
        OSError: If it cannot be read.
        ValueError: If it cannot be trusted. The message continues a sentence that starts with the path.
    """
    with path.open("rb") as file:
        status = os.fstat(file.fileno())
        if os.name == "posix" and status.st_mode & OTHERS:
            raise ValueError("could be read by others")
        if os.name == "posix" and status.st_uid != os.geteuid():
            raise ValueError("belongs to another user")
        data = file.read(MAX_BYTES)
    try:
        stored = PageTokens.model_validate_json(data)
    except ValidationError:  # its details would reveal the contents
        raise ValueError("does not hold two tokens") from None
    if stored.operator == stored.viewer or len(stored.model_fields_set) < 2:
        raise ValueError("does not hold two tokens")
    return stored


@dataclass(frozen=True, kw_only=True)
class NumberedLaunch(Launch):
    """One of several services of a kind on a site, each with its own instance name: `web`, `web.2`, …."""

    number: int = 1

    @property
    def instance(self) -> str:
        """Return the instance name."""
        if self.number == 1:
            return super().instance
        return f"{super().instance}.{self.number}"


def _load() -> type[AnyService]:
    service: type[AnyService] = registry.process(PAGE).load()
    return service


class PageProcess(Service[WebConfig]):
    """The page as a process of its own: what a run needs to start it, without importing its server."""

    NAME: ClassVar[str] = PAGE
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = WebConfig


@dataclass(frozen=True, kw_only=True)
class Page:
    """A page to be served, and its URLs. They contain tokens, so they are shown once, to the operator."""

    config: WebConfig
    url: str
    """URL with control rights, on this machine."""
    viewer_url: str
    """URL with viewing rights only."""
    lan_url: str = ""
    """URL with control rights from the local network, or `""` if the page is not open to it."""
    viewer_lan_url: str = ""
    scan_url: str = ""
    """URL with which a phone, or a browser here, maps the room. `""`: no scan is open from the start."""
    is_open_to_others: bool = False
    """True if other people than the operator of this machine can open it. It has a process of its own then,
    so that the messages of visitors do not delay pointing."""
    is_usual: bool = True
    """True if no parameter was set by hand, so that none needs to be checked."""
    load: Callable[[], type[AnyService]] = _load
    """Returns the service class. Slow, because it imports all dependencies."""

    @property
    def instance(self) -> str:
        """Return the instance name of the first or only page."""
        return PAGE

    def launch(self, number: int = 1) -> NumberedLaunch:
        """Return the launch of page `number`, counted from 1. Slow: imports the server."""
        return NumberedLaunch(service=self.load(), config=self.config, number=number)

    def launch_in_run(self) -> NumberedLaunch:
        """Return the launch of the page in the process of a run. Slow: imports the server."""
        config = self.config
        if "most_viewers" not in config.model_fields_set:
            config = config.model_copy(update={"most_viewers": MAX_PAGES_IN_RUN})
        return NumberedLaunch(service=self.load(), config=config)

    def process_launch(self) -> NumberedLaunch:
        """Return the launch of the page in a process of its own."""
        return NumberedLaunch(service=PageProcess, config=self.config)


def is_available() -> bool:
    """Return True if the dependencies of a page are installed; imports none of them."""
    return has_extra(registry.process(PAGE).extra)


def page_of(
    chosen: Settings,
    *,
    below: Mapping[str, Any] | None = None,
    asked: Mapping[str, Any] | None = None,
    places: Mapping[str, Mapping[str, Any]] | None = None,
    tokens: PageTokens | None = None,
    option: str = "--web-port",
) -> Page:
    """Return the page, at currently free ports.

    `chosen`, files and `--set`, takes precedence over `asked`, the command line, and that over `below`, the
    scenario. `tokens` are used unless others are set by hand. `option` chooses another port.

    Raises:
        ConfigError: a parameter is wrong.
        ListenError: If the requested port, or every port that was tried, is in use.
    """
    tokens = tokens or PageTokens()
    usual: dict[str, Any] = {
        "operator_token": tokens.operator,
        "viewer_token": tokens.viewer,
        "places": dict(places or {}),
    }
    sources: dict[str, Mapping[str, Any]] = {"defaults of the page": usual}
    sources["scenario"] = below or {}
    sources["command line"] = asked or {}
    layers = layers_of(PAGE, sources, chosen)
    config = layers.build(WebConfig)
    # A port that was chosen must be free. Otherwise it is the next free one.
    is_asked = "port" in config.model_fields_set  # by itself, or in the host
    ports = {"port": _port(config.host, config.port, PORT, is_asked=is_asked, option=option)}
    lan_host = ""
    if config.lan:
        lan_host = _lan_host(config)
        is_asked = "lan_port" in layers.values
        everywhere = EVERYWHERE_IPV6 if ":" in lan_host else ""
        ports["lan_port"] = _port(
            everywhere, config.lan_port, LAN_PORT, is_asked=is_asked, option="web.lan_port"
        )

    # Links for this machine, and for others in its network
    shown_port = config.published_port or ports["port"]
    local_link = f"http://{_shown(config.host)}:{shown_port}/?token="
    lan_link = ""
    if lan_host:  # else the page says that there is none
        lan_link = f"https://{_shown(lan_host)}:{ports['lan_port']}/?token="
    lan_url = ""
    viewer_lan_url = ""
    if lan_link:
        lan_url = lan_link + config.operator_token
        viewer_lan_url = lan_link + config.viewer_token

    # A page with parameters that were set by hand is checked with the services
    is_unchanged = all(layers.values.get(name) == value for name, value in usual.items())
    has_only_usual = layers.values.keys() <= {*usual, "port", "lan"}
    is_viewer_invited = config.viewer_token != tokens.viewer
    is_reachable = config.lan or config.published_port > 0
    if not is_reachable:
        is_reachable = not is_loopback(config.host)
    is_open_to_others = is_reachable or is_viewer_invited
    return Page(
        config=config.model_copy(update=ports),
        url=local_link + config.operator_token,
        viewer_url=local_link + config.viewer_token,
        lan_url=lan_url,
        viewer_lan_url=viewer_lan_url,
        scan_url=_scan_url(lan_link or local_link, config.scan_token),
        is_open_to_others=is_open_to_others,
        is_usual=is_unchanged and has_only_usual,
    )


def _lan_host(config: WebConfig) -> str:
    """Return the address at which the page will listen in the local network, or `""` if there is none.

    Raises:
        ConfigError: If `lan_address` is no address.
    """
    addresses = lan_addresses()
    if not config.lan_address and not addresses:
        return ""
    return choose_address(config.lan_address, addresses)


def is_listening(url: str) -> bool:
    """Return True if a server of this machine accepts connections at `url`."""
    parts = urlsplit(url)
    host = parts.hostname or ""
    try:
        # From the same address: that fails if it is another machine's, which may answer, or a proxy for it
        socket.create_connection((host, parts.port), CONNECT_S, source_address=(host, 0)).close()
    except OSError:
        return False
    return True


def lan_lines(url: str, path: Path | None, advice: str, stream: TextIO | None = None) -> list[str]:
    """Return the lines to print on the local network once the page is present, without a dead address.

    Args:
        url: URL of the page there. `""` if it is not to be open, or there is no network, which it reports.
        path: the file with its link, or None.
        advice: of `lan_advice`.
        stream: where it is printed.
    """
    if not url:
        return []
    if not is_listening(url):
        problem = f"the page does not listen at {without_token(url)}; its log has the reason"
        return [f"--lan: not open to the local network: {problem}"]
    lines = [f"--lan: the page is open to the local network, at {where(url, path, stream)}"]
    if advice:
        lines.append(f"--lan: {advice}")
    return lines


def _scan_url(link: str, token: str) -> str:
    return token and f"{link.partition('/?')[0]}/scan?token={token}"


def is_asked_of_page(settings: Iterable[str]) -> bool:
    """Return True if one of `--set` is for the page."""
    return any(service_of(setting) == PAGE for setting in settings)


def _port(host: str, port: int, usual: int, *, is_asked: bool, option: str) -> int:
    """Return a free port: the requested one, if there is one.

    Raises:
        ListenError: If none is free.
    """
    candidates = [port] if is_asked else list(range(usual, usual + PORTS_TO_TRY))
    reason = ""
    for candidate in candidates:
        try:
            return _probe(host, candidate)
        except OSError as error:
            reason = system_reason(error)
    shown = f"{candidates[0]}"
    if not is_asked:
        shown = f"{candidates[0]} to {candidates[-1]}"
    address = f"{_shown(host)}:{shown}"
    raise ListenError(f"the page cannot listen at {address}: {reason}; choose another port with {option}")


def _probe(host: str, port: int) -> int:
    """Return `port` (0: any) if it can be bound, with SO_REUSEADDR as the server uses it."""
    family, address = resolve(host, port, socket.SOCK_STREAM)[0]
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind(address)
        probe.listen(1)
        number: int = probe.getsockname()[1]
    return number


def _shown(host: str) -> str:
    if host in EVERYWHERE:
        return "127.0.0.1"
    return f"[{host}]" if ":" in host else host


@contextlib.contextmanager
def page_link_file(site: str, *urls: str) -> Generator[Path | None]:
    """Yield a file with `urls` that only its owner can read, or None if it cannot be written."""
    try:
        path = keep_link(site, *filter(None, urls))
    except ConfigError as error:
        log.warning("the link of the page could not be written to a file: %s", error)
        yield None
        return
    try:
        yield path
    finally:
        path.unlink(missing_ok=True)


def where(url: str, path: Path | None, stream: TextIO | None = None) -> str:
    """Return the text to print for the page at `url`: on a terminal its link, in a log its file, `path`."""
    if (stream or sys.stderr).isatty():
        return url
    shown = without_token(url)
    if path is not None:
        shown += f" (its link is in {path})"
    return shown


def page_unavailable_error(reason: str) -> ConfigError:
    """Return the error for an option that needs an unavailable page."""
    return ConfigError(f"{reason}: {REMEDY}")
