"""Differences between methods of selecting: claimed where there is one, and seldom where there is none."""

import numpy as np
import pytest

from pointit_lab.evaluation.selection.condition import CONVEYOR, Condition, conditions
from pointit_lab.evaluation.selection.difference import FEWEST, Difference, differences_of
from pointit_lab.evaluation.selection.score import Score

FIRST, SECOND = conditions([CONVEYOR])[:2]


def scores(errors: list[int], took_s: float = 3.0) -> list[Score]:
    """Return trials of four packages with so many errors each."""
    return [Score(targets=4, missed=count, took_s=[took_s + 0.1 * (k % 5)]) for k, count in enumerate(errors)]


def between(a: list[Score], b: list[Score], condition: Condition = FIRST) -> Difference:
    (difference,) = differences_of({(condition, "a"): a, (condition, "b"): b})
    return difference


def test_the_same_outcome_is_no_difference() -> None:
    same = between(scores([1, 0] * 20), scores([1, 0] * 20))
    assert (same.errors.value, same.errors.low, same.errors.high) == (0.0, 0.0, 0.0)
    assert same.claims == []


def test_a_clear_difference_is_claimed_with_its_direction() -> None:
    worse = between(scores([0] * 60), scores([1, 0, 0] * 20, took_s=2.5))
    assert (worse.method, worse.other, worse.trials) == ("b", "a", 60)
    assert worse.errors.value == pytest.approx(1 / 12)
    assert 0.0 < worse.errors.low < 1 / 12 < worse.errors.high < 0.2
    assert worse.time_s is not None
    assert worse.time_s.value == pytest.approx(-0.5)
    assert worse.claims == ["b errs more", "b is faster"]


def test_pairing_tells_a_small_difference_among_trials_that_vary_much() -> None:
    errors = [0, 4] * 20
    errs_more = [min(4, count + (k % 4 == 0)) for k, count in enumerate(errors)]
    assert between(scores(errors), scores(errs_more)).claims == ["b errs more"]


def test_few_trials_tell_nothing() -> None:
    few = {(FIRST, "a"): scores([0] * (FEWEST - 1)), (FIRST, "b"): scores([4] * (FEWEST - 1))}
    assert differences_of(few) == []


def test_every_pair_in_every_condition_and_intervals_widen_with_their_number() -> None:
    a, b = scores([0, 0, 1] * 20), scores([1, 0, 1] * 20)
    groups = {(condition, name): of for condition in (FIRST, SECOND) for name, of in (("a", a), ("b", b))}
    both = differences_of({**groups, (FIRST, "c"): a})
    assert [(each.condition, each.method, each.other) for each in both] == [
        (FIRST.name, "b", "a"),
        (FIRST.name, "c", "a"),
        (FIRST.name, "c", "b"),
        (SECOND.name, "b", "a"),
    ]
    alone = between(a, b)
    assert both[0].errors.high - both[0].errors.low > alone.errors.high - alone.errors.low


def test_without_times_only_errors_are_compared() -> None:
    none = [Score(targets=4, missed=4) for _ in range(FEWEST)]
    difference = between(none, scores([0] * FEWEST))
    assert difference.time_s is None
    assert difference.claims == ["b errs less"]


@pytest.mark.parametrize("trials", [20, 120])
def test_methods_that_do_not_differ_are_seldom_told_apart(trials: int) -> None:
    rng = np.random.default_rng(1)
    claims = 0
    for _ in range(60):
        a, b = (scores(rng.binomial(4, 0.03, trials).tolist()) for _ in range(2))
        claims += bool(between(a, b).claims)
    assert claims <= 6  # 3 are expected of intervals of 95 %
