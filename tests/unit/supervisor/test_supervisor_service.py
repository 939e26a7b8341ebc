"""The supervisor on the bus, and what it waits for."""

import asyncio
import itertools
import shutil
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from pointit.geometry.rotation import IDENTITY
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.errors import RefusedError
from pointit.runtime.host.state_file import StateFile
from pointit.runtime.service.service import Context
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import (
    Done,
    Health,
    ImuSample,
    Interaction,
    Localization,
    PointAnchor,
    PointingOffset,
    Say,
    SetOffset,
    topics,
)
from pointit.services.registry import process
from pointit.services.supervisor import transitions
from pointit.services.supervisor.config import SupervisorConfig
from pointit.services.supervisor.life_cycle import LAST_WORD_PURPOSE, LifeCycle
from pointit.services.supervisor.service import Supervisor
from pointit.services.user_sim.goal import PerceivedState
from tests.support.bench import Bench, ManualClock, memory_bench, until
from tests.unit.supervisor.played import Gesture, S, life_cycle, news, pose, press, sample, shown, told

ANNA = "anna"
OFFSET = PointingOffset(rung="pitch", elevation=(0.05, 0.0, 0.0, 0.0, 0.0, 0.0), sigma_rad=0.02, anchors=3)


class Person:
    """Anna, what her supervisor says, and what her localizer, which the test plays, was asked."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.interactions = bench.collect(topics.INTERACTION, ANNA)
        self.cues = bench.collect(topics.FEEDBACK, ANNA)
        self.profiles = bench.collect(topics.PROFILE, ANNA)
        self.reports: list[Health] = bench.collect(topics.HEALTH)
        self.asked: list[str] = []
        self._presses = 0

    @property
    def states(self) -> list[str]:
        return [interaction.state for interaction in self.interactions]

    async def start(self, **fields: Any) -> None:
        self.bench.start(Supervisor, SupervisorConfig.model_validate(fields), user=ANNA)
        await self.bench.settle()

    def has_localizer(self, refusal: str = "", answer: asyncio.Event | None = None) -> None:
        async def start(query: Any, _user: str) -> Done:
            self.asked.append(f"start {getattr(query, 'method', None) or ''}".strip())
            if answer is not None:
                await answer.wait()
            if refusal:
                raise RefusedError(refusal)
            return Done()

        async def cancel(_query: object, _user: str) -> Done:
            self.asked.append("cancel")
            return Done()

        self.bench.bus.serve(topics.START_LOCALIZATION, start, ANNA)
        self.bench.bus.serve(topics.CANCEL_LOCALIZATION, cancel, ANNA)

    def press(self, gesture: Gesture = "press", user: str = ANNA) -> None:
        self._presses += 1
        event = press(self.bench.clock.now_ns() / S, gesture)[0].model_copy(update={"seq": self._presses})
        self.bench.put(topics.BUTTON, event, user)

    def stand(self) -> None:
        self.bench.put(topics.POSE, pose(self.bench.clock.now_ns() / S)[0], ANNA)

    def move(self) -> int:
        """Put a sample; return its stamp."""
        now_ns = self.bench.clock.now_ns()
        self.bench.put(topics.IMU, ImuSample(stamp_ns=now_ns, orientation_xyzw=IDENTITY), ANNA)
        return now_ns

    async def localizes(self, **news: Any) -> None:
        """Tell of the localization, a second later."""
        assert isinstance(self.bench.clock, ManualClock)
        news["stamp_ns"] = self.bench.clock.advance(1.0)
        self.bench.put(topics.LOCALIZATION, Localization.model_validate(news), ANNA)
        await self.bench.settle()


@pytest.fixture(params=[ManualClock])
async def anna(request: pytest.FixtureRequest) -> AsyncIterator[Person]:
    async with memory_bench(request.param()) as bench:
        yield Person(bench)


in_time = pytest.mark.parametrize("anna", [VirtualClock], indirect=True)


async def test_profile_and_first_state_reach_late_subscribers(anna: Person) -> None:
    body = {"footprint_to_neck_m": 1.5}
    await anna.start(profile={"hand": "left", "cursor_color": [0, 255, 0], "body": body})
    late = Person(anna.bench)
    await anna.bench.settle()
    (sent,) = late.profiles
    assert (sent.hand, sent.cursor_color, sent.body.footprint_to_neck_m) == ("left", (0, 255, 0), 1.5)
    assert late.states == ["idle"]


async def test_press_that_answers_the_first_state_is_processed(anna: Person) -> None:
    def answer(_payload: object, _name: str) -> None:
        first.close()
        anna.press()

    first = anna.bench.bus.tap(topics.INTERACTION, answer, ANNA)
    await anna.start()
    assert [cue.cue for cue in anna.cues] == ["refused"]  # no pose is known


async def test_supervisor_leads_from_button_through_localizing_to_pointing(anna: Person) -> None:
    anna.has_localizer()
    await anna.start(localize=True, localization_method="static_targets")
    anna.press()
    await until(lambda: anna.asked == ["start static_targets"])
    await anna.bench.settle()
    for phase, target in (("sampling", "led_0"), ("solved", "")):
        await anna.localizes(phase=phase, target_id=target)
    anna.press()
    await until(lambda: anna.states[-1] == "idle")
    # the two news of localizing are one after the other, so nobody sees only the last
    assert anna.states == ["idle", "localizing", "localizing", "pointing", "idle"]
    assert [cue.cue for cue in anna.cues] == ["started", "target", "localized", "started", "stopped"]
    assert [interaction.seq for interaction in anna.interactions] == [1, 2, 3, 4, 5]
    assert anna.asked == ["start static_targets"]


async def test_refusal_and_absence_of_the_localizer_are_shown(anna: Person) -> None:
    await anna.start(localize=True)
    anna.press()
    await until(lambda: "does not answer" in anna.interactions[-1].reason)
    assert anna.states[-1] == "idle"
    anna.has_localizer(refusal="map 'lab' has one lamp, two are needed")
    anna.press()
    await until(lambda: anna.interactions[-1].reason == "map 'lab' has one lamp, two are needed")
    assert anna.states[-1] == "idle"


async def test_cancel_during_the_start_leaves_no_localizer_running(anna: Person) -> None:
    answer = asyncio.Event()
    anna.has_localizer(answer=answer)
    await anna.start(localize=True)
    anna.press()
    await until(lambda: anna.asked == ["start"])
    anna.press("double")
    await until(lambda: anna.states[-1] == "idle")
    for _ in range(2):  # thought better of twice more, before the localizer answers at all
        anna.press()
    await anna.bench.settle()
    answer.set()
    await until(lambda: anna.asked == ["start", "cancel", "cancel", "cancel"])


@in_time
@pytest.mark.parametrize("localize", [False, True])
async def test_silent_wrist_ends_the_interaction(anna: Person, *, localize: bool) -> None:
    anna.has_localizer()
    await anna.start(localize=localize, imu_timeout_s=5.0)
    if not localize:
        anna.stand()
    await anna.bench.settle()
    anna.press()
    last_ns = 0
    for _ in range(12):  # 6 s of samples: more than the time-out
        last_ns = anna.move()
        await asyncio.sleep(0.5)

    assert anna.states[-1] == ("localizing" if localize else "pointing")
    await until(lambda: anna.states[-1] == "idle")
    assert "Is the wristband on" in anna.interactions[-1].reason
    assert anna.interactions[-1].stamp_ns - last_ns >= 5_000_000_000
    if localize:
        await until(lambda: anna.asked == ["start", "cancel"])


async def test_supervisor_uses_the_topics_of_its_row_and_its_person(anna: Person) -> None:
    bench = anna.bench
    view = ServiceBus(bench.bus, bench.clock, "supervisor", "supervisor.anna", ANNA)
    service = Supervisor(SupervisorConfig(), Context(bus=view, clock=bench.clock, user=ANNA))
    row = process("supervisor")
    assert row.load() is type(service)
    assert view.reads == {topic.key for topic in row.reads}
    assert view.writes == {topic.key for topic in row.writes}
    assert view.served == {request.key for request in row.serves}

    anna.stand()
    await bench.settle()
    before = len(anna.interactions)
    anna.press(user="ben")
    await bench.settle()
    assert len(anna.interactions) == before

    anna.press()
    await bench.settle()
    assert anna.states[-1] == "pointing"
    await view.close()


async def test_offset_is_published_after_restarts_until_it_is_erased(
    own_state: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = own_state / "users" / ANNA / "offset.json"
    async with memory_bench() as bench:
        anna = Person(bench)
        await anna.start(profile={"hand": "left"})
        await bench.bus.call(topics.SET_OFFSET, SetOffset(offset=OFFSET), ANNA)
        await until(lambda: len(anna.profiles) == 2)
        assert [profile.offset for profile in anna.profiles] == [None, OFFSET]
        assert [profile.seq for profile in anna.profiles] == [1, 2]
        assert anna.profiles[1].hand == "left"
    assert path.is_file()

    async with memory_bench() as bench:
        caplog.set_level("INFO")
        anna = Person(bench)
        await anna.start()
        forget = "an offset is in use; `pointit person calibrate user anna --erase` forgets it"
        assert [line for line in caplog.messages if "offset" in line] == [f"anna: {forget}"]
        assert [profile.offset for profile in anna.profiles] == [OFFSET]

        reply: Done = await bench.bus.call(topics.SET_OFFSET, SetOffset(), ANNA)
        assert reply.message == "the offset is forgotten"
        await until(lambda: len(anna.profiles) == 2)
        assert anna.profiles[1].offset is None
    assert not path.exists()


async def test_damaged_offset_file_is_a_warning_and_not_used(anna: Person, own_state: Path) -> None:
    path = own_state / "users" / ANNA / "offset.json"
    path.parent.mkdir(parents=True)
    path.write_text('{"rung": "ladder"}', encoding="utf-8")
    await anna.start()
    await until(lambda: bool(anna.reports and anna.reports[-1].warnings))
    assert "offset.json: cannot be used" in anna.reports[-1].warnings[0]
    assert anna.profiles[-1].offset is None

    offset = SetOffset(offset=OFFSET)
    await anna.bench.bus.call(topics.SET_OFFSET, offset, ANNA)  # takes its place
    await until(lambda: not anna.reports[-1].warnings)

    path.unlink()
    shutil.rmtree(path.parent)
    path.parent.write_text("in the way", encoding="utf-8")
    reply: Done = await anna.bench.bus.call(topics.SET_OFFSET, offset, ANNA)
    assert "but a restart restores the previous one" in reply.message
    await until(lambda: bool(anna.reports[-1].warnings))


async def test_double_press_requests_an_anchor_and_returns(anna: Person) -> None:
    asked: list[PointAnchor] = []

    async def point_anchor(query: PointAnchor, _user: str) -> Done:
        asked.append(query)
        if len(asked) == 2:
            raise RefusedError("the map has no lamps")
        return Done()

    anna.bench.bus.serve(topics.POINT_ANCHOR, point_anchor, ANNA)
    await anna.start()
    anna.stand()
    await anna.bench.settle()
    anna.press()

    anna.press("double")
    await until(lambda: asked == [PointAnchor()])
    await anna.bench.settle()
    for phase in ("sampling", "solved"):
        await anna.localizes(phase=phase, purpose="anchor", target_id="led_0")
    assert anna.states[-1] == "pointing"
    assert [cue.cue for cue in anna.cues] == ["started", "started", "target", "localized", "started"]

    anna.press("double")
    await until(lambda: anna.interactions[-1].reason == "the map has no lamps")
    assert anna.states[-1] == "pointing"


async def test_implausible_offset_is_refused(anna: Person) -> None:
    absurd = OFFSET.model_copy(update={"elevation": (-1e6, 0.0, 0.0, 0.0, 0.0, 0.0)})
    await anna.start()
    with pytest.raises(RefusedError, match="exceeds the limit of 45°"):
        await anna.bench.bus.call(topics.SET_OFFSET, SetOffset(offset=absurd), ANNA)
    await anna.bench.settle()
    assert [profile.offset for profile in anna.profiles] == [None]


async def test_text_for_the_person_is_a_cue_without_effect(anna: Person) -> None:
    await anna.start()
    await until(lambda: anna.states == ["idle"])
    said = await anna.bench.bus.call(topics.SAY, Say(text="tea is ready"), ANNA)
    await until(lambda: len(anna.cues) == 1)
    (cue,) = anna.cues
    assert (cue.text, cue.chime, cue.target_id) == ("tea is ready", "single", "")
    belief = PerceivedState()
    belief.on_cue(cue, 1)
    assert (said.message, belief.state, anna.states) == ("anna is told", "idle", ["idle"])


async def test_advice_ends_when_its_service_leaves(anna: Person) -> None:
    arm = anna.bench.bus.announce(topics.SERVICE_ALIVE, "arm")
    await anna.start()
    anna.stand()
    advice = Say(text="Press to take the box.", stays=True, service="arm")
    await anna.bench.bus.call(topics.SAY, advice, ANNA)
    assert anna.cues == [], "what stays has no cue"

    anna.press()
    await anna.bench.settle()
    told = anna.interactions[-1]
    assert (told.next_step, told.is_advised) == (advice.text, True)

    arm.close()
    await anna.bench.settle()
    assert not anna.interactions[-1].is_advised


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


def test_pointing_resumes_when_the_wrist_is_heard_soon() -> None:
    cycle = broken_off()
    outputs = cycle.imu(*sample(20))
    assert told(outputs) == ["pointing", "cue started"]
    assert shown(outputs).reason == transitions.RESUMED
    assert told(cycle.button(*press(21))) == ["idle", "cue stopped"]
    assert cycle.imu(*sample(22)) == []  # they have stopped themselves


def test_late_wrist_or_old_samples_do_not_resume_pointing() -> None:
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
def test_interaction_at_rest_or_of_another_time_is_not_resumed(kept: Interaction) -> None:
    cycle = life_cycle()
    cycle.resume_from(kept, 100 * S)
    cycle.pose(*pose(1))
    cycle.localization(news(2, "idle")[0], 100 * S)
    assert cycle.imu(*sample(100.1)) == []


def test_press_before_the_resume_decides() -> None:
    cycle = life_cycle()
    cycle.resume_from(before("pointing", 50), 100 * S)
    cycle.pose(*pose(1))
    assert told(cycle.button(*press(100))) == ["pointing", "cue started"]
    assert told(cycle.button(*press(101))) == ["idle", "cue stopped"]
    cycle.localization(news(2, "idle")[0], 102 * S)
    assert cycle.imu(*sample(102)) == []


class Site(Person):
    """Anna, a supervisor that can be killed, and a localizer that is played."""

    def __init__(self, bench: Bench, clock: ManualClock) -> None:
        super().__init__(bench)
        self.clock = clock
        self._localizer = Localization(stamp_ns=clock.now_ns(), phase="idle")
        self.stand()

    async def localizer(self, *, restarted: bool = False) -> int:
        """Tell of the localizer, or of another that has begun 2 s later; return the stamp."""
        if restarted:
            self._localizer = Localization(stamp_ns=self.clock.advance(2.0), phase="idle")
        self.bench.put(topics.LOCALIZATION, self._localizer, ANNA)
        await self.bench.settle()
        return self._localizer.stamp_ns

    async def start_again(self) -> None:
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
        await self.start_again()
        self.clock.advance(1.0)
        self.press()
        await until(lambda: self.interactions[-1].state == "pointing")

    async def samples(self) -> None:
        self.clock.advance(0.1)
        self.move()
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


async def test_pointing_resumes_without_a_press_after_a_killed_supervisor(site: Site) -> None:
    await site.point()
    await until(lambda: (word := kept()) is not None and word.state == "pointing")
    await site.stop()
    site.clock.advance(2.0)
    await site.start_again()
    await site.samples()
    states = [state for state, _ in itertools.groupby(site.states)]
    assert states == ["idle", "pointing", "idle", "pointing"]
    assert site.cues[-1].cue == "started"
    await site.stop()
    await site.localizer(restarted=True)  # a different one resets the interaction
    await site.start_again()
    await site.samples()
    assert site.interactions[-1].state == "idle"


async def test_pointing_resumes_when_the_localizer_restarted_before(site: Site) -> None:
    await site.point()
    restarted_ns = await site.localizer(restarted=True)
    await until(lambda: (word := kept()) is not None and word.stamp_ns == restarted_ns)
    assert site.interactions[-1].state == "pointing"
    await site.stop()
    site.clock.advance(2.0)
    await site.start_again()
    await site.samples()
    assert site.interactions[-1].reason == transitions.RESUMED


async def test_last_interaction_on_the_bus_is_resumed(site: Site) -> None:
    """Another supervisor of theirs was there, and what it said last arrives late."""
    last = Interaction(stamp_ns=site.clock.advance(1.0), state="pointing")
    site.clock.advance(1.0)
    await site.start_again()
    site.bench.put(topics.INTERACTION, last, ANNA)
    await site.bench.settle()
    await site.localizer()
    await site.samples()
    assert site.cues[-1].cue == "started"
    assert site.interactions[-1].reason == transitions.RESUMED


async def test_damaged_last_interaction_is_a_warning() -> None:
    path = StateFile(Interaction, ANNA, LAST_WORD_PURPOSE).path
    path.parent.mkdir(parents=True)
    path.write_text("{", encoding="utf-8")
    async with memory_bench() as bench:
        reports: list[Health] = bench.collect(topics.HEALTH)
        bench.start(Supervisor, user=ANNA)
        await until(lambda: bool(reports and reports[-1].warnings))
        assert "interaction.json: cannot be used" in reports[-1].warnings[0]
        await until(lambda: not reports[-1].warnings)  # the next one has taken its place


def eager(*, localize: bool = False) -> LifeCycle:
    cycle = life_cycle(localize=localize, autostart=True)
    cycle.begin(0)
    return cycle


def test_sample_starts_pointing_when_autostart_knows_the_pose() -> None:
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
def test_button_starts_again_after_it_stopped(gesture: Gesture) -> None:
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


def test_samples_start_pointing_after_an_anchor_while_waiting() -> None:
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
