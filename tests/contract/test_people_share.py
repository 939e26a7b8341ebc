"""Shares of people on every kind of bus: one default instance, and shards that come and go."""

import asyncio
from collections.abc import AsyncIterator, Callable
from types import SimpleNamespace

import pytest
import pytest_asyncio

from pointit.runtime.bus.contract import Bus, Publisher
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.errors import ConfigError, NoAnswerError, RefusedError
from pointit.runtime.service import people_share
from pointit.runtime.service.instance_takeover import LISTEN_S
from pointit.runtime.service.people_share import PeopleShare
from pointit.schemas import ClearSelection, Done, ImuSample
from pointit.schemas.topics import BUTTON, CLEAR_SELECTION, IMU, PROFILE, SHARD_ALIVE, USER_ALIVE
from tests.support.bench import ManualClock, until
from tests.support.buses import Site
from tests.support.sinks import Sink, imu, press, profile


class Instance:
    """An instance of a service `pui` on a bus, and what it hears."""

    def __init__(self, bus: Bus, name: str = "", people: tuple[str, ...] = ()) -> None:
        self.instance = f"pui.{name}" if name else "pui"
        self.bus = ServiceBus(bus, ManualClock(), "pui", self.instance)
        self.lost: list[str] = []
        self.share = PeopleShare(self.bus, "pui", people, name=name, lost=self.lost.append)
        self.imu = Sink()
        self.profile = Sink()
        self.button = Sink()
        self.share.subscribe(IMU, self.imu)
        self.share.subscribe(PROFILE, self.profile)
        self.share.subscribe(BUTTON, self.button)
        self.share.serve(CLEAR_SELECTION, self._clear)

    async def _clear(self, _query: ClearSelection, user: str) -> Done:
        return Done(message=f"{self.instance} {user}")

    @property
    def figures(self) -> dict[str, float]:
        return {figure.name: figure.value for figure in self.bus.report().figures}

    @property
    def inputs(self) -> dict[str, float]:
        return {key.key: key.rate_hz for key in self.bus.report().keys if key.direction == "in"}


async def flows(writer: Publisher[ImuSample], user: str, sink: Sink) -> None:
    """Publish for `user` until the reader hears it."""
    before = len(sink.of(user))
    seq = 0
    while len(sink.of(user)) == before:
        writer.put(imu(seq := seq + 1))
        await asyncio.sleep(0.005)


async def served_by(bus: Bus, user: str) -> str:
    try:
        return (await bus.call(CLEAR_SELECTION, ClearSelection(), user)).message
    except (NoAnswerError, RefusedError):
        return ""


async def until_served_by(bus: Bus, user: str, server: str) -> None:
    while await served_by(bus, user) != f"{server} {user}":  # noqa: ASYNC110 - a question, not a flag
        await asyncio.sleep(0.01)


@pytest_asyncio.fixture
async def three(site: Site) -> AsyncIterator[SimpleNamespace]:
    """The default instance at `a`; `b` for a shard; at `c` the wrists of anna and ben."""
    default = Instance(site.a)
    tokens = [site.c.announce(USER_ALIVE, user) for user in ("anna", "ben")]
    await site.settle()
    yield SimpleNamespace(
        site=site,
        default=default,
        tokens=tokens,
        wrists={user: site.c.publisher(IMU, user) for user in ("anna", "ben", "carl")},
        profiles={user: site.c.publisher(PROFILE, user) for user in ("anna", "ben")},
        buttons={user: site.c.publisher(BUTTON, user) for user in ("anna", "ben")},
    )


async def start_shard(three: SimpleNamespace, people: tuple[str, ...] = ("anna",)) -> Instance:
    shard = Instance(three.site.b, "hall", people)
    await shard.share.announce()
    await until(lambda: set(three.default.lost) >= set(people))
    await three.site.settle()
    return shard


class TestPeopleShare:
    async def test_default_instance_has_one_subscription_without_shards(
        self, three: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        names: list[str] = []
        real = three.site.a.subscribe

        def subscribe(topic: object, handler: object, name: str = "*", **options: object) -> object:
            names.append(name)
            return real(topic, handler, name, **options)

        monkeypatch.setattr(three.site.a, "subscribe", subscribe)
        other = Instance(three.site.a)
        await three.site.settle()
        assert names == ["*"] * 3
        for user in ("anna", "ben", "carl"):  # carl is not even present
            await flows(three.wrists[user], user, other.imu)

    async def test_a_shard_serves_its_people_the_default_all_others(self, three: SimpleNamespace) -> None:
        shard = await start_shard(three)
        before = len(three.default.imu.of("anna"))
        await flows(three.wrists["anna"], "anna", shard.imu)
        await flows(three.wrists["ben"], "ben", three.default.imu)
        await three.site.settle()
        assert len(three.default.imu.of("anna")) == before
        assert not shard.imu.of("ben")
        assert three.default.share.serves("ben")
        assert not three.default.share.serves("anna")
        assert (shard.share.serves("anna"), shard.share.serves("ben")) == (True, False)
        await until_served_by(three.site.c, "anna", "pui.hall")
        await until_served_by(three.site.c, "ben", "pui")

    async def test_samples_of_a_shards_person_stay_from_the_default(self, three: SimpleNamespace) -> None:
        shard = await start_shard(three)
        await flows(three.wrists["anna"], "anna", shard.imu)
        three.default.bus.report()
        await flows(three.wrists["anna"], "anna", shard.imu)
        assert three.default.inputs[IMU.key] == 0.0

    async def test_the_default_takes_over_with_the_newest_states(self, three: SimpleNamespace) -> None:
        three.profiles["ben"].put(profile(1))
        three.profiles["anna"].put(profile(2))
        await until(lambda: len(three.default.profile.seen) == 2)

        shard = await start_shard(three)
        await until(lambda: shard.profile.seen == [("anna", 2)])
        three.profiles["anna"].put(profile(3))
        await until(lambda: shard.profile.of("anna") == [2, 3])

        await three.site.settle()
        assert three.default.profile.of("anna") == [2]
        await shard.bus.close()
        await until(lambda: three.default.profile.of("anna") == [2, 3])
        assert three.default.profile.of("ben") == [1]
        assert three.default.share.serves("anna")

        await flows(three.wrists["anna"], "anna", three.default.imu)
        await flows(three.wrists["carl"], "carl", three.default.imu)  # all again
        await until_served_by(three.site.c, "anna", "pui")

    async def test_no_event_is_lost_while_shards_come_and_go(self, three: SimpleNamespace) -> None:
        seqs = iter(range(1, 10_000))
        sent: list[int] = []

        async def press_on() -> None:
            while True:
                sent.append(next(seqs))
                three.buttons["ben"].put(press(sent[-1]))
                await asyncio.sleep(0.002)

        three.buttons["ben"].put(press(0))
        await until(lambda: bool(three.default.button.seen))
        pressing = asyncio.create_task(press_on())
        for _ in range(2):
            three.default.lost.clear()
            shard = await start_shard(three)
            await shard.bus.close()
            await until(lambda: three.default.share.serves("anna"))
        pressing.cancel()
        await until(lambda: len(three.default.button.seen) > len(sent))
        assert three.default.button.of("ben") == [0, *sent]

    async def test_event_from_before_a_shard_is_not_replayed_to_it(self, three: SimpleNamespace) -> None:
        three.buttons["anna"].put(press(1))
        await until(lambda: three.default.button.of("anna") == [1])
        shard = await start_shard(three)
        three.buttons["anna"].put(press(2))
        await until(lambda: shard.button.of("anna") == [2])
        await three.site.settle()
        assert three.default.button.of("anna") == [1]

    async def test_people_are_known_by_presence_and_by_states(self, three: SimpleNamespace) -> None:
        await start_shard(three)
        later = three.site.c.announce(USER_ALIVE, "carl")
        await flows(three.wrists["carl"], "carl", three.default.imu)
        later.close()
        tracked = three.site.c.publisher(PROFILE, "dora")  # of a foreign tracker, say
        tracked.put(profile(1))
        await flows(three.site.c.publisher(IMU, "dora"), "dora", three.default.imu)

    async def test_user_without_presence_is_read_until_silent(
        self, three: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        default = three.default
        wrists = three.wrists
        timers: list[Callable[[], None]] = []

        def call_later(_delay_s: float, callback: Callable[[], None]) -> None:
            timers.append(callback)

        monkeypatch.setattr(default.bus, "call_later", call_later)
        await flows(wrists["carl"], "carl", default.imu)  # never present
        await start_shard(three)
        await flows(wrists["carl"], "carl", default.imu)
        three.tokens[1].close()  # ben's services outlive their presence
        await until(lambda: len(timers) == 2)

        await flows(wrists["ben"], "ben", default.imu)
        assert default.figures == {"people heard": 2.0, "people of shards": 1.0}
        pending = [*timers]
        timers[:] = []
        for timer in pending:
            timer()
        assert len(timers) == 2, "both were heard in the meantime"
        assert default.figures["people heard"] == 2.0

        monkeypatch.setattr(people_share, "FORGET_S", 0.0)
        three.site.c.announce(USER_ALIVE, "ben")
        three.site.c.announce(USER_ALIVE, "dora")  # known after ben's return
        await until(lambda: default.figures["people heard"] == 3.0)

        for timer in timers[:2]:
            timer()
        assert len(timers) == 2
        assert default.figures["people heard"] == 2.0, "ben stays, since he is present"

    async def test_shards_of_other_services_change_nothing(self, three: SimpleNamespace) -> None:
        for name in ("selector.anna", "pui", "pui.run.1", "puis.anna"):
            three.site.c.announce(SHARD_ALIVE, name)
        await three.site.settle()
        assert three.default.share.serves("anna")
        await flows(three.wrists["carl"], "carl", three.default.imu)
        assert three.default.lost == []

    async def test_two_shards_of_one_person_warn(
        self, three: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(people_share, "SILENT_S", 0.2)
        first = await start_shard(three)
        second = Instance(three.site.c, "yard", ("anna", "ben"))
        await second.share.announce()
        assert second.bus.report().warnings == (
            "another shard of pui serves anna, too: end both, and start one again",
        )
        assert first.bus.report().status == "ok"

    async def test_a_shard_waits_for_the_end_of_a_dead_one(self, three: SimpleNamespace) -> None:
        dead = three.site.c.announce(SHARD_ALIVE, "pui.anna")
        await until(lambda: not three.default.share.serves("anna"))
        shard = Instance(three.site.b, "hall", ("anna",))
        beginning = asyncio.create_task(shard.share.announce())
        asyncio.get_running_loop().call_later(LISTEN_S + 0.3, dead.close)
        await beginning
        assert shard.bus.report().status == "ok"
        await until(lambda: not three.default.share.serves("anna"))


@pytest.mark.parametrize(
    ("name", "people", "message"),
    [
        ("hall", (), "people: name whom pui.hall serves"),
        ("", ("anna",), "start pui.NAME"),
        ("hall", ("anna", "anna"), "each once"),
        ("hall", ("an na",), "letters, digits"),
        ("hall", ("run.1",), "those of runs"),
        ("hall", ("a" * 63,), "1 to 64"),
    ],
)
async def test_people_that_cannot_be_served(
    name: str, people: tuple[str, ...], message: str, site: Site
) -> None:
    with pytest.raises(ConfigError, match=message):
        Instance(site.a, name, people)
