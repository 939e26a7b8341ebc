"""Localization of a mouse user: real services on a bus in memory, virtual time; the hand is scripted.

It points at whatever lamp it is asked to, from the place that the page takes for true.
"""

import asyncio
import math
import os
import tempfile
from unittest import mock

import pytest

from pointit.bridges.web.config import Place, WebConfig
from pointit.bridges.web.wire import AimAt
from pointit.bridges.web.wrists.wrist_control import WristControl
from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.launch.plan.launches import Choices, site_launches, user_launches
from pointit.launch.plan.plan import read_scenario
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.clock import VirtualClock, run_virtually
from pointit.runtime.service.service import Launch, run_services
from pointit.schemas import ButtonEvent, Cursor, Environment, Localization, UserPose
from pointit.schemas.topics import BUTTON, CURSOR, LOCALIZATION, MAP, POSE, PROFILE, WRIST
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.service import ImuBridge
from pointit.services.user_sim.service import UserSim

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
    plan, choices = read_scenario("scenario_2"), Choices(seed=1, localize=True, targets=3)
    launches = [*site_launches(plan, choices), *user_launches(plan, choices, USER)]
    mine = [one for one in launches if one.service not in (UserSim, ImuBridge)]
    mine.append(Launch(service=ImuBridge, config=ImuBridgeConfig(source="page"), user=USER))
    bus, clock = MemoryBus(LocalBroker()), VirtualClock()
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
def test_who_points_at_lamps_by_mouse_is_found_where_the_page_has_them(
    tremor_deg: float, most_m: float
) -> None:
    with tempfile.TemporaryDirectory() as state, mock.patch.dict(os.environ, {"POINTIT_STATE": state}):
        hand = run_virtually(_localize(tremor_deg))
    assert hand.pose is not None
    assert hand.pose.method == "static_targets"
    assert math.dist(hand.pose.position_m, PLACE.position_m) < most_m
    assert abs(vector.wrap(hand.pose.yaw_rad - math.radians(PLACE.yaw_deg))) < math.radians(1.0)
    beside_m = [math.dist(cursor.point_m, STRIP) for cursor in hand.cursors[-20:] if cursor.point_m]
    assert len(beside_m) == 20
    assert max(beside_m) < 0.01 + most_m
