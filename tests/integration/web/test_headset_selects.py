"""People of pages who select by headset and are localized by mouse."""

import asyncio
import math
import os
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast
from unittest import mock

import numpy as np
import pytest
from pydantic import TypeAdapter

from pointit.bridges.web.config import Place, WebConfig
from pointit.bridges.web.model.people import PagePeople
from pointit.bridges.web.wire import AimAt, HeadsetMotion, Received
from pointit.bridges.web.wrists.wrist_control import WristControl
from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.launch.plan.launches import Choices, site_launches, user_launches
from pointit.launch.plan.plan import read_scenario
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.service.service import Launch, run_services
from pointit.runtime.virtual_time import VirtualClock, run_virtually
from pointit.schemas import ButtonEvent, Cursor, Environment, Localization, SelectionEvent, UserPose
from pointit.schemas.topics import BUTTON, CURSOR, LOCALIZATION, MAP, POSE, PROFILE, SELECTION_EVENTS, WRIST
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.service import ImuBridge
from pointit.services.user_sim.service import UserSim
from pointit.sim.aim import Tremor
from tests.integration.scenario.play import running, with_fresh_state

ANNA = "anna"
BEN = "ben"
EYES_M: Vec3 = (0.0, 0.0, 1.5)
THINGS: dict[str, Vec3] = {name: (2.0, y_m, 1.3) for name, y_m in (("cup", -0.4), ("jar", 0.0), ("tin", 0.4))}
"""Things .4 m apart at 2 m."""
YAW_RAD = 0.8
"""Alignment of the headset's space by touches: yaw."""
ORIGIN_M = (0.3, -0.2, 0.01)
"""Its origin."""
FRAME_S = 1.0 / 72.0
REACH_M = 0.5
ALIGNMENT_ERROR_M = 0.02
TREMOR_RAD = math.radians(0.5)
SWAY_M = 0.003
PINCH_M: Vec3 = (0.0, 0.07, -0.01)
"""Displacement of the tip of the index finger at the end of a pinch, {W}: beyond the thing's neighbour."""
CLOSING_S = 0.2
CLOSED_S = 0.6
MAX_TRIES = 3
"""Another person may hold a thing for a moment."""
RECEIVED: TypeAdapter[Any] = TypeAdapter(Received)


@dataclass
class Wearer:
    """The wearer of a headset, and the page in it."""

    bus: MemoryBus
    clock: VirtualClock
    events: list[SelectionEvent] = field(default_factory=list[SelectionEvent])

    def __post_init__(self) -> None:
        self._wrists = WristControl(WebConfig())
        self._people = PagePeople(cast("ServiceBus", self.bus), self.clock)
        self._people.on_join(ANNA)
        self._wrists.acquire(ANNA, "page1", "headset")
        self._rng = np.random.default_rng(3)
        self._tremor = Tremor(TREMOR_RAD, self._rng)
        self.bus.subscribe(SELECTION_EVENTS, lambda event, _name: self.events.append(event))

    def fired(self) -> list[str]:
        """Return the things that the wearer has fired or selected."""
        return [each.object_id for each in self.events if (each.user, each.event) == (ANNA, "selected")]

    async def frame(self, at_m: Vec3, pinched: float = 0.0) -> None:
        """Point over the fingertip at `at_m`, {W}, for one frame. `pinched`: share of a pinch, 0 to 1."""
        left_rad, up_rad = self._tremor.step(FRAME_S)
        eyes_m = vector.add(EYES_M, cast("Vec3", tuple(self._rng.normal(0.0, SWAY_M, 3).tolist())))
        line = vector.normalized(vector.subtract(at_m, eyes_m))
        line = vector.direction(vector.azimuth(line) + left_rad, vector.elevation(line) + up_rad)
        tip_m = vector.add(vector.add(eyes_m, vector.scale(line, REACH_M)), vector.scale(PINCH_M, pinched))
        alignment = {"yaw_rad": YAW_RAD, "origin_m": [ORIGIN_M[0] + ALIGNMENT_ERROR_M, *ORIGIN_M[1:]]}
        eyes, tip = (vector.rotate_z(vector.subtract(each, ORIGIN_M), -YAW_RAD) for each in (eyes_m, tip_m))
        motion = RECEIVED.validate_python(
            {"kind": "headset", "user": ANNA, "eyes_m": eyes, "tip_m": tip, "alignment": alignment}
        )
        assert isinstance(motion, HeadsetMotion)
        measured = self._wrists.move_by_headset("page1", motion, self.clock.now_ns())
        assert measured is not None
        if measured[0] is not None:
            self._people.place(ANNA, measured[0])
        self._people.move(ANNA, measured[1])
        await asyncio.sleep(FRAME_S)

    async def point(self, at_m: Vec3, duration_s: float) -> None:
        for _ in range(round(duration_s / FRAME_S)):
            await self.frame(at_m)

    async def pinch(self, at_m: Vec3) -> None:
        """Close and open the fingers. The page sends the press at the end, with its duration."""
        frames = round(CLOSING_S / FRAME_S)
        for number in range(frames):
            share = (number + 1) / frames
            await self.frame(at_m, share**3 * (10.0 - 15.0 * share + 6.0 * share**2))
        for _ in range(round(CLOSED_S / FRAME_S)):
            await self.frame(at_m, 1.0)
        self._people.press(ANNA, source="headset", held_s=CLOSED_S)


def run(folder: Path, *, pinches: bool, users: tuple[str, ...]) -> list[str]:
    """Return the things that anna fires when she means each of them in turn."""
    things = "".join(
        f"  {name}: {{center: {list(at_m)}, size: [.2, .2, .2], press: {str(pinches).lower()}}}\n"
        for name, at_m in THINGS.items()
    )
    room = folder / "counter.yaml"
    room.write_text(f"things:\n{things}", encoding="utf-8")
    return with_fresh_state(_run(str(room), pinches=pinches, users=users))


async def _run(room: str, *, pinches: bool, users: tuple[str, ...]) -> list[str]:
    plan = read_scenario(room)
    choices = Choices(seed=1, imu=["page"])
    launches = site_launches(plan, choices)
    for index, user in enumerate(users):
        launches += user_launches(plan, choices, user, index)
    bus = MemoryBus(LocalBroker())
    clock = VirtualClock()
    wearer = Wearer(bus, clock)

    async def script() -> list[str]:
        await wearer.point((2.0, 0.0, 2.2), 3.0)
        for name, at_m in THINGS.items():
            for _ in range(MAX_TRIES):
                await wearer.point(at_m, 1.0 if pinches else 3.0)
                if pinches:
                    await wearer.pinch(at_m)
                await wearer.point((2.0, 0.0, 2.2), 0.3)
                if name in wearer.fired():
                    break
        return wearer.fired()

    async with running(launches, bus, clock) as services:
        wearing = asyncio.create_task(script())
        await asyncio.wait({services, wearing}, return_when=asyncio.FIRST_COMPLETED)
        return await wearing


@pytest.mark.parametrize("users", [(ANNA,), (ANNA, BEN)], ids=["alone", "beside a person with a wrist"])
@pytest.mark.parametrize("pinches", [False, True], ids=["by staying", "by pinching"])
def test_headset_selects_three_of_three_close_things(
    tmp_path: Path, users: tuple[str, ...], *, pinches: bool
) -> None:
    assert run(tmp_path, pinches=pinches, users=users) == list(THINGS)


USER = "anna"
PLACE = Place(position_m=(2.3, 0.2, 0.0), yaw_deg=35.0)
"""The person's true pose, known to the page only."""
STRIP: Vec3 = (4.85, 1.0, 0.9)


class Hand:
    """A page's mouse: what the service does with `WristControl`, and a hand that goes where asked."""

    def __init__(self, bus: MemoryBus, clock: VirtualClock) -> None:
        self.wrists = WristControl(WebConfig(places={USER: PLACE}))
        self.clock = clock
        self.lamps: dict[str, Vec3] = {}
        self.solved = asyncio.Event()
        self.pose: UserPose | None = None
        self.cursors: list[Cursor] = []
        self._wrist = bus.publisher(WRIST, USER)
        self._button = bus.publisher(BUTTON, USER)
        bus.subscribe(MAP, lambda room, _name: self._on_map(room))
        bus.subscribe(PROFILE, lambda profile, name: self.wrists.profile(name, profile), USER)
        bus.subscribe(POSE, self._on_pose, USER)
        bus.subscribe(LOCALIZATION, self._on_localization, USER)
        bus.subscribe(CURSOR, lambda cursor, _name: self.cursors.append(cursor), USER)

    def press(self) -> None:
        self._button.put(ButtonEvent(stamp_ns=self.clock.now_ns(), seq=1, source="page"))

    def aim(self, at_m: Vec3) -> None:
        self.wrists.aim("page1", AimAt(user=USER, at_m=at_m))

    async def move(self) -> None:
        while True:
            for _, sample in self.wrists.step(self.clock.now_ns()):
                self._wrist.put(sample)
            await asyncio.sleep(1.0 / 60.0)

    def _on_map(self, room: Environment) -> None:
        self.wrists.room(room)
        self.lamps = {lamp.id: lamp.position_m for lamp in room.lamps}

    def _on_pose(self, pose: UserPose, name: str) -> None:
        self.pose = pose
        self.wrists.pose(name, pose)

    def _on_localization(self, progress: Localization, name: str) -> None:
        self.wrists.localization(name, progress)
        if progress.phase == "solved":
            self.solved.set()
        if progress.phase == "sampling" and progress.target_id:
            self.aim(self.lamps[progress.target_id])


async def _localize(tremor_deg: float) -> Hand:
    plan = read_scenario("scenario_2")
    choices = Choices(seed=1, localize=True, targets=3)
    launches = [*site_launches(plan, choices), *user_launches(plan, choices, USER)]
    mine = [one for one in launches if one.service not in (UserSim, ImuBridge)]
    mine.append(Launch(service=ImuBridge, config=ImuBridgeConfig(source="page"), user=USER))
    bus = MemoryBus(LocalBroker())
    clock = VirtualClock()
    hand = Hand(bus, clock)
    hand.wrists.acquire(USER, "page1", "mouse")
    hand.wrists.set_tremor(USER, "page1", tremor_deg)
    running = asyncio.create_task(run_services(mine, bus, clock))
    moving = asyncio.create_task(hand.move())
    try:
        await asyncio.sleep(2.0)
        hand.press()
        async with asyncio.timeout(40.0):
            await hand.solved.wait()
        hand.aim(STRIP)
        await asyncio.sleep(2.0)
    finally:
        for task in (running, moving):
            task.cancel()
        await asyncio.gather(running, moving, return_exceptions=True)
        await bus.close()
    return hand


@pytest.mark.parametrize(("tremor_deg", "most_m"), [(0.0, 0.001), (0.2, 0.05)])
def test_mouse_pointing_at_lamps_localizes_the_person(tremor_deg: float, most_m: float) -> None:
    with tempfile.TemporaryDirectory() as state, mock.patch.dict(os.environ, {"POINTIT_STATE": state}):
        hand = run_virtually(_localize(tremor_deg))
    assert hand.pose is not None
    assert hand.pose.method == "static_targets"
    assert math.dist(hand.pose.position_m, PLACE.position_m) < most_m
    assert abs(vector.wrap(hand.pose.yaw_rad - math.radians(PLACE.yaw_deg))) < math.radians(1.0)
    beside_m = [math.dist(cursor.point_m, STRIP) for cursor in hand.cursors[-20:] if cursor.point_m]
    assert len(beside_m) == 20
    assert max(beside_m) < 0.01 + most_m
