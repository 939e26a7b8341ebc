"""A recording played on a site."""

import asyncio
from pathlib import Path

import pytest

import pointit.schemas as models
from pointit.recording.entries import Entry, entry
from pointit.recording.reader import Recording
from pointit.replay.playing import plan_replay, play_live
from pointit.replay.replayed_services import ReplayError
from pointit.runtime.bus.contract import AnyTopic
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.virtual_time import run_virtually
from pointit.schemas import topics
from pointit.schemas.catalogue.catalogue import example
from tests.support.buses import site_of
from tests.support.recorded import write_recording

RECORDING = Path(__file__).parents[2] / "replay" / "recordings" / "lamps.mcap"


class Ignored:
    def recorded(self, entry: Entry) -> None:
        pass

    def replayed(self, entry: Entry, *, is_recomputed: bool) -> None:
        pass


async def test_site_gets_messages_and_time_of_the_recording() -> None:
    samples: list[models.ImuSample] = []
    ticks: list[models.ClockTick] = []
    maps: list[models.Environment] = []
    async with site_of("zenoh-peer") as site:
        site.b.subscribe(topics.IMU, lambda sample, _user: samples.append(sample))
        site.b.subscribe(topics.CLOCK, lambda tick, _name: ticks.append(tick), queue_all=True)
        site.b.subscribe(topics.MAP, lambda room, _name: maps.append(room))
        await site.settle()
        with Recording.open(RECORDING) as recording:
            began_ns = recording.began_ns
            ended_ns = recording.ended_ns
            await play_live(plan_replay(recording, "edge"), site.a, Ignored(), 5.0)
        await site.settle()

    assert [room.name for room in maps] == ["lab"]
    assert samples
    assert all(began_ns <= sample.stamp_ns <= ended_ns for sample in samples)
    assert ticks
    assert ticks[0].speed == 5.0
    assert began_ns <= ticks[0].sim_ns < ended_ns


async def test_a_site_that_runs_the_same_services_is_refused() -> None:
    async with site_of("zenoh-peer") as site:
        site.b.announce(topics.SERVICE_ALIVE, "pui")
        await site.settle()
        with Recording.open(RECORDING) as recording:
            plan = plan_replay(recording, "edge")
            with pytest.raises(ReplayError, match=r"runs pui, as the recording does: end them"):
                await play_live(plan, site.a, Ignored(), 1.0)
    assert len(asyncio.all_tasks()) == 1


def recording_with_observers(path: Path) -> Path:
    """Write the first second of a recording of a site with a page, a recorder and a simulated person."""
    with Recording.open(RECORDING) as source:
        first_ns = source.began_ns
        entries = [each for each in source.entries() if each.time_ns < first_ns + models.NS_PER_S]
        began: list[Entry] = []
        for name in ("recorder", "web", "user-sim.anna"):
            said = models.Configuration(stamp_ns=first_ns, service=name, instance=name)
            began += [
                entry(first_ns, topics.CONFIGURATION, name, said),
                entry(first_ns, topics.SERVICE_ALIVE, name, True),
                entry(first_ns, topics.HEALTH, name, example(models.Health)),
            ]
        began.append(entry(first_ns, topics.DEPLOYMENT, "run.lab", example(models.Deployment)))
        return write_recording(path, (*began, *entries), first_ns)


class Compared(Ignored):
    def __init__(self) -> None:
        self.states: set[str] = set()

    def recorded(self, entry: Entry) -> None:
        self._add(entry)

    def replayed(self, entry: Entry, *, is_recomputed: bool) -> None:
        if is_recomputed:
            self._add(entry)

    def _add(self, entry: Entry) -> None:
        if isinstance(entry.row, topics.Topic) and entry.row.delivery is topics.Delivery.STATE:
            self.states.add(entry.key)


def test_skipped_messages_are_reported_and_initial_states_not_compared(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = recording_with_observers(tmp_path / "run.mcap")
    compared = Compared()
    keys = (
        models.KeyHealth(key="users/anna/imu", direction="in", rate_hz=50.0, dropped=4, lost=3),
        models.KeyHealth(key="users/anna/ray", direction="out", rate_hz=50.0, dropped=9),
    )

    async def play() -> None:
        exchange = LocalBroker()
        bus = MemoryBus(exchange)
        service = MemoryBus(exchange)
        asyncio.get_running_loop().call_later(
            0.9,
            lambda: service.publisher(topics.HEALTH, "pointing.anna").put(
                example(models.Health).model_copy(update={"keys": keys})
            ),
        )
        with Recording.open(path) as recording:
            await play_live(plan_replay(recording, "edge"), bus, compared, 1.0)
        await bus.close()
        await service.close()

    run_virtually(play())
    assert "services skipped 7 messages (users/anna/imu), as this machine is too slow" in caplog.text
    assert compared.states == set()


def subscribe(bus: MemoryBus, topic: AnyTopic, names: set[str]) -> None:
    bus.subscribe(topic, lambda _message, name: names.add(name))


def test_site_keeps_its_own_page_and_recorder(tmp_path: Path) -> None:
    path = recording_with_observers(tmp_path / "run.mcap")
    came: dict[str, set[str]] = {}

    async def play() -> None:
        exchange = LocalBroker()
        bus = MemoryBus(exchange)
        onlooker = MemoryBus(exchange)
        for topic in (topics.HEALTH, topics.CONFIGURATION, topics.DEPLOYMENT):
            subscribe(onlooker, topic, came.setdefault(topic.key, set()))
        announced = came.setdefault(topics.SERVICE_ALIVE.key, set())
        onlooker.announce(topics.SERVICE_ALIVE, "web")
        onlooker.watch(topics.SERVICE_ALIVE, lambda name, **_: announced.add(name))
        with Recording.open(path) as recording:
            await play_live(plan_replay(recording, "edge"), bus, Ignored(), 1.0)
        await bus.close()
        await onlooker.close()

    run_virtually(play())
    assert {"web", "recorder"} & came[topics.SERVICE_ALIVE.key] == {"web"}
    for key in (topics.SERVICE_ALIVE.key, topics.HEALTH.key, topics.CONFIGURATION.key):
        assert {"pui", "user-sim.anna"} <= came[key], key
    for key in (topics.HEALTH.key, topics.CONFIGURATION.key):
        assert not {"web", "recorder"} & came[key], key
    assert not came[topics.DEPLOYMENT.key]
