"""The keeper as a service: late subscribers, its file, a restart, disk errors."""

import asyncio
import functools
import time
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
import pytest_asyncio

from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.bus.timeliness import ClockSkewMonitor
from pointit.runtime.service.service import Launch, run_service
from pointit.schemas import Health, Message, Selection, UserProfile
from pointit.schemas.topics import HEALTH, PROFILE, SELECTION, SERVICE_ALIVE, USER_ALIVE, topic_of
from pointit.services.keeper.retained_states import FileConfig, KeeperConfig
from pointit.services.keeper.service import SETTLE_S, Keeper
from tests.support import strangers
from tests.support.bench import ManualClock, until

MODULE = """
from pointit.plugins import Config, Delivery, Service, ServicePlugin, Topic
from pointit.schemas import Selection

NOTE = Topic(
    key="noted/note", message=Selection, delivery=Delivery.STATE, rate_hz=None, writers=("noted",), about=""
)

class Noted(Service[Config]):
    NAME = "noted"
    SCOPE = "site"
    CONFIG = Config

NOTED = ServicePlugin(summary="", config=Config, make=Noted, writes=(NOTE,))
"""
QUICK = KeeperConfig(file=FileConfig(write_every_s=0.01))


@pytest.fixture(autouse=True)
def _at_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("pointit.services.keeper.service.SETTLE_S", 0.0)
    monkeypatch.setattr("pointit.services.keeper.service.EXPIRE_S", 0.01)
    monkeypatch.setenv("POINTIT_STATE", str(tmp_path))


class Room:
    def __init__(self) -> None:
        self.exchange = LocalBroker()
        self.bus = MemoryBus(self.exchange)
        self.clock = ManualClock()
        self._keeper: asyncio.Task[None] | None = None
        self._keepers_bus: MemoryBus | None = None

    async def start(self, config: KeeperConfig = QUICK) -> None:
        self._keepers_bus = MemoryBus(self.exchange)
        launch = Launch(service=Keeper, config=config)
        self._keeper = asyncio.create_task(run_service(launch, self._keepers_bus, self.clock))
        await until(lambda: bool(self.exchange.retained_servers))

    async def end(self) -> None:
        if self._keeper is not None and self._keepers_bus is not None:
            self._keeper.cancel()
            await asyncio.wait({self._keeper})
            await self._keepers_bus.close()
            self._keeper = None

    async def write(self, profile: UserProfile) -> None:
        """Publish Anna's profile as a writer that is gone afterwards."""
        writing = MemoryBus(self.exchange)
        writing.publisher(PROFILE, "anna").put(profile)
        await asyncio.sleep(0.01)
        await writing.close()

    def health(self) -> list[Health]:
        reports: list[Health] = []
        self.bus.subscribe(HEALTH, lambda message, _name: reports.append(message))
        return reports

    async def read(self) -> list[UserProfile]:
        seen: list[UserProfile] = []
        reading = MemoryBus(self.exchange)
        reading.subscribe(PROFILE, lambda message, _name: seen.append(message))
        for _ in range(5):
            await asyncio.sleep(0)
        await reading.close()
        return seen


@pytest_asyncio.fixture
async def room() -> AsyncIterator[Room]:
    made = Room()
    yield made
    await made.end()
    await made.bus.close()


async def test_late_subscriber_gets_states_of_services_of_other_packages(room: Room, tmp_path: Path) -> None:
    with strangers.installed(tmp_path, "strangers_states", MODULE, services="noted = strangers_states:NOTED"):
        await room.start()
        note = topic_of("noted/note")
        assert note is not None
        writing = MemoryBus(room.exchange)
        writing.publisher(note).put(Selection(stamp_ns=1, seq=7))
        held = writing.announce(SERVICE_ALIVE, "noted")
        await asyncio.sleep(0.01)
        held.close()
        await writing.close()
        seen: list[Message] = []
        room.bus.subscribe(note, lambda message, _name: seen.append(message))
        await until(lambda: bool(seen))
        assert seen == [Selection(stamp_ns=1, seq=7)]


async def test_late_subscriber_gets_the_state_of_a_killed_writer(room: Room) -> None:
    anna = room.bus.announce(USER_ALIVE, "anna")
    await room.start()
    await room.write(UserProfile(stamp_ns=1, seq=3))
    assert [profile.seq for profile in await room.read()] == [3]
    anna.close()
    await asyncio.sleep(0.01)
    assert await room.read() == [], "gone with the person"


async def test_restarted_keeper_loses_nothing_and_a_new_run_starts_empty(room: Room) -> None:
    room.bus.announce(USER_ALIVE, "anna")
    await room.start()
    await room.write(UserProfile(stamp_ns=1, seq=3))
    await room.end()
    assert await room.read() == []

    await room.start()
    assert [profile.seq for profile in await room.read()] == [3]
    await room.end()
    room.clock.advance(QUICK.file.restore_within_s + 1)
    await room.start()
    assert await room.read() == [], "too long ago"

    await room.end()
    room.clock.advance(-QUICK.file.restore_within_s)
    Keeper.discard_saved_state("memory", room.clock.now_ns())
    Keeper.discard_saved_state("memory", room.clock.now_ns())
    await room.start()
    assert await room.read() == []


@pytest.mark.parametrize("content", [b"", b"\xc1", b"\x80", b"\xff" * 1000])
async def test_damaged_file_is_a_warning_and_is_overwritten(
    room: Room, tmp_path: Path, content: bytes
) -> None:
    path = tmp_path / "memory" / "keeper" / "states.msgpack"
    path.parent.mkdir(parents=True)
    path.write_bytes(content)
    health = room.health()
    await room.start()
    await until(lambda: bool(health))
    assert any(str(path) in warning for warning in health[0].warnings)
    room.bus.publisher(SELECTION).put(Selection(stamp_ns=1, seq=7))
    await until(lambda: b"Selection" in path.read_bytes())


async def test_disk_error_does_not_stop_the_keeper(room: Room, tmp_path: Path) -> None:
    (tmp_path / "memory").write_text("a file where a folder should be", encoding="utf-8")
    await room.start()
    room.bus.publisher(SELECTION).put(Selection(stamp_ns=1, seq=7))
    await asyncio.sleep(0.05)
    health = room.health()
    await until(lambda: any("restart of the keeper" in warning for h in health for warning in h.warnings))


async def test_full_keeper_warns(room: Room) -> None:
    health = room.health()
    await room.start(KeeperConfig(max_values=1, file=FileConfig(enabled=False)))
    for name in ("anna", "ben"):
        room.bus.announce(USER_ALIVE, name)
    await asyncio.sleep(0.01)
    for name in ("anna", "ben"):
        room.bus.publisher(PROFILE, name).put(UserProfile(stamp_ns=1))
    await until(lambda: any("no room" in warning for h in health for warning in h.warnings))
    assert SETTLE_S > 0


async def test_skewed_clock_is_a_warning_until_it_is_right(
    room: Room, monkeypatch: pytest.MonkeyPatch
) -> None:
    quick = functools.partial(ClockSkewMonitor, window_s=3.0)
    monkeypatch.setattr("pointit.services.keeper.service.ClockSkewMonitor", quick)
    health: dict[str, Health] = {}
    room.bus.subscribe(HEALTH, lambda message, instance: health.update({instance: message}))
    await room.start()
    reports = room.bus.publisher(HEALTH, "pointing.anna")

    def report(ahead_s: float) -> None:
        stamp_ns = time.time_ns() + int(ahead_s * 1e9)
        reports.put(
            Health(stamp_ns=stamp_ns, service="pointing", instance="pointing.anna", pid=1, host="watch")
        )

    for _ in range(3):
        report(1.5)
        await asyncio.sleep(0.01)
    await until(lambda: any("machine watch is 1.5 s ahead" in w for w in health["keeper"].warnings))
    assert "refused" in health["keeper"].warnings[0]

    def is_right() -> bool:
        report(0.0)
        return not health["keeper"].warnings

    await until(is_right)
