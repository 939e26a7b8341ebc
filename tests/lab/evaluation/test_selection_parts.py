"""Parts of the evaluation of selection: its table, and differences of methods."""

from pathlib import Path

import numpy as np
import pytest

from pointit.maps.file import load_map
from pointit.runtime.errors import ConfigError
from pointit.schemas import NS_PER_S
from pointit_lab.evaluation.selection.carousel import Carousel
from pointit_lab.evaluation.selection.condition import CONVEYOR, Condition, conditions
from pointit_lab.evaluation.selection.difference import FEWEST, Difference, differences_of
from pointit_lab.evaluation.selection.method import METHODS, selector_config
from pointit_lab.evaluation.selection.plot import check_plot, plot
from pointit_lab.evaluation.selection.row import (
    Score,
    SelectionMetrics,
    SelectionTrialRow,
    TimeSpread,
    figures_of,
)
from tests.support import there


def test_a_method_has_the_time_that_its_name_says() -> None:
    assert selector_config("hold@0.6").window_s == 0.6
    assert selector_config("original@1").fraction == METHODS["original"].fraction
    gauge = selector_config("gauge@1.6").gauge
    assert gauge.full_s == 1.6
    usual = METHODS["gauge"].gauge
    assert gauge.sparse_full_s / gauge.full_s == pytest.approx(usual.sparse_full_s / usual.full_s)


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("dwell", "no such method; there are original, hold"),
        ("hold@", "seconds were expected"),
        ("hold@x", "seconds were expected"),
        ("hold@-1", "window_s"),
        ("hold@nan", "--method hold@nan: "),
        ("gauge@99", "full_s"),
    ],
)
def test_a_method_that_is_none_is_refused_in_a_sentence(name: str, complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        selector_config(name)


def test_packages_go_around_the_ring() -> None:
    ring = Carousel(
        load_map("lab", 0), np.array([1.0, 4.9, 9.9]), ["red", "blue", "blue"], length_m=0.5, speed_mps=0.5,
        start_ns=0,
    )  # fmt: skip
    first = ring.tracked(0).objects
    later = ring.tracked(NS_PER_S).objects
    assert [thing.surface_id for thing in first] == ["0", "0", "1"]
    assert [thing.surface_id for thing in later] == ["0", "1", "0"]
    assert [thing.surface_position_m for thing in later] == pytest.approx([1.5, 0.4, 0.4])
    assert later[0].position_m == pytest.approx((4.85, 0.075, 0.9))
    assert first[0].velocity_mps == pytest.approx((0.0, 0.5, 0.0))


def test_figures_over_trials() -> None:
    good = Score(targets=2)
    bad = Score(targets=2, missed=1)
    good.toggled(2.0, selected=True, is_target=True)
    good.toggled(5.0, selected=True, is_target=True)
    good.took_s = [5.0]
    bad.toggled(2.0, selected=True, is_target=False)
    bad.toggled(3.0, selected=False, is_target=False)
    bad.toggled(4.0, selected=False, is_target=True)
    figures = figures_of([good, bad], per_package=False)
    assert (figures.n, figures.wrong_rate, figures.missed_rate) == (2, 0.4, 0.25)
    assert figures.time_s == TimeSpread(median=5.0, p90=5.0)
    assert figures.between_s == TimeSpread(median=3.0, p90=3.0)
    assert figures_of([good, bad], per_package=True).n == 4
    assert figures_of([Score(targets=1)], per_package=False).wrong_rate is None


def rows() -> list[SelectionTrialRow]:
    some = SelectionMetrics(n=3, time_s=TimeSpread(median=2.0, p90=3.0), wrong_rate=0.0, missed_rate=None)
    none = SelectionMetrics(n=3, time_s=None)
    return [
        SelectionTrialRow(bench="a", condition="x", method="hold", figures=some, human={"pointing": some}),
        SelectionTrialRow(bench="a", condition="y", method="hold", figures=none, human={}),
    ]


def test_a_picture_on_request(tmp_path: Path) -> None:
    file = tmp_path / "rows.svg"
    check_plot(file)
    plot(rows(), file)
    assert "<svg" in file.read_text()
    with pytest.raises(ConfigError, match="must end in one of"):
        check_plot(tmp_path / "rows.docx")


FIRST, SECOND = conditions([CONVEYOR])[:2]


def scores(errors: list[int], took_s: float = 3.0) -> list[Score]:
    """Return trials of four packages with so many errors each."""
    return [Score(targets=4, missed=count, took_s=[took_s + 0.1 * (k % 5)]) for k, count in enumerate(errors)]


def between(a: list[Score], b: list[Score], condition: Condition = FIRST) -> Difference:
    (difference,) = differences_of({(condition, "a"): a, (condition, "b"): b})
    return difference


def test_a_clear_difference_is_claimed_with_its_direction() -> None:
    worse = between(scores([0] * 60), scores([1, 0, 0] * 20, took_s=2.5))
    assert (worse.method, worse.other, worse.trials) == ("b", "a", 60)
    assert worse.errors.value == pytest.approx(1 / 12)
    assert 0.0 < worse.errors.low < 1 / 12 < worse.errors.high < 0.2
    assert there(worse.time_s).value == pytest.approx(-0.5)
    assert worse.claims == ["b errs more", "b is faster"]


def test_pairing_tells_a_small_difference_among_trials_that_vary_much() -> None:
    errors = [0, 4] * 20
    errs_more = [min(4, count + (k % 4 == 0)) for k, count in enumerate(errors)]
    assert between(scores(errors), scores(errs_more)).claims == ["b errs more"]


def test_few_trials_tell_nothing() -> None:
    few = {(FIRST, "a"): scores([0] * (FEWEST - 1)), (FIRST, "b"): scores([4] * (FEWEST - 1))}
    assert differences_of(few) == []


def test_pairs_are_compared_in_each_condition_with_widened_intervals() -> None:
    a = scores([0, 0, 1] * 20)
    b = scores([1, 0, 1] * 20)
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
