"""Two people of unknown place in one room, virtual time: both end up pointing (`--localize --users 2`)."""

import asyncio
import math

import pytest

from pointit.launch.plan.launches import Choices, site_launches, user_launches
from pointit.launch.plan.scenario import read_scenario
from pointit.runtime.bus.local_broker import LocalBroker
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.service.service import run_services
from pointit.runtime.virtual_time import VirtualClock, run_virtually
from pointit.schemas import UserPose
from pointit.schemas.topics import INTERACTION, POSE
from pointit.services.localizer.certainty import UNSURE_M, position_sigma_m

USERS = ("user1", "user2")


async def _localize(seed: int, duration_s: float) -> tuple[dict[str, list[str]], dict[str, UserPose]]:
    plan = read_scenario("scenario_3")
    choices = Choices(seed=seed, localize=True)
    launches = list(site_launches(plan, choices))
    for index, user in enumerate(USERS):
        launches += user_launches(plan, choices, user, index)
    bus = MemoryBus(LocalBroker())
    states: dict[str, list[str]] = {user: [] for user in USERS}
    poses: dict[str, UserPose] = {}
    bus.subscribe(INTERACTION, lambda now, user: states[user].append(now.state))
    bus.subscribe(POSE, lambda pose, user: poses.update({user: pose}))
    running = asyncio.create_task(run_services(launches, bus, VirtualClock()))
    await asyncio.wait({running}, timeout=duration_s)
    if running.done():
        running.result()
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    await bus.close()
    return states, poses


@pytest.mark.parametrize("seed", [1, 2])
def test_both_are_localized_one_after_the_other_and_point(seed: int) -> None:
    plan = read_scenario("scenario_3")
    states, poses = run_virtually(_localize(seed, 60.0))
    for index, user in enumerate(USERS):
        assert states[user][-1] == "pointing", states
        place = plan.places[index % len(plan.places)]
        sigma_m = position_sigma_m(poses[user])
        assert sigma_m <= UNSURE_M
        assert math.dist(poses[user].position_m[:2], place.position_m[:2]) <= 3.0 * sigma_m
