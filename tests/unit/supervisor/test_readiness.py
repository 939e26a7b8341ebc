"""Resuming what was interrupted: a wrist that sends again, a supervisor that was killed."""

import asyncio
import itertools
from collections.abc import AsyncIterator

import pytest

from pointit.geometry.rotation import IDENTITY
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.host.state_file import StateFile
from pointit.runtime.service.service import Context
from pointit.schemas import ButtonEvent, Health, ImuSample, Interaction, Localization, UserPose
from pointit.schemas.topics import BUTTON, FEEDBACK, HEALTH, IMU, INTERACTION, LOCALIZATION, POSE
from pointit.services.supervisor import transitions
from pointit.services.supervisor.config import SupervisorConfig
from pointit.services.supervisor.life_cycle import LAST_WORD_PURPOSE, LifeCycle
from pointit.services.supervisor.service import Supervisor
from tests.support.bench import Bench, ManualClock, memory_bench, until
from tests.unit.supervisor.played import Gesture, S, life_cycle, news, pose, press, sample, shown, told

ANNA = "anna"


def before(state: str, now_s: float) -> Interaction:
    return Interaction.model_validate({"stamp_ns": round(now_s * S), "state": state})


def broken_off(resume_s: float = 30.0) -> LifeCycle:
    """Return a life cycle that pointed from 10 s on until the wrist was silent at 13 s."""
    cycle = life_cycle(resume_s=resume_s)
    cycle.begin(0)
    cycle.pose(*pose())
    cycle.button(*press(10))
    assert told(cycle.tick(13 * S)) == ["idle", "cue stopped"]
    return cycle


def test_a_wrist_that_is_heard_again_soon_goes_on() -> None:
    cycle = broken_off()
    outputs = cycle.imu(*sample(20))
    assert told(outputs) == ["pointing", "cue started"]
    assert shown(outputs).reason == transitions.RESUMED
    assert told(cycle.button(*press(21))) == ["idle", "cue stopped"]
    assert cycle.imu(*sample(22)) == []  # they have stopped themselves


def test_a_wrist_that_comes_back_late_or_says_old_things_waits_for_a_press() -> None:
    assert broken_off().imu(*sample(43.1)) == []
    assert broken_off().imu(*sample(20, late_s=8)) == []
    assert broken_off(resume_s=0.0).imu(*sample(13.1)) == []


@pytest.mark.parametrize("goes_on", [True, False])
def test_pointing_is_taken_up_where_the_localizer_is_the_same(*, goes_on: bool) -> None:
    cycle = life_cycle()
    cycle.resume_from(before("pointing", 50), 100 * S)
    cycle.begin(100 * S)
    cycle.localization(news(20 if goes_on else 99, "idle")[0], 100 * S)
    assert cycle.imu(*sample(100.1)) == []  # nobody knows where they stand
    cycle.pose(*pose(100.2))
    assert told(cycle.imu(*sample(100.3))) == (["pointing", "cue started"] if goes_on else [])


def test_localizing_is_taken_up_and_leads_to_pointing() -> None:
    cycle = life_cycle(localize=True)
    cycle.resume_from(before("localizing", 50), 51 * S)
    cycle.begin(51 * S)
    since = {"since_ns": 50 * S}
    outputs = cycle.localization(*news(51.2, "sampling", target_id="led_1", **since))
    assert told(outputs) == ["localizing", "cue target"]
    assert told(cycle.localization(*news(53, "solved", **since))) == [
        "cue localized",
        "pointing",
        "cue started",
    ]
    unseen = life_cycle(localize=True)
    unseen.resume_from(before("localizing", 50), 60 * S)
    unseen.localization(news(55, "solved", **since)[0], 60 * S)
    unseen.pose(*pose(55))
    assert told(unseen.imu(*sample(60.1))) == ["pointing", "cue started"]


@pytest.mark.parametrize("kept", [before("idle", 50), before("pointing", 200)])
def test_what_was_at_rest_or_of_another_time_is_not(kept: Interaction) -> None:
    cycle = life_cycle()
    cycle.resume_from(kept, 100 * S)
    cycle.pose(*pose(1))
    cycle.localization(news(2, "idle")[0], 100 * S)
    assert cycle.imu(*sample(100.1)) == []


def test_who_presses_first_decides() -> None:
    cycle = life_cycle()
    cycle.resume_from(before("pointing", 50), 100 * S)
    cycle.pose(*pose(1))
    assert told(cycle.button(*press(100))) == ["pointing", "cue started"]
    assert told(cycle.button(*press(101))) == ["idle", "cue stopped"]
    cycle.localization(news(2, "idle")[0], 102 * S)
    assert cycle.imu(*sample(102)) == []


class Site:
    """A supervisor that can be killed, a localizer that is played, and a wrist."""

    def __init__(self, bench: Bench, clock: ManualClock) -> None:
        self.bench = bench
        self.clock = clock
        self.interactions = bench.collect(INTERACTION, ANNA)
        self.cues = bench.collect(FEEDBACK, ANNA)
        self._localizer = Localization(stamp_ns=clock.now_ns(), phase="idle")
        bench.put(POSE, UserPose(stamp_ns=clock.now_ns(), position_m=(0, 0, 0), yaw_rad=0), ANNA)

    async def localizer(self, *, restarted: bool = False) -> int:
        """Tell of the localizer, or of another that has begun 2 s later; return the stamp."""
        if restarted:
            self._localizer = Localization(stamp_ns=self.clock.advance(2.0), phase="idle")
        self.bench.put(LOCALIZATION, self._localizer, ANNA)
        await self.bench.settle()
        return self._localizer.stamp_ns

    async def start(self) -> None:
        self._bus = ServiceBus(self.bench.bus, self.clock, "supervisor", "supervisor.anna", ANNA)
        service = Supervisor(SupervisorConfig(), Context(bus=self._bus, clock=self.clock, user=ANNA))
        self._running = asyncio.create_task(service.run())
        await self.bench.settle()

    async def stop(self) -> None:
        self._running.cancel()
        await asyncio.wait([self._running])
        await self._bus.close()

    async def point(self) -> None:
        await self.localizer()
        await self.start()
        self.clock.advance(1.0)
        self.bench.put(BUTTON, ButtonEvent(stamp_ns=self.clock.now_ns()), ANNA)
        await until(lambda: self.interactions[-1].state == "pointing")

    async def samples(self) -> None:
        self.clock.advance(0.1)
        self.bench.put(IMU, ImuSample(stamp_ns=self.clock.now_ns(), orientation_xyzw=IDENTITY), ANNA)
        await self.bench.settle()


@pytest.fixture
async def site() -> AsyncIterator[Site]:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        site = Site(bench, clock)
        yield site
        await site.stop()


def kept() -> Interaction | None:
    return StateFile(Interaction, ANNA, LAST_WORD_PURPOSE).read()


async def test_a_supervisor_killed_in_the_midst_of_pointing_needs_no_press(site: Site) -> None:
    await site.point()
    await until(lambda: (word := kept()) is not None and word.state == "pointing")
    await site.stop()
    site.clock.advance(2.0)
    await site.start()
    await site.samples()
    states = [state for state, _ in itertools.groupby(news.state for news in site.interactions)]
    assert states == ["idle", "pointing", "idle", "pointing"]
    assert site.cues[-1].cue == "started"
    await site.stop()
    await site.localizer(restarted=True)  # a different one resets the interaction
    await site.start()
    await site.samples()
    assert site.interactions[-1].state == "idle"


async def test_who_pointed_on_while_the_localizer_was_restarted_needs_no_press_either(site: Site) -> None:
    await site.point()
    restarted_ns = await site.localizer(restarted=True)
    await until(lambda: (word := kept()) is not None and word.stamp_ns == restarted_ns)
    assert site.interactions[-1].state == "pointing"
    await site.stop()
    site.clock.advance(2.0)
    await site.start()
    await site.samples()
    assert site.interactions[-1].reason == transitions.RESUMED


async def test_a_last_word_on_the_bus_counts_as_well(site: Site) -> None:
    """Another supervisor of theirs was there, and what it said last arrives late."""
    last = Interaction(stamp_ns=site.clock.advance(1.0), state="pointing")
    site.clock.advance(1.0)
    await site.start()
    site.bench.put(INTERACTION, last, ANNA)
    await site.bench.settle()
    await site.localizer()
    await site.samples()
    assert site.cues[-1].cue == "started"
    assert site.interactions[-1].reason == transitions.RESUMED


async def test_a_spoilt_last_word_is_a_warning() -> None:
    path = StateFile(Interaction, ANNA, LAST_WORD_PURPOSE).path
    path.parent.mkdir(parents=True)
    path.write_text("{", encoding="utf-8")
    async with memory_bench() as bench:
        reports: list[Health] = bench.collect(HEALTH)
        bench.start(Supervisor, user=ANNA)
        await until(lambda: bool(reports and reports[-1].warnings))
        assert "interaction.json: cannot be used" in reports[-1].warnings[0]
        await until(lambda: not reports[-1].warnings)  # the next one has taken its place


def eager(*, localize: bool = False) -> LifeCycle:
    cycle = life_cycle(localize=localize, autostart=True, retry_s=5.0)
    cycle.begin(0)
    return cycle


def test_without_a_button_a_sample_begins_as_soon_as_the_place_is_known() -> None:
    cycle = eager()
    assert cycle.imu(*sample(1)) == []  # neither a place nor a complaint
    assert shown(cycle.pose(*pose(2))).next_step == transitions.BY_ITSELF
    assert cycle.imu(*sample(20, late_s=10)) == []
    assert told(cycle.imu(*sample(20))) == ["pointing", "cue started"]
    assert cycle.imu(*sample(20.02)) == []


def test_samples_that_are_back_after_a_silence_begin_again() -> None:
    cycle = eager()
    cycle.pose(*pose())
    cycle.imu(*sample(1))
    outputs = cycle.tick(4 * S)
    assert told(outputs) == ["idle", "cue stopped"]
    assert shown(outputs).next_step == transitions.BY_ITSELF
    assert told(cycle.imu(*sample(4.1))) == ["pointing", "cue started"]


@pytest.mark.parametrize("gesture", ["press", "hold"])
def test_who_stopped_with_the_button_begins_with_the_button(gesture: Gesture) -> None:
    cycle = eager()
    cycle.pose(*pose())
    cycle.imu(*sample(1))
    outputs = cycle.button(*press(2, gesture))
    assert told(outputs) == ["idle", "cue stopped"]
    assert shown(outputs).next_step == transitions.PRESS
    assert cycle.imu(*sample(100)) == []
    assert told(cycle.button(*press(101))) == ["pointing", "cue started"]
    cycle.tick(200 * S)
    assert told(cycle.imu(*sample(201))) == ["pointing", "cue started"]


def test_an_anchor_while_waiting_does_not_keep_samples_from_beginning_afterwards() -> None:
    cycle = eager()
    cycle.pose(*pose())
    assert told(cycle.button(*press(1, "double"))) == ["anchor", "localizing", "cue started"]
    assert cycle.imu(*sample(2)) == []
    assert told(cycle.button(*press(3))) == ["cancel", "idle", "cue stopped"]
    assert told(cycle.imu(*sample(4))) == ["pointing", "cue started"]


def test_localizing_unasked_waits_for_the_place_and_after_a_failure() -> None:
    cycle = eager(localize=True)
    assert cycle.imu(*sample(0.5)) == []  # a place may be on its way
    assert told(cycle.imu(*sample(1.1))) == ["start", "localizing", "cue started"]
    outputs = cycle.on_start_failed(cycle.run, "there is no map yet", 2 * S)
    assert shown(outputs).next_step == transitions.BY_ITSELF_AT_LAMP
    assert cycle.imu(*sample(6.9)) == []
    assert told(cycle.imu(*sample(7.1)))[:2] == ["start", "localizing"]
    cycle.localization(*news(8, "refused"))
    assert cycle.imu(*sample(12.9)) == []
    assert told(cycle.imu(*sample(13.1)))[:2] == ["start", "localizing"]
    for now_s in range(14, 73):
        cycle.imu(*sample(now_s))
    cycle.imu(*sample(73))
    assert told(cycle.tick(round(73.2 * S))) == ["cancel", "idle", "cue refused"]
    assert cycle.imu(*sample(78)) == []
    assert told(cycle.imu(*sample(78.3)))[:2] == ["start", "localizing"]
    assert told(cycle.button(*press(80))) == ["cancel", "idle", "cue stopped"]
    assert cycle.imu(*sample(100)) == []
