"""`pointit run replay`: a recorded person through the real services, compared with motion capture."""

import asyncio
import contextlib
import dataclasses
import logging
from pathlib import Path
from typing import Any

import click

from pointit.cli.common.output import Section, console, print_json, print_table, to_json
from pointit.runtime.clock import SimulatedClock, sleep
from pointit.runtime.config.config import Layers
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.link import Link
from pointit.runtime.service.service import Launch, run_services
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import NS_PER_S, BodyMeasures, Localization, UserPose, UserProfile
from pointit.schemas.topics import LOCALIZATION, POSE, PROFILE
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.service import ImuBridge
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.service import Localizer
from pointit.services.pointing.config import PointingConfig
from pointit.services.pointing.service import Pointing
from pointit.services.robot_replay.config import RobotReplayConfig
from pointit.services.robot_replay.service import RobotReplay
from pointit.sim.accuracy import Accuracy, PoseError, reference_yaw_deg
from pointit.sim.recordings import OPERATOR, ImuRecording, read_imu_csv

log = logging.getLogger(__name__)

LEAD_S = 0.3
"""Wall time for all services to start before the first sample."""

TAIL_S = 0.7
"""Time of the recording after its last sample, for the last pose to arrive."""

STALE_S = 0.2
"""Age in wall time at which a sample makes no ray; the recording's time may run faster."""


async def replay(
    recording: Path,
    *,
    speed: float,
    duration_s: float | None,
    mounting: str,
    summary: Path | None,
    as_json: bool,
    user: str = "user1",
    body: BodyMeasures = OPERATOR,
) -> int:
    """Play `recording` through imu-bridge, pointing, localizer and robot-replay, and print the errors.

    Args:
        recording: CSV with the wrist's orientation and the robot's position; with the head's for the errors.
        speed: seconds of the recording per second of wall time.
        duration_s: seconds of the recording to play. None: all.
        mounting: the sensor's axis along the arm, as in imu-bridge.
        summary: where to write the result as JSON.
        as_json: print the result as JSON only.
        user: name of the person in keys.
        body: the recorded person's measures.

    Returns:
        The exit code: 0 if a pose was found, else 1.

    Raises:
        ConfigError: If the recording or the mounting cannot be used.
    """
    recorded = read_imu_csv(recording)
    if recorded.robot_m is None:
        raise ConfigError(f"{recording}: has no columns 'robot_x' to 'robot_z'; following needs a robot")
    clock = SimulatedClock(speed)
    start_ns = clock.now_ns() + round(LEAD_S * speed * NS_PER_S)
    length_s = recorded.duration_s if duration_s is None else min(duration_s, recorded.duration_s)
    launches = _launches(recording, start_ns, speed, mounting, user)
    accuracy = Accuracy(recorded, start_ns, reference_yaw_deg(recording))
    progress: list[Localization] = []

    def on_pose(pose: UserPose, _user: str) -> None:
        row = accuracy.add(pose)
        if not as_json:
            click.echo(_line(row))

    def on_progress(message: Localization, _user: str) -> None:
        if message.stamp_ns < start_ns + length_s * NS_PER_S:  # afterwards it only reports missing rays
            progress[:] = [message]

    bus = await ZenohBus.open(Link())
    try:
        bus.publisher(PROFILE, user).put(UserProfile(stamp_ns=clock.now_ns(), body=body))
        bus.subscribe(POSE, on_pose, user)
        bus.subscribe(LOCALIZATION, on_progress, user)
        if not as_json:
            click.echo(
                f"{recording.name}: {length_s:.0f} s, {length_s / speed:.0f} s to wait; "
                "the first pose is found after some seconds of pointing"
            )
            click.echo(_HEADER)
        end_ns = start_ns + round((length_s + TAIL_S) * NS_PER_S)
        work = asyncio.create_task(run_services(launches, bus, clock), name="replay services")
        try:
            ending = asyncio.create_task(
                sleep(clock, (end_ns - clock.now_ns()) / NS_PER_S), name="replay end"
            )
            await asyncio.wait({work, ending}, return_when=asyncio.FIRST_COMPLETED)
            ending.cancel()
        finally:
            last = progress[0].reason if progress else ""
            if not work.done():
                work.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await work
    finally:
        await bus.close()
    _report(_result(recorded, length_s, speed, accuracy, last), accuracy, summary, as_json=as_json)
    return 0 if accuracy.rows else 1


def _launches(recording: Path, start_ns: int, speed: float, mounting: str, user: str) -> list[Launch]:
    layers = Layers()
    layers.add({"mounting": mounting}, "--mounting")
    layers.add({"source": "replay", "replay": {"recording": str(recording), "start_ns": start_ns}}, "replay")
    robot = RobotReplayConfig(recording=str(recording), start_ns=start_ns)
    return [
        Launch(service=Localizer, config=LocalizerConfig(method="moving_target", autostart=True), user=user),
        Launch(service=Pointing, config=PointingConfig(stale_after_s=min(10.0, STALE_S * speed)), user=user),
        Launch(service=ImuBridge, config=layers.build(ImuBridgeConfig), user=user),
        Launch(service=RobotReplay, config=robot),
    ]


def _result(
    recorded: ImuRecording, length_s: float, speed: float, accuracy: Accuracy, reason: str
) -> dict[str, Any]:
    final = dataclasses.asdict(accuracy.rows[-1]) if accuracy.rows else None
    return {
        "recording": str(recorded.path),
        "duration_s": length_s,
        "speed": speed,
        "overall": accuracy.overall(),
        "buckets": accuracy.buckets(),
        "final": final,
        "reason": reason,
    }


def _report(result: dict[str, Any], accuracy: Accuracy, summary: Path | None, *, as_json: bool) -> None:
    if summary is not None:
        try:
            summary.write_text(to_json(result, indent=2) + "\n", encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"{summary}: cannot be written ({error.strerror or error})") from error
    if as_json:
        print_json(result)
        return
    if not accuracy.rows:
        click.echo(f"no pose was accepted: {result['reason'] or 'no rays met the robot'}")
        return
    rows = tuple(result["buckets"])
    print_table(console(), Section(name="errors", about="against motion capture, by time", rows=rows))
    click.echo("final: " + _line(accuracy.rows[-1]).strip())


_HEADER = "   time    position error    yaw error    1 sigma           residual    samples"


def _line(row: PoseError) -> str:
    position = "        -" if row.position_error_m is None else f"{row.position_error_m:7.3f} m"
    yaw = "       -" if row.yaw_error_deg is None else f"{row.yaw_error_deg:+7.1f}°"
    return (
        f"{row.t_s:5.1f} s         {position}     {yaw}    {row.position_sigma_m:.2f} m, "
        f"{row.yaw_sigma_deg:4.1f}°    {row.residual_deg:7.2f}°    {row.samples:7d}"
    )
