"""An identity that floods is shut out at a router for a while, however it returns; nobody else is."""

import contextlib
import json
import sys
import time
from collections.abc import Generator
from pathlib import Path

import pytest
import zenoh
from zenoh.handlers import Callback

from pointit.access.router_configuration import to_json5
from pointit.access.site_folder import SiteFolder
from pointit.runtime.link.link import LEASE_MS
from pointit.runtime.zenoh.session import configuration
from pointit.schemas.topics import BUTTON, RAY
from tests.integration.access.secured import Ear, Member, RouterProgram, link_of, make_site, wait

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere nobody finds the sockets of Zenoh")

SOCKETS = 2
COMEBACKS = 4
LEASES = 2
LEASE_S = LEASE_MS / 1000
SETTLE_S = 0.5
PERSON = RAY.at("anna")
BLOCKED = "lab/anna has written or asked 10000 messages more"


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


def router_options(folder: SiteFolder, listen: str) -> list[str]:
    if listen == "0.0.0.0":  # noqa: S104 - the router's default
        return ["--site-folder", str(folder.path)]
    file = folder.path / "router" / "other.json5"
    file.write_text(to_json5([folder.router_site()], [listen]))
    return ["--config", str(file)]


def heard_late(folder: SiteFolder, ear: Ear) -> int:
    """Return the number of keys heard from a new flooding session once the router has had time to know it."""
    again = Insider(folder, "anna")
    try:
        _write_for(again, SETTLE_S)
        count = len(ear.keys)
        _write_for(again, SETTLE_S)
        return len(ear.keys) - count
    finally:
        again.close()


def _write_for(insider: Insider, duration_s: float) -> None:
    ends_s = time.monotonic() + duration_s
    while time.monotonic() < ends_s:
        insider.write(50)
        time.sleep(0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("password", "listen"),
    [(False, "0.0.0.0"), (True, "0.0.0.0"), (False, "::")],  # noqa: S104 - as above
    ids=["certificates", "passwords", "both versions of IP"],
)
def test_blocked_identity_is_held_at_each_reconnection_and_named_once(
    tmp_path: Path, listen: str, *, password: bool
) -> None:
    folder = make_site(tmp_path / "site", password=password)
    with RouterProgram(*router_options(folder, listen)) as router, Member(folder, "services") as services:
        ben = Insider(folder, "ben")  # on the same machine
        with insiders(folder) as flooding:

            def write() -> None:
                for insider in flooding:
                    insider.write(1000)  # on a busy machine it takes long until the next call

            wait(lambda: BLOCKED in router.said, "the block", write)
            # Zenoh itself comes back from another port, with the same session, a lease later each time.
            wait(lambda: min(insider.ends for insider in flooding) > 0, "reconnections", write)
            before = [insider.ends for insider in flooding]
            began_s = time.monotonic()
            while time.monotonic() - began_s < LEASES * LEASE_S:
                write()
                time.sleep(0.01)
            most = LEASES + 2

            assert all(insider.ends - ends <= most for insider, ends in zip(flooding, before, strict=True))
        with services.listening(PERSON) as ear:
            assert [heard_late(folder, ear) for _ in range(COMEBACKS)] == [0] * COMEBACKS
        with services.listening(BUTTON.at("ben")) as ear:
            ear.hears(BUTTON.at("ben"), lambda: ben.session.put(BUTTON.at("ben"), b"x"))

        assert ben.ends == 0
        assert router.said.count(BLOCKED) == 1
        ben.close()
