"""The golden sessions, and how one is played: real services on a bus in memory, in virtual time."""

import asyncio
import contextlib
import csv
import math
import os
import tempfile
from collections.abc import Callable, Coroutine, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar
from unittest import mock

from pointit.launch.plan.launches import Choices, shard_launches, site_launches, user_launches
from pointit.launch.plan.plan import read_scenario
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.service.service import Launch, run_services
from pointit.runtime.virtual_time import START_NS, VirtualClock, run_virtually
from pointit.schemas import NS_PER_S
from tests.golden import scripts
from tests.golden.bad_link import BadLink

L = TypeVar("L")

ROBOT = "robot.csv"
"""A recording that `play` writes into the folder it runs in."""

Script = Callable[[MemoryBus], Coroutine[Any, Any, None]]
"""Acts of others during a session: requests, presses, objects of a camera."""


@dataclass(frozen=True, kw_only=True)
class Session:
    """One or several people in a shipped scenario, for some seconds of virtual time."""

    scenario: str
    duration_s: float
    happens: tuple[str, ...]
    """Messages that must be recorded: `key`, or `key=value` for one that has this value in a field."""
    choices: Choices = field(default_factory=lambda: Choices(seed=1))
    users: tuple[str, ...] = ("anna",)
    site: Mapping[str, dict[str, Any]] = field(default_factory=dict[str, dict[str, Any]])
    """Parameters of further site services, by service."""
    restarts: bool = False
    """Restart every service but the simulated person, one after the other."""
    script: Script | None = None
    shard_s: float | None = None
    """Shards serve the first person; they end after so long."""
    room: str = ""
    """Map file, which `play` writes as `room.yaml`."""
    link: Callable[[LocalBroker], MemoryBus] = MemoryBus


def choices(*settings: str, localize: bool = False, **chosen: Any) -> Choices:
    return Choices(seed=1, localize=localize, settings=settings, **chosen)


SESSIONS: dict[str, Session] = {
    "scenario 1": Session(
        scenario="scenario_1", duration_s=15.0, happens=("leds/led_1/color", "users/anna/cursor=lamp")
    ),
    "scenario 2": Session(scenario="scenario_2", duration_s=15.0, happens=("users/anna/cursor=strip",)),
    "scenario 3, fraction": Session(
        scenario="scenario_3", duration_s=30.0, happens=("selection/events=selected",)
    ),
    "scenario 4, gauge": Session(
        scenario="scenario_4",
        duration_s=40.0,
        happens=("selection/events=selected", "selection/events=dispatched"),
    ),
    "scenario 3, hold": Session(
        scenario="scenario_3",
        duration_s=20.0,
        choices=choices(method="hold"),
        happens=("selection/events=selected",),
    ),
    "send_a_robot": Session(scenario="send_a_robot", duration_s=30.0, happens=("users/anna/goal",)),
    "localized by lamps": Session(
        scenario="scenario_2",
        duration_s=60.0,
        choices=choices(
            "user-sim.aim.elevation_bias_deg=10", "user-sim.wristband.yaw_drift_degpmin=40", localize=True
        ),
        happens=("users/anna/pose=static_targets", "users/anna/anchor", "users/anna/cursor=strip"),
    ),
    "localized by a robot": Session(
        scenario="scenario_2",
        duration_s=30.0,
        choices=choices("localizer.method=moving_target", localize=True),
        site={"robot-replay": {"recording": ROBOT}},
        happens=("users/anna/pose=moving_target", "users/anna/cursor=strip"),
    ),
    "two people": Session(
        scenario="scenario_3",
        duration_s=45.0,
        choices=choices(localize=True),
        users=("anna", "ben"),
        happens=(
            "users/anna/pose=static_targets",
            "users/ben/pose=static_targets",
            "selection/events=selected",
        ),
    ),
    "four people": Session(
        scenario="scenario_4",
        duration_s=35.0,
        users=("anna", "ben", "carl", "dora"),
        happens=("selection/events=dispatched", "users/dora/hover"),
    ),
    "a restart of each service": Session(
        scenario="scenario_3", duration_s=30.0, restarts=True, happens=("selection/events=selected",)
    ),
    "a bad link": Session(
        scenario="scenario_3", duration_s=30.0, link=BadLink, happens=("selection/events=selected",)
    ),
    "an offset": Session(
        scenario="scenario_2",
        duration_s=48.0,
        choices=choices("user-sim.aim.elevation_bias_deg=6", localize=True),
        script=scripts.calibrates,
        happens=("users/anna/pose=static_targets", "users/anna/cursor=strip"),
    ),
    "taken back": Session(
        scenario="scenario_3",
        duration_s=25.0,
        choices=choices(method="gauge"),
        users=("anna", "ben"),
        script=scripts.takes_back,
        happens=("selection/events=undo", "selection/events=release", "selection/events=clear"),
    ),
    "another method": Session(
        scenario="scenario_3",
        duration_s=24.0,
        script=scripts.chooses_method,
        happens=("selection/events=selected",),
    ),
    "belts": Session(
        scenario="scenario_4",
        duration_s=34.0,
        choices=choices("conveyor-sim.tracking.latency_s=0.1", "selector.method=hold"),
        script=scripts.runs_belts,
        happens=("selection/events=dispatched", "conveyor/state"),
    ),
    "a shard and workspaces": Session(
        scenario="scenario_2",
        duration_s=20.0,
        choices=choices("pui.map=room.yaml", services=("selector",)),
        users=("anna", "ben"),
        script=scripts.moves_on_workspaces,
        shard_s=17.8,
        room=scripts.ROOM,
        happens=(
            "users/anna/cursor=workspace/horizontal",
            "users/anna/cursor=workspace/facing",
            "users/anna/cursor=workspace/cylinder",
            "users/anna/cursor=workspace/sphere",
        ),
    ),
    "solids": Session(
        scenario="scenario_3",
        duration_s=18.0,
        choices=choices(
            "pui.map=room.yaml",
            "pui.surfaces=[strip,box,cylinder,sphere,plane]",
            "conveyor-sim.feeder.sequence=[]",
            "selector.confirm=press",
            "supervisor.press_while_pointing=confirms",
        ),
        script=scripts.presses,
        room=scripts.ROOM,
        happens=("selection/events=selected", "selection/events=deselected", "users/anna/cursor=crate"),
    ),
    "a quadrotor and a visitor": Session(
        scenario="scenario_5",
        duration_s=32.0,
        script=scripts.walks_by,
        happens=("users/anna/steering", "robots/quad/state"),
    ),
    "a rover": Session(
        scenario="scenario_6",
        duration_s=24.0,
        users=("anna", "ben"),
        happens=("users/anna/steering", "robots/rover/plan"),
    ),
    "lamps": Session(
        scenario="scenario_1", duration_s=9.0, script=scripts.lights_lamps, happens=("leds/led_0/color",)
    ),
}


def play(session: Session, listen: Callable[[MemoryBus], L], *, through_link: bool = False) -> L:
    """Run `session` without stored state and `POINTIT_*` variables.

    Return what `listen` made of a bus on which all messages of its services can be read, as they were sent,
    or `through_link` as they arrive.
    """
    others = {name: value for name, value in os.environ.items() if not name.startswith("POINTIT_")}
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        _write_robot(Path(ROBOT))
        Path("room.yaml").write_text(session.room, encoding="utf-8")
        with mock.patch.dict(os.environ, others | {"POINTIT_STATE": folder}, clear=True):
            return run_virtually(_play(session, listen, through_link=through_link))


def _write_robot(path: Path) -> None:
    """Write the recording of a robot that drives a figure of eight around the place where people stand."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["t", "qw", "qx", "qy", "qz", "robot_x", "robot_y", "robot_z"])
        for tick in range(25 * 60):
            angle = 0.4 * tick / 25
            x = 2.0 + 2.5 * math.cos(angle)
            y = 0.5 + 1.5 * math.sin(2 * angle)
            numbers = (tick / 25, 1, 0, 0, 0, x, y, 0.1)
            rows.writerow([f"{number:.4f}" for number in numbers])


async def _play(session: Session, listen: Callable[[MemoryBus], L], *, through_link: bool) -> L:
    plan = read_scenario(session.scenario)
    site = {**plan.site, **session.site}
    plan = plan.model_copy(update={"site": site})
    launches = site_launches(plan, session.choices)
    for index, user in enumerate(session.users):
        launches += user_launches(plan, session.choices, user, index)
    shards: list[Launch] = []
    if session.shard_s is not None:
        shards = shard_launches(plan, session.choices, session.users[0])

    # the onlooker listens first: to messages as they were sent, or as they arrive through the link
    exchange = LocalBroker()
    onlooker_link = session.link if through_link else MemoryBus
    onlooker = onlooker_link(exchange)
    bus = session.link(exchange)
    heard = listen(onlooker)

    # services, shards that end early, and the acts of others
    lives = [asyncio.create_task(_live(launch, bus)) for launch in launches]
    served = [asyncio.create_task(_live(launch, bus)) for launch in shards]
    asyncio.get_running_loop().call_later(session.shard_s or 0.0, _cancel, served)
    scripted = asyncio.create_task(session.script(onlooker)) if session.script else None
    if session.restarts:
        await _restart_each(launches, lives, bus, session.duration_s)
    passed_s = (VirtualClock().now_ns() - START_NS) / NS_PER_S
    await asyncio.wait(lives, timeout=session.duration_s - passed_s)
    if scripted is not None:
        scripted.result()
    _cancel(lives)
    for result in await asyncio.gather(*lives, *served, return_exceptions=True):
        assert isinstance(result, asyncio.CancelledError), f"a service ended by itself: {result!r}"
    await asyncio.sleep(1.0)
    await bus.close()
    await onlooker.close()
    return heard


def _cancel(lives: Sequence[asyncio.Task[None]]) -> None:
    for life in lives:
        life.cancel()


async def _live(launch: Launch, bus: MemoryBus) -> None:
    await run_services([launch], bus, VirtualClock())


async def _restart_each(
    launches: Sequence[Launch], lives: list[asyncio.Task[None]], bus: MemoryBus, duration_s: float
) -> None:
    pause_s = 0.6 * duration_s / len(launches)
    await asyncio.sleep(0.2 * duration_s)
    for index, launch in enumerate(launches):
        if launch.service.NAME == "user-sim":
            continue
        lives[index].cancel()
        await asyncio.gather(lives[index], return_exceptions=True)
        await asyncio.sleep(0.2)
        lives[index] = asyncio.create_task(_live(launch, bus))
        await asyncio.sleep(pause_s - 0.2)
