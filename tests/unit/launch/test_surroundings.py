"""Settings that a joining person adopts from the site."""

import pytest

from pointit.launch.plan.launches import CURSOR_COLORS
from pointit.launch.run.surroundings import USUAL, free_place, surroundings
from pointit.runtime.bus.local_broker import LocalBroker
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.schemas import Deployment, UserProfile
from pointit.schemas.topics import DEPLOYMENT, PROFILE


def runs(bus: MemoryBus, name: str) -> None:
    """Publish a deployment as `run` and `user` do; a person's has no scenario."""
    scenario, key = ("", name) if name == "anna" else (name, f"run.{name}")
    bus.publisher(DEPLOYMENT, key).put(Deployment(stamp_ns=1, name=name, scenario=scenario))


@pytest.mark.parametrize(
    ("names", "scenario"),
    [
        (["scenario_4", "anna"], "scenario_4"),
        (["scenario_1"], "scenario_1"),
        ([], USUAL),
        (["mine"], USUAL),
        (["scenario_1", "scenario_2"], USUAL),
    ],
)
async def test_who_joins_takes_part_in_what_runs_there(names: list[str], scenario: str) -> None:
    bus = MemoryBus(LocalBroker())
    for name in names:
        runs(bus, name)
    assert await surroundings(bus) == (scenario, 1)
    await bus.close()


async def test_who_joins_has_the_first_colour_that_nobody_has() -> None:
    bus = MemoryBus(LocalBroker())
    for user, color in (("user1", CURSOR_COLORS[0]), ("ben", CURSOR_COLORS[2])):
        bus.publisher(PROFILE, user).put(UserProfile(stamp_ns=1, cursor_color=color))
    assert await surroundings(bus) == (USUAL, 2)
    await bus.close()


def test_more_people_than_colours_find_a_place_too() -> None:
    assert free_place(CURSOR_COLORS) == len(CURSOR_COLORS) + 1
    assert free_place([(1, 2, 3)]) == 1
