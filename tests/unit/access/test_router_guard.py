"""Guard of a router in virtual time: a log comes in, connections are cut or held, which is logged once."""

import asyncio
import contextlib
import logging
from collections import Counter
from collections.abc import AsyncGenerator, Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass

import pytest

from pointit.access.connection_traffic import FULL_S
from pointit.access.identity_load import HOLD_S, MAX_HZ, QUIET_S
from pointit.access.router_guard import LOOK_S, LoggedOnce, RouterGuard
from pointit.schemas.problems import DENIED, EXCESS, Problem

HEAD = (
    "\x1b[2m2030-01-01T00:00:00.000000Z\x1b[0m \x1b[35mTRACE\x1b[0m  rx-0 ThreadId(07) "
    "\x1b[2mzenoh::net::routing::interceptor::access_control\x1b[0m\x1b[2m:\x1b[0m "
)
ADDRESSES = {"aa": "tls/10.0.0.7:40000", "ab": "tls/10.0.0.7:40001", "be": "tls/10.0.0.7:40002"}
COMMON_NAMES = {"aa": "lab/anna/1", "ab": "lab/anna/1", "be": "lab/ben/1"}
FLOOD_HZ = 3 * MAX_HZ


@dataclass(frozen=True, kw_only=True)
class StubCounters:
    received_bytes: int = 0
    received_segments: int = 0
    is_peer_full: bool = False


class StubRouter:
    """A router with three connections, whose common names only the log has if there are passwords."""

    def __init__(self, *, has_passwords: bool) -> None:
        self.has_passwords = has_passwords
        self.is_held: Callable[[str], bool] = lambda _: False
        self.roles = {"lab/anna": "user", "lab/ben": "user"}
        self.former: frozenset[str] = frozenset()
        self.times_opened = 1
        self.has_counters = True
        self.sockets: dict[str, StubCounters] = {}
        self.cuts: list[str] = []
        self.holds: set[str] = set()
        self.problems: Sequence[Problem] = ()

    async def open(self) -> None:
        pass

    async def close(self) -> None:
        pass

    async def reload_on_change(self) -> None:
        await asyncio.Event().wait()

    def links(self) -> list[tuple[str, str, str]]:
        names = dict.fromkeys(COMMON_NAMES, "") if self.has_passwords else COMMON_NAMES
        return [(session, names[session], address) for session, address in ADDRESSES.items()]

    def counters(self) -> Mapping[str, StubCounters]:
        return self.sockets

    def pop_new_connections(self) -> Counter[str]:
        return Counter()

    def cut(self, addresses: Iterable[str]) -> None:
        self.cuts += addresses

    def hold(self, addresses: Iterable[str]) -> None:
        self.holds |= set(addresses)

    def report(
        self, of_site: Callable[[str], Sequence[Problem]], refused: int, sessions: Mapping[str, int]
    ) -> None:
        del refused, sessions
        self.problems = of_site("lab")


class GuardedSite:
    """A guard that runs, and the log that it reads."""

    def __init__(self, router: StubRouter) -> None:
        self.router = router
        self._take: Callable[[str, int], None] = lambda _line, _times: None

    @contextlib.contextmanager
    def capture_log(self, _filter: str, take: Callable[[str, int], None], *_: object) -> Generator[None]:
        self._take = take
        yield

    def write(self, session: str, count: int) -> None:
        who = f"{session} on Interface(lo)+Username({COMMON_NAMES[session]})+Transport(Tls)+{session}"
        line = f"{HEAD}{who} is authorized to Put (ingress) on pointit/lab/users/x/cursor"
        for _ in range(count):
            self._take(line, 0)

    async def write_for(self, duration_s: float, rates_hz: Mapping[str, float]) -> None:
        for _ in range(round(duration_s / LOOK_S)):
            for session, rate_hz in rates_hz.items():
                self.write(session, round(rate_hz * LOOK_S))
            await asyncio.sleep(LOOK_S)


@contextlib.asynccontextmanager
async def guarded(*, has_passwords: bool = False) -> AsyncGenerator[GuardedSite]:
    site = GuardedSite(StubRouter(has_passwords=has_passwords))
    guard = RouterGuard(site.router)
    async with guard.opened(site.capture_log):
        running = asyncio.create_task(guard.run(), name="guard")
        try:
            yield site
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)


async def receive_for(
    site: GuardedSite, duration_s: float, session: str, *, bytes_hz: float, hz: float
) -> None:
    """Let a connection send bytes and segments of which the log has nothing."""
    address = ADDRESSES[session]
    for _ in range(round(duration_s / LOOK_S)):
        counters = site.router.sockets.get(address, StubCounters())
        site.router.sockets[address] = StubCounters(
            received_bytes=counters.received_bytes + round(bytes_hz * LOOK_S),
            received_segments=counters.received_segments + round(hz * LOOK_S),
        )
        await asyncio.sleep(LOOK_S)


@pytest.mark.parametrize(
    ("bytes_hz", "hz"),
    [(1_000_000.0, 5700.0), (2_000_000.0, 40.0), (50_000_000.0, 1000.0)],
    ids=["interests as measured", "the same in large segments", "messages of a megabyte"],
)
async def test_flood_that_no_log_has_is_cut_off_within_5_s(bytes_hz: float, hz: float) -> None:
    async with guarded() as site:
        await receive_for(site, 5.0, "aa", bytes_hz=bytes_hz, hz=hz)
        assert ADDRESSES["aa"] in site.router.cuts
        assert site.router.is_held("lab/anna/1")
        assert not site.router.is_held("lab/ben/1")
        assert any("lab/anna has written or asked" in problem.sentence for problem in site.router.problems)


async def test_revoked_identity_is_cut_off_for_less() -> None:
    async with guarded() as site:
        site.router.former = frozenset({"lab/anna/1"})
        site.router.roles = {"lab/ben": "user"}
        await receive_for(site, 1.5, "aa", bytes_hz=300_000.0, hz=2500.0)
        assert ADDRESSES["aa"] in site.router.cuts


async def test_bytes_of_messages_in_the_log_are_no_flood() -> None:
    """A person whose messages have 300 bytes, and one who begins with a megabyte."""
    async with guarded() as site:
        site.router.sockets[ADDRESSES["be"]] = StubCounters(received_bytes=1_048_576, received_segments=800)
        for _ in range(round(20.0 / LOOK_S)):
            site.write("aa", round(450 * LOOK_S))
            await receive_for(site, LOOK_S, "aa", bytes_hz=135_000.0, hz=450.0)
        assert not site.router.cuts


async def test_client_that_does_not_read_is_closed_and_named(caplog: pytest.LogCaptureFixture) -> None:
    async with guarded() as site:
        site.router.sockets[ADDRESSES["aa"]] = StubCounters(is_peer_full=True)
        await asyncio.sleep(FULL_S / 2)
        assert not site.router.cuts
        await asyncio.sleep(FULL_S)
        assert site.router.cuts == [ADDRESSES["aa"]] * len(site.router.cuts) != []
        site.router.sockets.clear()
        await asyncio.sleep(2.0)
    assert "lab/anna does not read what it is sent" in caplog.text


async def test_doctor_shows_that_a_system_does_not_count() -> None:
    async with guarded() as site:
        site.router.has_counters = False
        await asyncio.sleep(2.0)
        (problem,) = site.router.problems
    assert problem.severity == "note"
    assert "of bytes, are not seen" in problem.sentence


@pytest.mark.parametrize("has_passwords", [False, True])
async def test_flood_by_two_connections_is_cut_off_and_told_once(
    caplog: pytest.LogCaptureFixture, *, has_passwords: bool
) -> None:
    caplog.set_level(logging.WARNING)
    async with guarded(has_passwords=has_passwords) as site:
        await site.write_for(5.0, {"aa": FLOOD_HZ / 2, "ab": FLOOD_HZ / 2, "be": 100.0})
        assert site.router.cuts == [ADDRESSES["aa"], ADDRESSES["ab"]]
        assert EXCESS in {problem.code for problem in site.router.problems}
        assert site.router.is_held("lab/anna/1")
        assert not site.router.is_held("lab/ben/1")
        assert site.router.holds == {ADDRESSES["aa"], ADDRESSES["ab"]}
        await asyncio.sleep(HOLD_S + QUIET_S + 5.0)
    said = [record.getMessage() for record in caplog.records]
    assert sum("is cut off for 30 s" in text for text in said) == 1
    assert sum("the flood of lab/anna has ended: " in text for text in said) == 1
    assert not any("lab/ben" in text for text in said)


async def test_connections_are_held_as_soon_as_the_log_names_them() -> None:
    async with guarded(has_passwords=True) as site:
        await site.write_for(3.0, {"aa": FLOOD_HZ})
        site.router.holds.clear()
        site.write("ab", 1)
        await asyncio.sleep(0.0)
        assert ADDRESSES["ab"] in site.router.holds


def test_lasting_excess_is_logged_once_and_again_after_quiet() -> None:
    logged = LoggedOnce()
    counted = [
        {DENIED: {"lab/anna": f"lab/anna may not write x ({count} times): refused"}} for count in (5, 7)
    ]
    assert len(logged.new_sentences(counted[0], 0.0)) == 1
    assert logged.new_sentences(counted[1], 1.0) == []
    assert logged.new_sentences({}, 20.0) == []
    assert logged.new_sentences(counted[0], 21.0) == []
    another = {DENIED: {"lab/anna2": counted[0][DENIED]["lab/anna"]}}
    assert len(logged.new_sentences(another, 22.0)) == 1
    assert len(logged.new_sentences(counted[0], 22.0 + QUIET_S)) == 1
