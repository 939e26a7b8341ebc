"""A secured site on this machine: its folder, a router that goes by its rules, sessions of its identities."""

import contextlib
import datetime as dt
import itertools
import json
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Generator
from pathlib import Path
from types import TracebackType
from typing import Self

import zenoh
from zenoh.handlers import Callback

from pointit.access.rights import Role
from pointit.access.router_configuration import MAX_HISTORY_HZ, RouterSite
from pointit.access.router_configuration import configuration as router_configuration
from pointit.access.site_folder import SiteFolder, SiteFolderState
from pointit.runtime.link.link import Credentials, Link, read_credentials
from pointit.runtime.router import parse_config
from pointit.runtime.zenoh.session import configuration
from pointit.schemas.topics import READ_HISTORY
from tests.support.buses import free_port
from tests.support.forked import ForkedProcess
from tests.support.pace import Patience

PATIENCE_S = 30.0
NAMES: dict[str, Role] = {
    "anna": "user", "ben": "user", "guest1": "user", "services": "services", "web": "web",
    "operator": "operator", "dashboard1": "dashboard", "supervisor": "supervisor", "foxglove": "service",
}  # fmt: skip


def now() -> dt.datetime:
    return dt.datetime.now(dt.UTC)


def make_site(
    path: Path,
    site: str = "lab",
    *,
    password: bool = False,
    dashboard_rate_hz: float = 0.0,
    names: dict[str, Role] | None = None,
    days: float = 30.0,
    host: str = "127.0.0.1",
) -> SiteFolder:
    folder = SiteFolder(path)
    state = SiteFolderState(
        site=site, hosts=(host,), port=free_port(), days=days, password=password,
        dashboard_rate_hz=dashboard_rate_hz, identities={},
    )  # fmt: skip
    folder.create(state, NAMES if names is None else names, now())
    return folder


def credentials_of(folder: SiteFolder, name: str) -> Credentials:
    return read_credentials(folder.identity_folder(name), now())


def link_of(folder: SiteFolder, name: str) -> Link:
    credentials = credentials_of(folder, name)
    return Link(site=credentials.link.site, connect=credentials.link.endpoints, credentials=credentials)


def endpoint_of(folder: SiteFolder) -> str:
    return f"tls/127.0.0.1:{folder.state().port}"


@contextlib.contextmanager
def routed(*sites: RouterSite | SiteFolder) -> Generator[zenoh.Session]:
    """Route for these sites in this process."""
    known = [site.router_site() if isinstance(site, SiteFolder) else site for site in sites]
    text = json.dumps(router_configuration(known, ["127.0.0.1"]))
    with zenoh.open(parse_config(text, Path())) as session:
        yield session


def open_with(link: Link, settings: dict[str, str]) -> zenoh.Session:
    """Open a session with more than our own code would set."""
    config = configuration(link)
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


class Ear:
    """Keys that a session has received, in order."""

    def __init__(self) -> None:
        self.keys: list[str] = []

    def __call__(self, sample: zenoh.Sample) -> None:
        self.keys.append(str(sample.key_expr))

    def hears(self, key: str, say: Callable[[], object] = lambda: None) -> None:
        """Wait until `key` is heard, saying it again and again."""
        wait(lambda: key in self.keys, f"{key} to be heard", say)

    def heard(self) -> set[str]:
        """Return the received keys except marks."""
        return {key for key in self.keys if "@may" not in key}


def wait(condition: Callable[[], bool], what: str, meanwhile: Callable[[], object] = lambda: None) -> None:
    patience = Patience(PATIENCE_S)
    while not condition():
        assert not patience.is_over(), f"waited {patience} for {what}"
        meanwhile()
        time.sleep(0.01)


class Member:
    """One identity's session, without our bus around it: what somebody with bad intentions would use."""

    def __init__(self, folder: SiteFolder, name: str, *, retry_ms: int = 0) -> None:
        """Open it. `retry_ms`: time until it connects again when its connection has ended. 0: as our own."""
        self.name = name
        patience = Patience(PATIENCE_S)
        config = configuration(link_of(folder, name))
        if retry_ms:
            retry = {"period_init_ms": retry_ms, "period_max_ms": retry_ms, "period_increase_factor": 1}
            config.insert_json5("connect/retry", json.dumps(retry))
        while True:
            try:
                self.session = zenoh.open(config)
                break
            except zenoh.ZError:  # the router is busy, or opens again
                if patience.is_over():
                    raise
                time.sleep(0.05)
        self._marks = itertools.count()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with contextlib.suppress(zenoh.ZError):  # the router has cut it, and does not answer any more
            self.session.close()

    def put(self, *keys: str, size: int = 1) -> None:
        for key in keys:
            self.session.put(key, bytes(size), congestion_control=zenoh.CongestionControl.BLOCK)

    @contextlib.contextmanager
    def listening(self, *keys: str) -> Generator[Ear]:
        ear = Ear()
        declared = [self.session.declare_subscriber(key, Callback(ear, indirect=False)) for key in keys]
        yield ear
        for each in declared:
            each.undeclare()

    @contextlib.contextmanager
    def serving(self, *keys: str) -> Generator[list[str]]:
        """Answer these requests; yields the keys that were asked."""
        asked: list[str] = []

        def answer(query: zenoh.Query) -> None:
            with query:
                asked.append(str(query.key_expr))
                query.reply(str(query.key_expr), b"done")

        declared = [self.session.declare_queryable(key, Callback(answer, indirect=False)) for key in keys]
        yield asked
        for each in declared:
            each.undeclare()

    @contextlib.contextmanager
    def present(self, *keys: str) -> Generator[None]:
        tokens = [self.session.liveliness().declare_token(key) for key in keys]
        yield
        for token in tokens:
            token.undeclare()

    def sees(self, *keys: str) -> set[str]:
        """Return the keys of the present liveliness tokens that match `keys`."""
        replies = [self.session.liveliness().get(key, timeout=PATIENCE_S) for key in keys]
        return {str(reply.ok.key_expr) for found in replies for reply in found if reply.ok is not None}

    def answered(self, *keys: str) -> set[str]:
        """Ask elsewhere, past events as rarely as may be; return which keys of `keys` are answered."""
        remote = zenoh.Locality.REMOTE
        found: set[str] = set()
        for key in keys:
            if key == READ_HISTORY.at():
                time.sleep(1 / MAX_HISTORY_HZ)
            replies = self.session.get(key, payload=b"?", timeout=PATIENCE_S, allowed_destination=remote)
            if any(reply.ok is not None for reply in replies):
                found.add(key)
        return found

    def mark(self, name: str = "") -> str:
        """Put what this identity may always put; who listens to it knows that all before has gone through.

        A supervisor may put what belongs to another `name`, too, who alone hears it then.
        """
        key = f"@may/{name or self.name}/mark{next(self._marks)}"
        self.session.put(key, b"")
        return key

    def settle(self, witness: "Member") -> None:
        """Return when what was declared and put here so far has reached the router."""
        mine: list[str] = []
        name = witness.name if self.name == "supervisor" else self.name
        with witness.listening(f"@may/{name}/**") as ear:
            wait(lambda: any(key in ear.keys for key in mine), "a mark", lambda: mine.append(self.mark(name)))


@contextlib.contextmanager
def joined(folder: SiteFolder, *names: str) -> Generator[list[Member]]:
    with contextlib.ExitStack() as stack:
        yield [stack.enter_context(Member(folder, name)) for name in names]


class RouterProgram:
    """`pointit router` with options, in a process of its own."""

    def __init__(self, *options: str, cwd: Path | None = None) -> None:
        self._folder = tempfile.TemporaryDirectory()
        out = Path(self._folder.name, "out")
        err = Path(self._folder.name, "err")
        self._process = ForkedProcess(["router", *options], out, err, os.environ, cwd)

    def __enter__(self) -> Self:
        try:
            self._process.says("listens")
        except AssertionError:
            self._folder.cleanup()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)
        _, said = self.ends()
        if kind is not None:
            sys.stdout.write(said)  # pytest shows it with the failure

    @property
    def said(self) -> str:
        """Log and error output of the process."""
        return self._process.err.read_text()

    def ends(self) -> tuple[int, str]:
        """Wait for the end; return the exit code and all that it has said."""
        code = self._process.wait(60)
        assert code is not None, "it goes on"
        said = self.said
        self._folder.cleanup()
        return code, said
