"""The supervisor on a bus, with a localizer that the test plays."""

import asyncio
import shutil
from pathlib import Path

import pytest

from pointit.geometry.rotation import IDENTITY
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.config.config import Layers
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.service.service import Context
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import (
    ButtonEvent,
    CancelLocalization,
    Done,
    Health,
    ImuSample,
    Interaction,
    Localization,
    PointAnchor,
    PointingOffset,
    SetOffset,
    StartLocalization,
    UserPose,
    UserProfile,
    topics,
)
from pointit.services.registry import process
from pointit.services.supervisor.config import SupervisorConfig
from pointit.services.supervisor.service import Supervisor
from tests.support.bench import Bench, ManualClock, in_virtual_time, memory_bench, until

ANNA = "anna"


class PlayedLocalizer:
    """Answers as told, and remembers what it was asked."""

    def __init__(self, bench: Bench, refusal: str = "") -> None:
        self.asked: list[str] = []
        self._refusal = refusal
        bench.bus.serve(topics.START_LOCALIZATION, self._start, ANNA)
        bench.bus.serve(topics.CANCEL_LOCALIZATION, self._cancel, ANNA)

    async def _start(self, query: StartLocalization, _user: str) -> Done:
        self.asked.append(f"start {query.method or ''}".strip())
        if self._refusal:
            raise RefusedError(self._refusal)
        return Done()

    async def _cancel(self, _query: CancelLocalization, _user: str) -> Done:
        self.asked.append("cancel")
        return Done()


def press(bench: Bench) -> None:
    bench.put(topics.BUTTON, ButtonEvent(stamp_ns=bench.clock.now_ns()), ANNA)


def put_pose(bench: Bench) -> None:
    bench.put(topics.POSE, UserPose(stamp_ns=bench.clock.now_ns(), position_m=(0, 0, 0), yaw_rad=0), ANNA)


def states(interactions: list[Interaction]) -> list[str]:
    return [interaction.state for interaction in interactions]


async def test_the_profile_and_the_first_state_are_there_for_who_joins_late() -> None:
    config = SupervisorConfig.model_validate(
        {"profile": {"hand": "left", "cursor_color": [0, 255, 0], "body": {"footprint_to_neck_m": 1.5}}}
    )
    async with memory_bench() as bench:
        bench.start(Supervisor, config, user=ANNA)
        await bench.settle()
        profiles, interactions = bench.collect(topics.PROFILE, ANNA), bench.collect(topics.INTERACTION, ANNA)
        await bench.settle()
        assert [(p.hand, p.cursor_color, p.body.footprint_to_neck_m) for p in profiles] == [
            ("left", (0, 255, 0), 1.5)
        ]
        assert states(interactions) == ["idle"]


async def test_from_the_button_through_localizing_to_pointing_and_back() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        interactions, cues = bench.collect(topics.INTERACTION, ANNA), bench.collect(topics.FEEDBACK, ANNA)
        localizer = PlayedLocalizer(bench)
        bench.start(
            Supervisor, SupervisorConfig(localize=True, localization_method="static_targets"), user=ANNA
        )
        await bench.settle()
        clock.advance(1.0)
        press(bench)
        await until(lambda: localizer.asked == ["start static_targets"])
        await bench.settle()
        for phase, target in (("sampling", "led_0"), ("solved", "")):
            clock.advance(1.0)
            bench.put(
                topics.LOCALIZATION,
                Localization.model_validate(
                    {"stamp_ns": clock.now_ns(), "phase": phase, "target_id": target}
                ),
                ANNA,
            )
            await bench.settle()
        clock.advance(0.5)
        press(bench)
        await until(lambda: states(interactions)[-1] == "idle")
        # the two news of localizing are one after the other, so nobody sees only the last
        assert states(interactions) == ["idle", "localizing", "localizing", "pointing", "idle"]
        assert [cue.cue for cue in cues] == ["started", "target", "localized", "started", "stopped"]
        assert [interaction.seq for interaction in interactions] == [1, 2, 3, 4, 5]
        assert localizer.asked == ["start static_targets"]


async def test_the_localizers_refusal_and_its_absence_are_passed_on() -> None:
    async with memory_bench(ManualClock()) as bench:
        interactions = bench.collect(topics.INTERACTION, ANNA)
        bench.start(Supervisor, SupervisorConfig(localize=True), user=ANNA)
        await bench.settle()
        press(bench)
        await until(lambda: "does not answer" in interactions[-1].reason)
        assert interactions[-1].state == "idle"
        PlayedLocalizer(bench, refusal="map 'lab' has one lamp, two are needed")
        bench.put(topics.BUTTON, ButtonEvent(stamp_ns=bench.clock.now_ns(), seq=2), ANNA)
        await until(lambda: interactions[-1].reason == "map 'lab' has one lamp, two are needed")
        assert interactions[-1].state == "idle"


async def test_cancelling_while_the_start_is_on_its_way_leaves_no_localizer_running() -> None:
    async with memory_bench(ManualClock()) as bench:
        interactions = bench.collect(topics.INTERACTION, ANNA)
        asked: list[str] = []
        answer = asyncio.Event()

        async def start(_query: StartLocalization, _user: str) -> Done:
            asked.append("start")
            await answer.wait()
            return Done()

        async def cancel(_query: CancelLocalization, _user: str) -> Done:
            asked.append("cancel")
            return Done()

        bench.bus.serve(topics.START_LOCALIZATION, start, ANNA)
        bench.bus.serve(topics.CANCEL_LOCALIZATION, cancel, ANNA)
        bench.start(Supervisor, SupervisorConfig(localize=True), user=ANNA)
        await bench.settle()
        press(bench)
        await until(lambda: asked == ["start"])
        bench.put(topics.BUTTON, ButtonEvent(stamp_ns=bench.clock.now_ns(), gesture="double"), ANNA)
        await until(lambda: interactions[-1].state == "idle")
        for seq in (3, 4):  # thought better of twice more, before the localizer answers at all
            bench.put(topics.BUTTON, ButtonEvent(stamp_ns=bench.clock.now_ns(), seq=seq), ANNA)
        await bench.settle()
        answer.set()
        await until(lambda: asked == ["start", "cancel", "cancel", "cancel"])


@pytest.mark.parametrize("localize", [False, True])
@in_virtual_time
async def test_a_wrist_that_falls_silent_ends_the_interaction(*, localize: bool) -> None:
    clock = VirtualClock()
    async with memory_bench(clock) as bench:
        interactions = bench.collect(topics.INTERACTION, ANNA)
        localizer = PlayedLocalizer(bench)
        bench.start(Supervisor, SupervisorConfig(localize=localize, imu_timeout_s=5.0), user=ANNA)
        if not localize:
            put_pose(bench)
        await bench.settle()
        press(bench)
        last_ns = 0
        for _ in range(12):  # 6 s of samples: more than the time-out
            last_ns = clock.now_ns()
            bench.put(topics.IMU, ImuSample(stamp_ns=last_ns, orientation_xyzw=IDENTITY), ANNA)
            await asyncio.sleep(0.5 / clock.speed)
        assert interactions[-1].state == ("localizing" if localize else "pointing")
        await until(lambda: interactions[-1].state == "idle")
        assert "is the wristband on" in interactions[-1].reason
        assert interactions[-1].stamp_ns - last_ns >= 5_000_000_000
        if localize:
            await until(lambda: localizer.asked == ["start", "cancel"])


@in_virtual_time
async def test_samples_alone_begin_and_begin_again_where_there_is_no_button() -> None:
    clock = VirtualClock()
    async with memory_bench(clock) as bench:
        interactions = bench.collect(topics.INTERACTION, ANNA)
        bench.start(Supervisor, SupervisorConfig(autostart=True, imu_timeout_s=2.0), user=ANNA)
        put_pose(bench)
        await bench.settle()
        for begun in (1, 2):
            bench.put(topics.IMU, ImuSample(stamp_ns=clock.now_ns(), orientation_xyzw=IDENTITY), ANNA)
            await until(lambda: states(interactions).count("pointing") == begun)  # noqa: B023 - awaited here
            await until(lambda: interactions[-1].state == "idle")


@in_virtual_time
async def test_localizing_that_never_ends_is_ended() -> None:
    clock = VirtualClock()
    async with memory_bench(clock) as bench:
        interactions = bench.collect(topics.INTERACTION, ANNA)
        localizer = PlayedLocalizer(bench)
        config = SupervisorConfig(localize=True, localization_timeout_s=8.0, imu_timeout_s=600.0)
        bench.start(Supervisor, config, user=ANNA)
        await bench.settle()
        press(bench)
        await until(lambda: len(interactions) > 1 and interactions[-1].state == "idle")
        assert "no further in 8 s" in interactions[-1].reason
        await until(lambda: localizer.asked == ["start", "cancel"])
        took_s = (interactions[-1].stamp_ns - interactions[1].stamp_ns) / 1e9
        assert 8.0 <= took_s < 9.0


async def test_it_reads_and_writes_what_its_row_says_and_only_its_persons() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        interactions = bench.collect(topics.INTERACTION)
        view = ServiceBus(bench.bus, clock, "supervisor", "supervisor.anna", ANNA)
        service = Supervisor(SupervisorConfig(), Context(bus=view, clock=clock, user=ANNA))
        row = process("supervisor")
        assert row.load() is type(service)
        assert view.reads == {topic.key for topic in row.reads}
        assert view.writes == {topic.key for topic in row.writes}
        assert view.served == {request.key for request in row.serves}
        put_pose(bench)
        await bench.settle()
        before = len(interactions)
        bench.put(topics.BUTTON, ButtonEvent(stamp_ns=clock.now_ns()), "ben")
        await bench.settle()
        assert len(interactions) == before
        press(bench)
        await bench.settle()
        assert interactions[-1].state == "pointing"
        await view.close()


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("profile.body.footprint_to_neck_m", "14.3"),
        ("profile.cursor_width_m", "0"),
        ("profile.cursor_color", "[0, 300, 0]"),
        ("imu_timeout_s", "-1"),
    ],
)
def test_a_wrong_parameter_is_named(path: str, value: str) -> None:
    layers = Layers()
    layers.add_text(path.split("."), value, "file.yaml")
    with pytest.raises(ConfigError, match=rf"^file\.yaml: {path}.*: "):
        layers.build(SupervisorConfig)


OFFSET = PointingOffset(rung="pitch", elevation=(0.05, 0.0, 0.0, 0.0, 0.0, 0.0), sigma_rad=0.02, anchors=3)


async def test_it_is_published_at_once_and_again_after_a_restart_until_it_is_forgotten(
    own_state: Path, caplog: pytest.LogCaptureFixture
) -> None:
    config = SupervisorConfig.model_validate({"profile": {"hand": "left"}})
    path = own_state / "users" / ANNA / "offset.json"
    async with memory_bench() as bench:
        profiles: list[UserProfile] = bench.collect(topics.PROFILE, ANNA)
        bench.start(Supervisor, config, user=ANNA)
        await bench.settle()
        await bench.bus.call(topics.SET_OFFSET, SetOffset(offset=OFFSET), ANNA)
        await until(lambda: len(profiles) == 2)
        assert [profile.offset for profile in profiles] == [None, OFFSET]
        assert [profile.seq for profile in profiles] == [1, 2]
        assert profiles[1].hand == "left"
    assert path.is_file()
    async with memory_bench() as bench:
        caplog.set_level("INFO")
        bench.start(Supervisor, config, user=ANNA)
        await bench.settle()
        forget = "an offset is in use; `pointit person calibrate user anna --erase` forgets it"
        assert [line for line in caplog.messages if "offset" in line] == [f"anna: {forget}"]
        profiles = bench.collect(topics.PROFILE, ANNA)
        await until(lambda: len(profiles) == 1)
        assert profiles[0].offset == OFFSET
        reply: Done = await bench.bus.call(topics.SET_OFFSET, SetOffset(), ANNA)
        assert reply.message == "the offset is forgotten"
        await until(lambda: len(profiles) == 2)
        assert profiles[1].offset is None
    assert not path.exists()


async def test_a_spoilt_file_is_a_warning_and_no_offset(own_state: Path) -> None:
    path = own_state / "users" / ANNA / "offset.json"
    path.parent.mkdir(parents=True)
    path.write_text('{"rung": "ladder"}', encoding="utf-8")
    async with memory_bench() as bench:
        profiles = bench.collect(topics.PROFILE, ANNA)
        reports: list[Health] = bench.collect(topics.HEALTH)
        bench.start(Supervisor, user=ANNA)
        await until(lambda: bool(reports and reports[-1].warnings))
        assert "offset.json: cannot be used" in reports[-1].warnings[0]
        assert profiles[-1].offset is None
        await bench.bus.call(topics.SET_OFFSET, SetOffset(offset=OFFSET), ANNA)  # takes its place
        await until(lambda: not reports[-1].warnings)
        path.unlink()
        shutil.rmtree(path.parent)
        path.parent.write_text("in the way", encoding="utf-8")
        reply: Done = await bench.bus.call(topics.SET_OFFSET, SetOffset(offset=OFFSET), ANNA)
        assert "but a restart restores the previous one" in reply.message
        await until(lambda: bool(reports[-1].warnings))


async def test_a_double_press_asks_for_an_anchor_and_comes_back() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        interactions, cues = bench.collect(topics.INTERACTION, ANNA), bench.collect(topics.FEEDBACK, ANNA)
        asked: list[PointAnchor] = []

        async def point_anchor(query: PointAnchor, _user: str) -> Done:
            asked.append(query)
            if len(asked) == 2:
                raise RefusedError("the map has no lamps")
            return Done()

        bench.bus.serve(topics.POINT_ANCHOR, point_anchor, ANNA)
        bench.start(Supervisor, user=ANNA)
        pose = UserPose(stamp_ns=clock.now_ns(), position_m=(0.0, 0.0, 0.0), yaw_rad=0.0)
        bench.put(topics.POSE, pose, ANNA)
        await bench.settle()
        bench.put(topics.BUTTON, ButtonEvent(stamp_ns=clock.now_ns(), seq=1), ANNA)
        bench.put(topics.BUTTON, ButtonEvent(stamp_ns=clock.now_ns(), seq=2, gesture="double"), ANNA)
        await until(lambda: asked == [PointAnchor()])
        await bench.settle()
        for phase in ("sampling", "solved"):
            now_ns = clock.advance(1.0)
            fields = {"stamp_ns": now_ns, "phase": phase, "purpose": "anchor", "target_id": "led_0"}
            bench.put(topics.LOCALIZATION, Localization.model_validate(fields), ANNA)
            await bench.settle()
        assert interactions[-1].state == "pointing"
        assert [cue.cue for cue in cues] == ["started", "started", "target", "localized", "started"]
        clock.advance(0.5)
        bench.put(topics.BUTTON, ButtonEvent(stamp_ns=clock.now_ns(), seq=3, gesture="double"), ANNA)
        await until(lambda: interactions[-1].reason == "the map has no lamps")
        assert interactions[-1].state == "pointing"


async def test_an_offset_that_nobody_has_is_refused() -> None:
    absurd = OFFSET.model_copy(update={"elevation": (-1e6, 0.0, 0.0, 0.0, 0.0, 0.0)})
    async with memory_bench(ManualClock()) as bench:
        profiles: list[UserProfile] = []
        bench.bus.subscribe(topics.PROFILE, lambda profile, _user: profiles.append(profile), ANNA)
        bench.start(Supervisor, user=ANNA)
        await until(lambda: len(profiles) == 1)
        with pytest.raises(RefusedError, match="exceeds the limit of 45°"):
            await bench.bus.call(topics.SET_OFFSET, SetOffset(offset=absurd), ANNA)
        await bench.settle()
        assert [profile.offset for profile in profiles] == [None]
