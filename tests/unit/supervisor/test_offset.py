"""The person's pointing offset: in the profile at once, kept for the next start, forgotten when asked."""

import shutil
from pathlib import Path

import pytest

from pointit.runtime.errors import RefusedError
from pointit.schemas import (
    ButtonEvent,
    Done,
    Health,
    Localization,
    PointAnchor,
    PointingOffset,
    SetOffset,
    UserPose,
    UserProfile,
    topics,
)
from pointit.services.supervisor.config import SupervisorConfig
from pointit.services.supervisor.service import Supervisor
from tests.support.bench import ManualClock, memory_bench, until

ANNA = "anna"
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
