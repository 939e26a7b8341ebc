"""Scenarios 2 and 3 as shipped: real services on a bus in memory, virtual time, a simulated person."""

from collections.abc import Sequence

import numpy as np
import pytest

from pointit.launch.plan.launches import Choices
from tests.integration.scenario.play import USER, Outcome, play

ALL_PASS = ("conveyor-sim.feeder.count=22",)
"""So many segments have passed before the end; those that are fed last would count as missed."""


def assert_all_red_and_no_other(outcome: Outcome, taken_back: int = 0) -> None:
    selected, missed, wrong = outcome.final("red")
    assert selected >= 4  # the scenario feeds that many at least
    assert (missed, wrong) == (0, 0)
    assert len(outcome.of("deselected", "red")) <= taken_back
    assert set(outcome.kinds.values()) > {"red"}  # there were others to go wrong with


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_person_selects_exactly_the_red_segments_within_60_s(seed: int) -> None:
    assert_all_red_and_no_other(play("scenario_3", Choices(seed=seed, settings=ALL_PASS)))


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3, 21))
def test_so_do_many_people(seed: int) -> None:
    """At most one is deselected by accident and selected again. The rate for seeds 1 to 30 is one in 300."""
    assert_all_red_and_no_other(play("scenario_3", Choices(seed=seed, settings=ALL_PASS)), taken_back=1)


@pytest.mark.slow
def test_with_a_real_wristband_too() -> None:
    drift = ("user-sim.wristband.yaw_rate_bias_sd_degps=0.25", "user-sim.wristband.dropout_share=0.05")
    settings = (*drift, *ALL_PASS)
    selected, missed, wrong = zip(
        *(play("scenario_3", Choices(seed=seed, settings=settings)).final("red") for seed in (1, 2)),
        strict=True,
    )
    assert sum(selected) >= 18
    assert sum(missed) <= 1, "of seeds 1 to 8, one in 80"
    assert sum(wrong) == 0


@pytest.mark.slow
def test_person_without_light_finds_no_cursor_and_presses_in_vain() -> None:
    """Frames are the only feedback: with the strips dark nobody corrects anything."""
    dark = "led-driver.brightness=0"
    outcome = play("scenario_3", Choices(seed=1, settings=(dark,)), 40.0)
    assert "pointing" in outcome.states
    assert outcome.states.count("idle") > 3  # they press: perhaps nobody knows that they point
    selected, missed, _ = outcome.final("red")
    assert missed > selected


@pytest.mark.slow
def test_scenario_2_leads_the_cursor_along_both_whole_strips() -> None:
    outcome = play("scenario_2", Choices(seed=1))
    for strip in ("0", "1"):
        along = np.array([c.position_m for c in outcome.cursors if c.surface_id == strip])
        assert along.min() < 0.2
        assert along.max() > 4.8
        assert len(along) > 500


def packages(seed: int, settings: Sequence[str] = (), users: Sequence[str] = ()) -> list[tuple[str, float]]:
    """Return kind and time of every package of a run, in the order of their coming."""
    outcome = play("scenario_4", Choices(seed=seed, settings=settings), 20.0, users=users)
    return [(outcome.kinds[name], round(at_s, 2)) for name, at_s in outcome.fed_s.items()]


def test_seed_of_a_run_decides_which_packages_come_and_when() -> None:
    first = packages(1)
    again = packages(1)
    other = packages(2)
    assert len(first) >= 3
    assert first == again
    assert first != other
    assert {at_s for _, at_s in first} != {at_s for _, at_s in other}


@pytest.mark.slow
def test_conveyors_own_seed_has_precedence_over_the_runs_seed() -> None:
    chosen = ("conveyor-sim.seed=5",)
    assert packages(1, chosen) == packages(2, chosen, (USER,))
