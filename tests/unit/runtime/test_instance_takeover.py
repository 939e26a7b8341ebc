"""Ownership of names: a reporting instance keeps it, a silent one loses it, of two exactly one goes on."""

import asyncio
import os
import socket

import pytest

from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.errors import ConfigError
from pointit.runtime.service import instance_takeover
from pointit.runtime.service.instance_takeover import TakeoverMonitor, claim_names
from pointit.schemas import NS_PER_S, Health
from pointit.schemas.topics import HEALTH, USER_ALIVE
from tests.support.bench import until

NOW_NS = 1_700_000_000 * NS_PER_S
ME = (socket.gethostname(), os.getpid())


def report(pid: int, uptime_s: float, *, host: str = "elsewhere", stamp_ns: int = NOW_NS) -> Health:
    return Health(
        stamp_ns=stamp_ns,
        service="pointing",
        instance="pointing.anna",
        user="anna",
        pid=pid,
        host=host,
        uptime_s=uptime_s,
    )


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(instance_takeover, "LISTEN_S", 0.01)
    monkeypatch.setattr(instance_takeover, "SILENT_S", 20.0)
    monkeypatch.setattr(instance_takeover, "LOG_AFTER_S", 0.05)


async def reported(bus: MemoryBus, claiming: asyncio.Task[None]) -> None:
    while not claiming.done():
        bus.publisher(HEALTH, "pointing.anna").put(report(17, 5.0))
        await asyncio.sleep(0.01)


class TestClaim:
    async def test_a_free_name_is_had_at_once(self, bus: MemoryBus, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(instance_takeover, "SILENT_S", 600.0)
        bus.announce(USER_ALIVE, "ben")
        async with asyncio.timeout(60.0):
            await claim_names(bus, USER_ALIVE, {"anna"})
            await claim_names(bus, USER_ALIVE, ())

    async def test_a_reporting_instance_keeps_the_name(self, bus: MemoryBus) -> None:
        bus.announce(USER_ALIVE, "anna")
        claiming = asyncio.create_task(claim_names(bus, USER_ALIVE, {"anna", "ben"}))
        await reported(bus, claiming)
        with pytest.raises(
            ConfigError, match=r"^anna: already on site memory; choose another name.*process 17 on elsewhere$"
        ):
            await claiming

    async def test_an_instance_that_leaves_frees_the_name(
        self, bus: MemoryBus, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(instance_takeover, "SILENT_S", 600.0)
        token = bus.announce(USER_ALIVE, "anna")
        claiming = asyncio.create_task(claim_names(bus, USER_ALIVE, {"anna"}))
        await asyncio.sleep(0.05)
        token.close()
        async with asyncio.timeout(60.0):
            await claiming

    async def test_silent_instance_loses_the_name_and_the_wait_is_logged(
        self, bus: MemoryBus, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(instance_takeover, "SILENT_S", 0.2)
        caplog.set_level("INFO")
        bus.announce(USER_ALIVE, "anna")
        bus.publisher(HEALTH, "pointing.ben").put(report(17, 5.0).model_copy(update={"user": "ben"}))
        await claim_names(bus, USER_ALIVE, {"anna"})
        assert "waiting" in caplog.text
        assert "its name is taken over" in caplog.text


class TestSuccession:
    @pytest.mark.parametrize(("uptime_s", "is_lost"), [(0.0, True), (30.0, False)])
    async def test_the_instance_that_started_last_wins(
        self,
        bus: MemoryBus,
        uptime_s: float,
        is_lost: bool,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        at = TakeoverMonitor(bus, "pointing.anna", lambda: NOW_NS)
        await asyncio.sleep(0.01)
        bus.publisher(HEALTH, "pointing.anna").put(report(17, uptime_s))
        await until(lambda: bool(at.duplicate_instance_warning()))
        assert at.superseded.is_set() is is_lost
        assert "process 17 on elsewhere" in at.duplicate_instance_warning()
        monkeypatch.setattr(instance_takeover, "SILENT_S", 0.01)
        await until(lambda: not at.duplicate_instance_warning(), what="not heard any more")
        at.close()

    @pytest.mark.parametrize("late_s", [0.0, 2.0, 20.0])
    @pytest.mark.parametrize("older", ["a", "b"])
    async def test_one_of_two_instances_ends_at_any_delay(
        self, bus: MemoryBus, older: str, late_s: float
    ) -> None:
        """One began 101 s ago, the other 100 s; each hears what the other has said `late_s` ago."""
        ages_s = {"a": 101.0, "b": 100.0} if older == "a" else {"a": 100.0, "b": 101.0}
        lost: list[str] = []
        for me, other in (("a", "b"), ("b", "a")):
            at = TakeoverMonitor(bus, f"pointing.{me}", lambda: NOW_NS)
            at._me = (me, 1)
            at._began_s -= ages_s[me]
            stamp_ns = NOW_NS - int(late_s * NS_PER_S)
            news = report(1, ages_s[other] - late_s, host=other, stamp_ns=stamp_ns)
            bus.publisher(HEALTH, f"pointing.{me}").put(news)
            await until(lambda at=at: bool(at.duplicate))
            if at.superseded.is_set():
                lost.append(me)
        assert lost == [older]

    async def test_own_reports_are_no_rival(self, bus: MemoryBus) -> None:
        at = TakeoverMonitor(bus, "pointing.anna", lambda: NOW_NS)
        bus.publisher(HEALTH, "pointing.anna").put(report(ME[1], 0.0, host=ME[0]))
        bus.publisher(HEALTH, "pointing.ben").put(report(17, 0.0))
        await asyncio.sleep(0.02)
        assert not at.duplicate_instance_warning()
        assert not at.superseded.is_set()
        at.close()
