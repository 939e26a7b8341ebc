"""An insider who floods by several connections, whose operations are permitted or denied.

`python -m tests.faults.insider SITE-FOLDER NAME KIND CONNECTIONS RATE`: writes `begins`, and once a second
the number of operations so far. `KIND` is one of `KINDS`, `RATE` the number of operations per second of all
connections together. When a connection is closed, it connects again within milliseconds.
"""

import contextlib
import itertools
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import zenoh
from zenoh.handlers import FifoChannel

from pointit.access.rights import rights_of
from pointit.access.site_folder import SiteFolder
from pointit.runtime.zenoh.session import configuration
from pointit.schemas.topics import CLAIM, CURSOR, IMU, READ_HISTORY, SET_THING, USER_ALIVE
from tests.integration.access.secured import link_of

VICTIM = "anna"
PAYLOAD = bytes(100)
LARGE_PAYLOAD = bytes(16_000)
LONG_KEY = "x" * 60_000
MAX_AHEAD_S = 0.01
RETRY_MS = 1
OPEN_TIMEOUT_MS = 2000

Act = Callable[[zenoh.Session, str], object]
"""Does one operation as the insider of that name."""


def write_own_keys() -> Act:
    """Return an act that writes each key that the insider may write in turn."""
    counts = itertools.count()
    keys: list[str] = []

    def act(session: zenoh.Session, name: str) -> None:
        if not keys:
            keys.extend(key for key in rights_of("user", name).writes if key.startswith("users/"))
        _write(session, keys[next(counts) % len(keys)])

    return act


def _write(session: zenoh.Session, key: str) -> None:
    session.put(key, PAYLOAD, congestion_control=zenoh.CongestionControl.BLOCK)


def _ask(session: zenoh.Session, key: str) -> None:
    session.get(key, FifoChannel(1), timeout=0.1)


def _subscribe(session: zenoh.Session, key: str) -> None:
    session.declare_subscriber(key, lambda _: None).undeclare()


def _be_present(session: zenoh.Session, key: str) -> None:
    session.liveliness().declare_token(key).undeclare()


def _declare_interest(session: zenoh.Session, key: str) -> None:
    """Ask the router for all readers of `key`, and take that back. No log of access rules has it."""
    session.declare_publisher(key).undeclare()


def _write_large(session: zenoh.Session, name: str) -> None:
    """Write as much as one message of a topic may have."""
    session.put(CLAIM.at(name), LARGE_PAYLOAD, congestion_control=zenoh.CongestionControl.BLOCK)


KINDS: dict[str, Act] = {
    "interests": lambda session, _name: _declare_interest(session, "**"),
    "interests in one key": lambda session, name: _declare_interest(session, CLAIM.at(name)),
    "large writes": _write_large,
    "own keys": write_own_keys(),
    "one own key": lambda session, name: _write(session, CLAIM.at(name)),
    "questions": lambda session, _name: _ask(session, READ_HISTORY.at()),
    "subscriptions": lambda session, name: _subscribe(session, CURSOR.at(name)),
    "presence": lambda session, name: _be_present(session, USER_ALIVE.at(name)),
    "denied writes": lambda session, _name: _write(session, CURSOR.at(VICTIM)),
    "denied questions": lambda session, _name: _ask(session, SET_THING.at(VICTIM)),
    "denied subscriptions": lambda session, _name: _subscribe(session, IMU.at(VICTIM)),
    "denied presence": lambda session, _name: _be_present(session, USER_ALIVE.at(VICTIM)),
    "keys of 60 kB": lambda session, _name: _write(session, LONG_KEY),
}
"""Kinds of operations by name, all but `CONNECTIONS`."""
CONNECTIONS = "connections"
"""Kind of who only opens and closes connections."""


def insider_configuration(folder: SiteFolder, name: str) -> zenoh.Config:
    config = configuration(link_of(folder, name))
    retry = {"period_init_ms": RETRY_MS, "period_max_ms": RETRY_MS, "period_increase_factor": 1}
    config.insert_json5("connect/retry", json.dumps(retry))
    config.insert_json5("connect/timeout_ms", str(OPEN_TIMEOUT_MS))
    return config


def flood(folder: SiteFolder, name: str, kind: str, connections: int, rate_hz: float) -> None:
    """Flood until killed."""
    if kind == CONNECTIONS:
        sessions: list[zenoh.Session] = []
    else:
        sessions = [zenoh.open(insider_configuration(folder, name)) for _ in range(connections)]
    began_s = time.monotonic()
    _say("begins")
    told_s = began_s
    open_sessions: list[zenoh.Session] = []
    for count in itertools.count(1):
        with contextlib.suppress(zenoh.ZError):  # it is cut off
            if kind == CONNECTIONS:
                open_sessions.append(zenoh.open(insider_configuration(folder, name)))
                if len(open_sessions) >= connections:
                    open_sessions.pop(0).close()
            else:
                KINDS[kind](sessions[count % connections], name)
        now_s = time.monotonic()
        ahead_s = count / rate_hz - (now_s - began_s)
        if ahead_s > MAX_AHEAD_S:
            time.sleep(ahead_s)
        if now_s - told_s >= 1.0:
            told_s = now_s
            _say(f"{count} in {now_s - began_s:.2f} s")


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    flood(SiteFolder(Path(sys.argv[1])), sys.argv[2], sys.argv[3], int(sys.argv[4]), float(sys.argv[5]))
