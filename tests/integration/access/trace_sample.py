"""Sample of the log of a router, of each kind of operation that `pointit.access.zenoh_trace` tells apart.

`python -m tests.integration.access.trace_sample` writes `SAMPLE` again, which a new version of Zenoh needs.
"""

import contextlib
import os
import re
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import zenoh

from pointit.access.site_folder import SiteFolder
from pointit.access.zenoh_trace import FILTER
from pointit.schemas.topics import CLAIM, CURSOR, IMU, READ_HISTORY, USER_ALIVE
from tests.integration.access.secured import Member, make_site, wait

SAMPLE = Path(__file__).parents[2] / "unit" / "access" / "zenoh_trace.log"
ASKS = ("selector/anna/release", READ_HISTORY.at())
"""Denied and permitted question."""
BURST = 20
SETTLE_S = 0.5
TIME = re.compile(rb"\d{4}-\d\d-\d\dT\S+?Z")
LINE_NUMBER = re.compile(rb"/\S*?/(zenoh-\S+?\.rs)")
CONFIGURED = b"New downsampler rule enabled"
"""Lines on each rule at each connection, of which one is enough."""


def log_of_router(folder: Path) -> bytes:
    """Return the log of a router while each kind of operation is done."""
    site = make_site(folder / "site", names={"anna": "user", "ben": "user", "services": "services"})
    out = folder / "out"
    environment = {**os.environ, "RUST_LOG": FILTER}
    environment.pop("NO_COLOR", None)
    command = [sys.executable, "-m", "pointit", "router", "--site-folder", str(site.path)]
    with out.open("wb") as file, subprocess.Popen(command, stdout=file, env=environment) as router:
        try:
            wait(lambda: b"router listens" in out.read_bytes(), "the router")
            _do_each_kind(site)
            time.sleep(SETTLE_S)
        finally:
            router.terminate()
    return out.read_bytes()


def _do_each_kind(site: SiteFolder) -> None:
    with (
        Member(site, "services") as services,
        Member(site, "anna") as anna,
        services.listening(CLAIM.at("anna")),
    ):
        anna.put(CLAIM.at("anna"), CURSOR.at("ben"), CURSOR.at("ben"), "x" * 2000)
        time.sleep(SETTLE_S)
        anna.put(CLAIM.at("anna"), size=100_000)
        anna.put(*[CURSOR.at("anna")] * BURST)
        with anna.listening(CURSOR.at("ben"), IMU.at("ben")):
            pass
        with anna.present(USER_ALIVE.at("anna"), USER_ALIVE.at("ben")):
            pass
        for key in ASKS:
            list(anna.session.get(key, payload=b"?", timeout=1.0))
        time.sleep(SETTLE_S)
    with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", site.state().port)) as stranger:
        stranger.sendall(b"not TLS at all")
        stranger.recv(1)


def reduced(log: bytes) -> bytes:
    """Return a log with one line on rules, without time and places of the machine that built Zenoh."""
    lines = log.splitlines(keepends=True)
    configured = [line for line in lines if CONFIGURED in line]
    lines = [line for line in lines if line.startswith(b"\x1b[") and (line not in configured[1:])]
    text = TIME.sub(b"2030-01-01T00:00:00.000000Z", b"".join(lines))
    return LINE_NUMBER.sub(rb"\1", text)


if __name__ == "__main__":
    zenoh.init_log_from_env_or("off")
    with tempfile.TemporaryDirectory() as temporary:
        SAMPLE.write_bytes(reduced(log_of_router(Path(temporary))))
