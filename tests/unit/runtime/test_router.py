"""A router that is given up while it opens."""

import asyncio
import os
import threading
from pathlib import Path

import pytest

from pointit.runtime.router import router
from pointit.runtime.router.router import Router
from pointit.runtime.router.router_log import MOST_LINES, _read
from tests.support.bench import until

pytestmark = pytest.mark.wall_time
PATIENCE_S = 20.0


class Session:
    def __init__(self) -> None:
        self.is_closed = False

    def close(self) -> None:
        self.is_closed = True


def test_without_connections_no_sockets_are_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """To find them, all that this process has open is looked at, in the loop."""
    cut: list[list[tuple[str, int]]] = []
    looks: list[bool] = []

    def unread() -> dict[tuple[str, int], int]:
        looks.append(True)
        return {("10.0.0.7", 40_000): 5}

    monkeypatch.setattr(router, "cut", cut.append)
    monkeypatch.setattr(router, "unread", unread)
    routing = Router(lambda: "{}", Path(), [])
    by_quic, by_tls = "quic/10.0.0.8:40000", "tls/10.0.0.7:40000"
    for addresses in ([], [by_quic]):
        routing.cut(addresses)
        assert routing.unread(addresses) == {}
    assert (cut, looks) == ([], [])
    routing.cut([by_quic, by_tls])
    assert routing.unread([by_quic, by_tls]) == {by_tls: 5}
    assert cut == [[("10.0.0.7", 40_000)]]


async def test_a_session_that_opens_after_cancellation_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, release = threading.Event(), threading.Event()
    session = Session()

    def opened(_config: object) -> Session:
        begun.set()
        assert release.wait(PATIENCE_S)
        return session

    monkeypatch.setattr("zenoh.open", opened)
    routing = Router(lambda: "{}", Path(), [])
    opening = asyncio.create_task(routing.open())
    await until(begun.is_set)
    opening.cancel()
    with pytest.raises(asyncio.CancelledError):
        await opening
    assert not session.is_closed
    release.set()
    await until(lambda: session.is_closed)
    await routing.close()


MARK = b"unauthorized"


def read(lines: list[bytes]) -> list[str]:
    """Return the lines accepted of `lines`, which arrive at once."""
    source, sink = os.pipe()
    taken: list[str] = []
    thread = threading.Thread(target=_read, args=(source, taken.append, (MARK,)))
    thread.start()
    with os.fdopen(sink, "wb") as pipe:
        pipe.write(b"".join(line + b"\n" for line in lines))
    thread.join(60)
    assert not thread.is_alive()
    return taken


def test_every_line_is_taken_where_there_are_few() -> None:
    assert read([b"one", b"two \xff", b""]) == ["one", "two \N{REPLACEMENT CHARACTER}", ""]


def test_of_too_many_lines_those_with_a_mark_are_taken_and_others_are_left_out() -> None:
    count = 20 * MOST_LINES
    taken = read([*[b"x"] * count, b"anna is unauthorized", *[b"x"] * count])
    assert "anna is unauthorized" in taken
    assert len(taken) < count
