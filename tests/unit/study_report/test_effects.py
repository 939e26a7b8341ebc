"""A known effect is found and none is not, and power is that of theory."""

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from pointit import study_report
from pointit.errors import PointItError
from pointit.study_report import power
from tests.unit.study_report.generated import RINGS, write_study

SEEDS = 20


def significant(folder: Path, effect: float) -> int:
    """Return the number of studies of 12 people in which press differs from dwell, p < 0.05."""
    found = 0
    for seed in range(SEEDS):
        place = folder / str(seed)
        write_study(place, {"dwell": 1.0, "press": effect}, seed=seed, rings=RINGS[:1])
        (row,) = study_report.differences(study_report.trials(place))
        found += row["p"] < 0.05
    return found


def test_effect_of_ten_percent_is_found_over_20_seeds(tmp_path: Path) -> None:
    assert significant(tmp_path, 0.9) >= 18


def test_no_effect_is_found_where_there_is_none_over_20_seeds(tmp_path: Path) -> None:
    assert significant(tmp_path, 1.0) <= 3


def spread(values: np.ndarray, *, is_within: bool = True) -> power.Spread:
    return power.Spread(
        first=np.zeros_like(values), second=values, is_within=is_within, mean=1.0, difference=0.0
    )


def test_power_is_that_of_the_noncentral_t_distribution() -> None:
    people = spread(stats.norm.ppf((np.arange(2000) + 0.5) / 2000))
    for row in power.power(people, 0.5, (10, 30, 50), seed=1):
        n = row["participants"]
        at, noncentrality = stats.t.ppf(0.975, n - 1), 0.5 * np.sqrt(n)
        expected = stats.nct.sf(at, n - 1, noncentrality) + stats.nct.cdf(-at, n - 1, noncentrality)
        assert row["power"] == pytest.approx(expected, abs=0.03)


def test_without_an_effect_five_percent_of_studies_find_one() -> None:
    people = spread(stats.norm.ppf((np.arange(500) + 0.5) / 500))
    (row,) = power.power(people, 0.0, (20,), runs=4000)
    assert row["low"] < 0.05 < row["high"]
    groups = power.Spread(
        first=people.second, second=people.second, is_within=False, mean=1.0, difference=0.0
    )
    (row,) = power.power(groups, 0.0, (20,), runs=4000)
    assert row["low"] < 0.05 < row["high"]


def test_power_ends_where_it_suffices_and_needed_is_the_first_number_that_does() -> None:
    told: list[int] = []
    people = spread(stats.norm.ppf((np.arange(500) + 0.5) / 500))
    table = power.power(people, 0.5, range(4, 200), tell=told.append)
    assert told == [row["participants"] for row in table]
    assert told[-1] < 60
    for goal in power.GOALS:
        least, low, high = power.needed(table, goal)
        assert (low or 1000) <= (least or 0) <= (high or 0)
    expected = 34  # G*Power 3: difference between two dependent means, d = 0.5, power 0.8, two-sided
    _, low, high = power.needed(table, 0.8)
    assert (low or 1000) - 1 <= expected <= (high or 0) + 1
    assert power.needed(study_report.Table(table[:1]), 0.8) == (None, None, None)


def test_a_pilots_own_effect_is_replaced_by_the_stated_one(tmp_path: Path) -> None:
    write_study(tmp_path, {"dwell": 1.0, "press": 0.5}, rings=RINGS[:1])
    people = power.spread(study_report.trials(tmp_path), "method", "dwell", "press")
    assert people.second.mean() == pytest.approx(0.0, abs=1e-12)
    medians = study_report.participant_medians(study_report.trials(tmp_path), "selection_s", "method")
    assert people.second.std() == pytest.approx(np.std([*medians["press",].values()], ddof=1))
    with pytest.raises(PointItError, match="no level 'hold', but dwell, press"):
        power.spread(study_report.trials(tmp_path), "method", "dwell", "hold")
