"""The supervisor on a bus, with a localizer that the test plays, and the person's pointing offset."""

import asyncio
import shutil
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from pointit.geometry.rotation import IDENTITY
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.clock import VirtualClock
from pointit.runtime.errors import RefusedError
from pointit.runtime.service.service import Context
from pointit.schemas import (
    Done,
    Health,
    ImuSample,
    Localization,
    PointAnchor,
    PointingOffset,
    Say,
    SetOffset,
    topics,
)
from pointit.services.registry import process
from pointit.services.supervisor.config import SupervisorConfig
from pointit.services.supervisor.service import Supervisor
from pointit.services.user_sim.goal import PerceivedState
from tests.support.bench import Bench, ManualClock, memory_bench, until
from tests.unit.supervisor.played import Gesture, S, pose, press

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


async def test_the_profile_and_the_first_state_are_there_for_who_joins_late(anna: Person) -> None:
    body = {"footprint_to_neck_m": 1.5}
    await anna.start(profile={"hand": "left", "cursor_color": [0, 255, 0], "body": body})
    late = Person(anna.bench)
    await anna.bench.settle()
    (sent,) = late.profiles
    assert (sent.hand, sent.cursor_color, sent.body.footprint_to_neck_m) == ("left", (0, 255, 0), 1.5)
    assert late.states == ["idle"]


async def test_a_press_in_answer_to_the_first_state_is_heard(anna: Person) -> None:
    def answer(_payload: object, _name: str) -> None:
        first.close()
        anna.press()

    first = anna.bench.bus.tap(topics.INTERACTION, answer, ANNA)
    await anna.start()
    assert [cue.cue for cue in anna.cues] == ["refused"]  # no pose is known


async def test_from_the_button_through_localizing_to_pointing_and_back(anna: Person) -> None:
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


async def test_the_localizers_refusal_and_its_absence_are_passed_on(anna: Person) -> None:
    await anna.start(localize=True)
    anna.press()
    await until(lambda: "does not answer" in anna.interactions[-1].reason)
    assert anna.states[-1] == "idle"
    anna.has_localizer(refusal="map 'lab' has one lamp, two are needed")
    anna.press()
    await until(lambda: anna.interactions[-1].reason == "map 'lab' has one lamp, two are needed")
    assert anna.states[-1] == "idle"


async def test_cancelling_while_the_start_is_on_its_way_leaves_no_localizer_running(anna: Person) -> None:
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
async def test_a_wrist_that_falls_silent_ends_the_interaction(anna: Person, *, localize: bool) -> None:
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
    assert "is the wristband on" in anna.interactions[-1].reason
    assert anna.interactions[-1].stamp_ns - last_ns >= 5_000_000_000
    if localize:
        await until(lambda: anna.asked == ["start", "cancel"])


async def test_it_reads_and_writes_what_its_row_says_and_only_its_persons(anna: Person) -> None:
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


async def test_an_offset_is_published_and_again_after_a_restart_until_it_is_forgotten(
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


async def test_a_spoilt_file_is_a_warning_and_no_offset(anna: Person, own_state: Path) -> None:
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


async def test_a_double_press_asks_for_an_anchor_and_comes_back(anna: Person) -> None:
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


async def test_an_offset_that_nobody_has_is_refused(anna: Person) -> None:
    absurd = OFFSET.model_copy(update={"elevation": (-1e6, 0.0, 0.0, 0.0, 0.0, 0.0)})
    await anna.start()
    with pytest.raises(RefusedError, match="exceeds the limit of 45°"):
        await anna.bench.bus.call(topics.SET_OFFSET, SetOffset(offset=absurd), ANNA)
    await anna.bench.settle()
    assert [profile.offset for profile in anna.profiles] == [None]


async def test_a_text_for_the_person_is_a_cue_that_changes_nothing(anna: Person) -> None:
    await anna.start()
    await until(lambda: anna.states == ["idle"])
    said = await anna.bench.bus.call(topics.SAY, Say(text="tea is ready"), ANNA)
    await until(lambda: len(anna.cues) == 1)
    (cue,) = anna.cues
    assert (cue.text, cue.chime, cue.target_id) == ("tea is ready", "single", "")
    belief = PerceivedState()
    belief.on_cue(cue, 1)
    assert (said.message, belief.state, anna.states) == ("anna is told", "idle", ["idle"])
