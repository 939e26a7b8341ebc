"""The recorded robot: its reports, its times, its faults."""

from pathlib import Path

import numpy as np
import pytest

from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch, run_service
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas.topics import OBJECTS
from pointit.services.robot_replay.service import RobotReplay, RobotReplayConfig
from pointit.services.robot_replay.trajectory import Trajectory
from pointit.sim.motion_table import MotionForm
from pointit.sim.recordings import ImuRecording, read_robot_csv
from tests.support.bench import memory_bench, until

CSV = "t,qw,qx,qy,qz,robot_x,robot_y,robot_z\n"


def recording(t_s: list[float], x_m: list[float]) -> ImuRecording:
    places = np.column_stack([x_m, np.zeros(len(x_m)), np.ones(len(x_m))])
    orientation = np.tile([0.0, 0.0, 0.0, 1.0], (len(t_s), 1))
    return ImuRecording(path=Path("a.csv"), t_s=np.array(t_s), orientation_xyzw=orientation, robot_m=places)


def write(folder: Path, count: int, step_s: float) -> Path:
    path = folder / "flight.csv"
    rows = [f"{5 + i * step_s},1,0,0,0,{2 * i * step_s},1,0.5\n" for i in range(count)]
    path.write_text(CSV + "".join(rows))
    return path


def test_samples_of_one_time_make_one_report_with_finite_velocity() -> None:
    trajectory = Trajectory(recording([0.0, 0.1, 0.1, 0.2], [0.0, 0.1, 5.0, 0.2]))
    assert trajectory.times_ns == [0, 100_000_000, 200_000_000]
    assert trajectory.report(1, 0).objects[0].velocity_mps == pytest.approx((1.0, 0.0, 0.0))


def test_lost_robot_has_no_report() -> None:
    trajectory = Trajectory(recording([0.0, 0.1, 0.2, 0.3], [0.0, float("nan"), 0.4, 0.6]))
    assert trajectory.times_ns == [0, 200_000_000, 300_000_000]
    assert [trajectory.report(index, 0).objects[0].velocity_mps[0] for index in range(3)] == pytest.approx(
        [2.0, 2.0, 2.0]
    )


async def test_reports_come_when_due_with_their_own_stamps(tmp_path: Path) -> None:
    clock = VirtualClock()
    start_ns = clock.now_ns() + 1_000_000_000
    async with memory_bench(clock) as bench:
        early: list[float] = []
        reports = bench.collect(OBJECTS)
        bench.bus.subscribe(OBJECTS, lambda m, _name: early.append((clock.now_ns() - m.stamp_ns) / 1e9))
        config = RobotReplayConfig(recording=str(write(tmp_path, 31, 0.1)), start_ns=start_ns, robot_id="r2")
        bench.start(RobotReplay, config)
        await until(lambda: bool(reports) and reports[-1].seq == 31, what="the last report")
        for report in reports:
            assert report.stamp_ns == start_ns + (report.seq - 1) * 100_000_000
            assert (report.objects[0].id, report.objects[0].kind) == ("r2", "robot")
            assert report.objects[0].position_m[0] == pytest.approx(0.2 * (report.seq - 1))
        assert min(early) >= 0.0  # never before it is due
        assert len(reports) == 31


async def test_replay_without_start_begins_at_once_and_skips_the_past(tmp_path: Path) -> None:
    clock = VirtualClock()
    path = str(write(tmp_path, 31, 0.1))
    async with memory_bench(clock) as bench:
        reports = bench.collect(OBJECTS)
        before_ns = clock.now_ns()
        bench.start(RobotReplay, RobotReplayConfig(recording=path))
        await until(lambda: bool(reports), what="a report")
        assert reports[0].seq == 1
        assert before_ns <= reports[0].stamp_ns <= clock.now_ns()
    clock = VirtualClock()
    async with memory_bench(clock) as bench:
        reports = bench.collect(OBJECTS)
        start_ns = clock.now_ns() - 2_000_000_000
        bench.start(RobotReplay, RobotReplayConfig(recording=path, start_ns=start_ns))
        await until(lambda: bool(reports) and reports[-1].seq == 31, what="the last report")
        assert reports[0].seq > 20


def test_robot_needs_no_orientations(tmp_path: Path) -> None:
    path = tmp_path / "robot.csv"
    path.write_text("t;X;Y;Z\n0;1000;0;500\n100;1200;0;500\n200;1400,0;0;500\n")
    form = MotionForm(columns="t=ms,robot_x=X/mm,robot_y=Y/mm,robot_z=4/mm")
    report = Trajectory(read_robot_csv(path, form)).report(1, 0)
    assert report.stamp_ns == 100_000_000
    assert report.objects[0].position_m == pytest.approx((1.2, 0.0, 0.5))
    assert report.objects[0].velocity_mps == pytest.approx((2.0, 0.0, 0.0))


@pytest.mark.parametrize(("path", "what"), [("", "recording: is missing"), ("/none.csv", "cannot be read")])
async def test_replay_does_not_start_without_a_recording(path: str, what: str) -> None:
    bus = MemoryBus()
    launch = Launch(service=RobotReplay, config=RobotReplayConfig(recording=path))
    with pytest.raises(ConfigError, match=what):
        await run_service(launch, bus, VirtualClock())
    await bus.close()
