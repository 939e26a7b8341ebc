"""A router that is given up while it opens."""

import asyncio
import os
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from pointit.runtime import router, router_log
from pointit.runtime.router import Router
from pointit.runtime.router_log import TIME_BYTES, _read
from tests.support.bench import until

pytestmark = pytest.mark.wall_time
PATIENCE_S = 20.0


class Session:
    def __init__(self) -> None:
        self.is_closed = False

    def close(self) -> None:
        self.is_closed = True


def test_router_looks_for_no_sockets_without_connections(monkeypatch: pytest.MonkeyPatch) -> None:
    """To find them, all that this process has open is looked at, in the loop."""
    cut: list[set[tuple[str, int]]] = []
    monkeypatch.setattr(router, "cut", cut.append)
    routing = Router(lambda: "{}", Path(), [])
    by_quic = "quic/10.0.0.8:40000"
    by_tls = "tls/10.0.0.7:40000"
    for addresses in ([], [by_quic]):
        routing.cut(addresses)
    assert cut == []
    routing.cut([by_quic, by_tls])
    assert cut == [{("10.0.0.7", 40_000)}]


async def test_a_session_that_opens_after_cancellation_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    begun = threading.Event()
    release = threading.Event()
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
LIMIT = 1000
"""Value of `MAX_LINES` here: with the real one, 400 000 lines would be needed."""


Lines = list[tuple[str, int]]


def read(lines: list[bytes], is_ignored: Callable[[bytes], bool] | None = None) -> Lines:
    """Return the lines accepted of `lines`, which arrive within one second, and their numbers."""
    source, sink = os.pipe()
    taken: Lines = []

    def take(line: str, times: int) -> None:
        taken.append((line, times))

    thread = threading.Thread(target=_read, args=(source, take, (MARK,), is_ignored))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(router_log, "time", SimpleNamespace(monotonic=float))  # however slow this machine is
        patch.setattr(router_log, "MAX_LINES", LIMIT)
        thread.start()
        with os.fdopen(sink, "wb") as pipe:
            pipe.write(b"".join(line + b"\n" for line in lines))
        thread.join(60)
    assert not thread.is_alive()
    return taken


def line(text: bytes, second: int = 0) -> bytes:
    return b"\x1b[2m2026-11-26T21:08:%02d.476835Z\x1b[0m \x1b[35mTRACE\x1b[0m %s" % (second, text)


def number_of(text: str, taken: Lines) -> int:
    return sum(max(times, 1) for each, times in taken if each.startswith("\x1b") and each.endswith(text))


def test_every_line_is_taken_where_there_are_few() -> None:
    assert read([b"one", b"two \xff", b""]) == [("one", 0), ("two \N{REPLACEMENT CHARACTER}", 0), ("", 0)]


def test_repeated_lines_beyond_the_limit_are_counted_but_rarely_passed() -> None:
    count = 20 * LIMIT
    taken = read([line(b"anna" if at % 4 else b"ben", at % 60) for at in range(count)])
    assert number_of("ben", taken) == count / 4
    assert number_of("anna", taken) == 3 * count / 4
    assert len(taken) < count / 2


def test_marked_lines_have_precedence_in_a_flood_of_different_lines() -> None:
    count = 20 * LIMIT
    taken = read([*(line(b"x%d" % at) for at in range(count)), line(b"anna is unauthorized")])
    assert number_of("anna is unauthorized", taken) == 1
    assert len(taken) < count / 2


def test_ignored_lines_are_neither_taken_nor_counted() -> None:
    few = [line(b"anna")] * 10
    many = [line(b"rule %d" % at) for at in range(20 * LIMIT)]
    taken = read([*many, *few], lambda text: b"rule" in text)
    assert [each for each, _ in taken] == [line(b"anna").decode()] * 10


def test_key_with_a_line_break_forges_no_line_of_zenoh() -> None:
    """It has as many characters before the forged text as Zenoh's time has."""
    forged = b"x" * TIME_BYTES + b"ben is unauthorized"
    taken = read([*[line(b"x")] * LIMIT, *[forged] * 3])
    assert number_of("ben is unauthorized", taken) == 0
