"""Seeds of a run: everything random in it derives from one, and only from that."""

from collections.abc import Sequence

import pytest

from pointit.launch.plan.launches import Choices, site_launches, user_launches
from pointit.launch.plan.scenario import read_scenario
from pointit.launch.plan.seeds import seed_of
from tests.integration.scenario.play import USER, play


def packages(seed: int, settings: Sequence[str] = ()) -> list[tuple[str, float]]:
    """Return kind and time of every package of a run, in the order of their coming."""
    outcome = play("scenario_4", Choices(seed=seed, settings=settings), 40.0)
    return [(outcome.kinds[name], round(at_s, 2)) for name, at_s in outcome.fed_s.items()]


def test_the_seed_of_a_run_decides_which_packages_come_and_when() -> None:
    first, again, other = packages(1), packages(1), packages(2)
    assert len(first) >= 6
    assert first == again
    assert first != other
    assert {at_s for _, at_s in first} != {at_s for _, at_s in other}


def test_a_seed_set_for_the_conveyor_alone_holds_whatever_the_run_has() -> None:
    chosen = ("conveyor-sim.seed=5",)
    assert packages(1, chosen) == packages(2, chosen)


@pytest.mark.parametrize("seed", [0, 7])
def test_every_random_part_has_a_stream_of_its_own(seed: int) -> None:
    scenario = read_scenario("scenario_4")
    choices = Choices(seed=seed, imu=("simulated", "simulated"))
    launches = [
        *site_launches(scenario, choices),
        *user_launches(scenario, choices, USER),
        *user_launches(scenario, choices, "ben", 1),
    ]
    configs = {launch.instance: launch.config.model_dump() for launch in launches}
    seeds = {
        "conveyor-sim": configs["conveyor-sim"]["seed"],
        f"imu-bridge.{USER}": configs[f"imu-bridge.{USER}"]["simulated"]["seed"],
        "imu-bridge.ben": configs["imu-bridge.ben"]["simulated"]["seed"],
    }
    assert seeds == {part: seed_of(seed, part) for part in seeds}
    assert len({*seeds.values()}) == len(seeds)
