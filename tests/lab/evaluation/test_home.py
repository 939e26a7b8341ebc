"""Simulated people who place the lamps of their homes: what goes wrong is noticed, what is stated is true."""

import json

import pytest
from click.testing import CliRunner

from pointit_lab.cli.home import home
from pointit_lab.evaluation.home.simulated_home import MISTAKES, Mistake, row_of, simulate_home

SEEDS = range(9000, 9004)


@pytest.mark.parametrize("mistake", MISTAKES)
def test_placed_lamps_are_where_they_are_stated_to_be(mistake: Mistake) -> None:
    results = [simulate_home((seed, mistake)) for seed in SEEDS]
    row = row_of(mistake, results)
    assert row.beyond == 0
    assert row.within.value >= 0.9
    assert row.lamps >= 3 * len(SEEDS) - row.left_out
    assert row.unsure.value < 0.5


@pytest.mark.parametrize("mistake", ["double press", "small base line"])
def test_mistake_is_noticed_in_nearly_every_home(mistake: Mistake) -> None:
    row = row_of(mistake, [simulate_home((seed, mistake)) for seed in SEEDS])
    assert row.noticed.count >= 3


def test_evaluation_of_homes_writes_its_rows_as_json() -> None:
    ended = CliRunner().invoke(home, ["--homes", "7", "--jobs", "1", "--json", "-"])
    assert ended.exit_code == 0, ended.output
    rows = json.loads(ended.stdout)["rows"]
    assert [row["mistake"] for row in rows] == [*MISTAKES, "all"]
