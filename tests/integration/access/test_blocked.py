# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false
"""An identity that floods is shut out at a router for a while, however it returns; nobody else is."""

import contextlib
import json
import sys
from collections.abc import Generator
from pathlib import Path

import pytest
import zenoh
from zenoh.handlers import Callback

from pointit.access.router_configuration import to_json5
from pointit.access.site_folder import SiteFolder
from pointit.runtime.zenoh.session import configuration
from pointit.schemas.topics import BUTTON, RAY
from tests.integration.access.secured import Member, RouterProgram, link_of, make_site, wait

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere nobody finds the sockets of Zenoh")

SOCKETS = 2
COMEBACKS = 20
PERSON = RAY.at("anna")
BLOCKED = "lab/anna has written 10000 messages more"


class Insider:
    """A session that connects again within milliseconds, and notes each end of its connection."""

    def __init__(self, folder: SiteFolder, name: str) -> None:
        config = configuration(link_of(folder, name))
        retry = {"period_init_ms": 1, "period_max_ms": 1, "period_increase_factor": 1}
        config.insert_json5("connect/retry", json.dumps(retry))
        self.ends = 0
        self.session = zenoh.open(config)
        self._listener = self.session.info.declare_transport_events_listener(
            Callback(self._on_event, indirect=False), history=False
        )

    def _on_event(self, event: zenoh.TransportEvent) -> None:
        self.ends += event.kind == zenoh.SampleKind.DELETE

    def write(self, count: int) -> None:
        for _ in range(count):
            self.session.put(PERSON, bytes(100), congestion_control=zenoh.CongestionControl.DROP)

    def close(self) -> None:
        self.session.close()


@contextlib.contextmanager
def insiders(folder: SiteFolder) -> Generator[list[Insider]]:
    opened = [Insider(folder, "anna") for _ in range(SOCKETS)]
    yield opened
    for each in opened:
        each.close()


def router_options(folder: SiteFolder, host: str) -> list[str]:
    if host == "127.0.0.1":
        return ["--site-folder", str(folder.path)]
    file = folder.path / "router" / "other.json5"
    file.write_text(to_json5([folder.router_site()], [host]))
    return ["--config", str(file)]


@pytest.mark.parametrize(
    ("password", "host"),
    [(False, "127.0.0.1"), (True, "127.0.0.1"), (False, "::1")],
    ids=["certificates", "passwords", "IPv6"],
)
def test_blocked_identity_is_closed_at_each_reconnection_and_named_once(
    tmp_path: Path, host: str, *, password: bool
) -> None:
    folder = make_site(tmp_path / "site", password=password, host=host)
    with (
        RouterProgram(*router_options(folder, host)) as router,
        Member(folder, "services") as services,
        services.listening(PERSON, BUTTON.at("ben")) as ear,
    ):
        ben = Insider(folder, "ben")  # on the same machine
        with insiders(folder) as flooding:
            wait(lambda: BLOCKED in router.said, "the block", lambda: [each.write(500) for each in flooding])
            for each in flooding:  # Zenoh itself comes back from another port, with the same session
                wait(
                    lambda each=each: each.ends > COMEBACKS, "reconnections", lambda each=each: each.write(50)
                )
        ear.keys.clear()
        written = 0
        for _ in range(COMEBACKS):  # with a new session each time
            with contextlib.suppress(zenoh.ZError):  # closed before it was open
                again = Insider(folder, "anna")
                again.write(50)
                written += 50
                wait(lambda again=again: again.ends > 0, "the end of a connection", lambda: None)
                again.close()
        ear.hears(BUTTON.at("ben"), lambda: ben.session.put(BUTTON.at("ben"), b"x"))
        assert ear.keys.count(PERSON) <= written / 2
        assert ben.ends == 0
        assert router.said.count(BLOCKED) == 1
        ben.close()
