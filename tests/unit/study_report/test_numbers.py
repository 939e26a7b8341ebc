"""Numbers and power of a report against published examples, theory and independent computations."""

import csv
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from pointit import study_report
from pointit.errors import ConfigError, PointItError
from pointit.study_report import power
from pointit.study_report.comparisons import _holm
from pointit.study_report.comparisons import fit as fit_mixed
from pointit.study_report.page import sections
from pointit.study_report.table import interval, system_usability
from pointit.study_report.tapping_movements import bits, effective
from tests.unit.study_report.generated import RINGS, edit_trials, write_answers, write_study

MACKENZIE = (
    *((218, 262), (529, 268), (195, 248), (533, 233), (209, 251), (607, 252), (231, 283), (540, 214)),
    *((231, 301), (560, 266), (207, 258), (524, 258), (239, 248), (515, 242), (180, 241), (501, 252)),
    *((215, 243), (571, 255), (215, 252), (521, 210)),
)
"""x of the selection (pixels) and time (ms) of the example in the documentation of MacKenzie's class
Throughput (yorku.ca/mack/FittsLawSoftware/doc/Throughput.html): serial tapping between 540 and 227."""

RAIL = {1: (55, 53, 54), 2: (26, 37, 32), 3: (78, 91, 85), 4: (92, 100, 96), 5: (49, 51, 50), 6: (80, 85, 83)}
"""Travel times of ultrasonic waves in rails (Pinheiro and Bates, 2000, 1.1)."""

ERGO_STOOL = (
    *((12, 15, 12, 10), (10, 14, 13, 12), (7, 14, 13, 9), (7, 11, 10, 9), (8, 11, 8, 7)),
    *((9, 11, 11, 10), (8, 12, 12, 11), (7, 11, 8, 7), (9, 13, 10, 8)),
)
"""Effort of nine people to rise from four stools (Pinheiro and Bates, 2000, 1.2)."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("study")
    write_study(made, {"dwell": 1.0, "press": 0.8, "hold": 1.1}, seed=3)
    return made


@pytest.fixture(scope="module")
def study(folder: Path) -> study_report.Trials:
    return study_report.trials(folder)


def read(folder: Path) -> dict[tuple[str, str], list[dict[str, str]]]:
    """Return the rows of hits by method and participant, by other means than the product's."""
    found: dict[tuple[str, str], list[dict[str, str]]] = defaultdict(list)
    for path in sorted(folder.glob("P*/trials.csv")):
        with path.open(encoding="utf-8") as file:
            for row in csv.DictReader(file):
                if row["outcome"] == "hit":
                    found[row.get("method", ""), row["participant"]].append(row)
    return found


def row_of(table: study_report.Table, **wanted: object) -> dict[str, Any]:
    (row,) = (row for row in table if wanted.items() <= row.items())
    return row


def test_throughput_is_that_of_mackenzies_worked_example() -> None:
    selected, milliseconds = np.array(MACKENZIE, dtype=float).T
    target = np.where(np.arange(20) % 2 == 0, 227.0, 540.0)
    error = (selected - target) * np.where(np.arange(20) % 2 == 0, -1.0, 1.0)
    before = np.array([np.nan, *error[:-1]])
    made = effective(np.full(20, 313.0), error, before, milliseconds / 1000)
    assert made.distance == pytest.approx(327.05, abs=1e-9)
    assert made.width == pytest.approx(105.692130, abs=2e-6)
    assert made.bits == pytest.approx(2.033640, abs=1e-6)
    assert made.seconds == pytest.approx(0.25185, abs=1e-12)
    assert made.throughput == pytest.approx(8.074805, abs=2e-6)


def test_kopper_index_is_squared_with_the_width_cubed() -> None:
    assert bits(np.array([30.0]), np.array([2.0]), "kopper")[0] == pytest.approx(np.log2(1 + 30 / 8) ** 2)


def test_throughput_of_a_study_is_the_mean_of_sequence_means(
    folder: Path, study: study_report.Trials
) -> None:
    by_person: dict[str, list[float]] = defaultdict(list)
    for path in sorted(folder.glob("P*/trials.csv")):
        with path.open(encoding="utf-8") as file:
            rows = [row for row in csv.DictReader(file) if row["method"] == "press"]
        for number in {row["block"] for row in rows}:
            block = [row for row in rows if row["block"] == number]
            target, selected = (
                np.array([[float(row[f"{what}_{axis}_m"]) for axis in "yz"] for row in block])
                for what in ("target", "selected")
            )
            start = target[:-1]
            a = np.hypot(*(target[1:] - start).T)
            b = np.hypot(*(selected[1:] - target[1:]).T)
            c = np.hypot(*(selected[1:] - start).T)
            beyond = (c**2 - b**2 - a**2) / (2 * a)
            moved = a + beyond + np.array([0.0, *beyond[:-1]])
            seconds = np.mean([float(row["selection_s"]) for row in block[1:]])
            index = np.log2(moved.mean() / (4.132731354 * beyond.std(ddof=1)) + 1)
            by_person[path.parent.name].append(float(index / seconds))

    row = row_of(study_report.throughput(study), method="press")
    assert row["throughput_bit_per_s"] == pytest.approx(
        np.mean([np.mean(each) for each in by_person.values()])
    )
    assert (row["participants"], row["sequences"], row["left_out"]) == (12, 12 * len(RINGS), 0)

    in_degrees = row_of(study_report.throughput(study, "deg"), method="press")
    assert in_degrees["throughput_bit_per_s"] == pytest.approx(row["throughput_bit_per_s"], rel=2e-3)


def test_fitts_regression_is_that_of_the_means_over_participants(
    folder: Path, study: study_report.Trials
) -> None:
    hits = read(folder)
    means: list[float] = []
    for size in RINGS:
        people = [
            np.mean(
                [
                    float(row["selection_s"])
                    for row in hits["dwell", who]
                    if (float(row["target_distance_m"]), float(row["target_width_m"])) == size
                    and int(row["trial"]) % 10 != 1  # the first of a block, which begins nowhere
                ]
            )
            for who in study.participants
        ]
        means.append(float(np.mean(people)))
    expected: Any = stats.linregress([np.log2(distance / width + 1) for distance, width in RINGS], means)
    row = row_of(study_report.fitts(study), method="dwell")

    assert row["slope_s_per_bit"] == pytest.approx(expected.slope, rel=1e-5)
    assert row["intercept_s"] == pytest.approx(expected.intercept, rel=1e-5)
    assert row["r2"] == pytest.approx(expected.rvalue**2, rel=1e-5)
    assert row["slope_low"] < 0.25 < row["slope_high"], "the law that the people were made with"


def test_factors_of_size_belong_to_difficulty_and_not_to_conditions(tmp_path: Path) -> None:
    write_study(tmp_path, {"dwell": 1.0, "press": 0.8}, people=4, sized=True)
    study = study_report.trials(tmp_path)
    assert study.factors == ("method", "distance", "width")
    rows = study_report.fitts(study)
    assert [(row["method"], row["points"], "width" in row) for row in rows] == [
        *(("dwell", 4, False), ("press", 4, False))
    ]
    assert [row["sequences"] for row in study_report.throughput(study)] == [16, 16]


def test_medians_are_of_participants_medians_with_scipys_bootstrap_interval(
    folder: Path, study: study_report.Trials
) -> None:
    hits = read(folder)
    values = [
        np.median([float(row["selection_s"]) for row in hits["hold", who]]) for who in study.participants
    ]
    expected = stats.bootstrap((values,), np.median, n_resamples=20_000, method="percentile", random_state=1)
    row = row_of(study_report.medians(study), method="hold")
    assert row["median"] == pytest.approx(np.median(values))
    assert row["low"] == pytest.approx(expected.confidence_interval.low, rel=0.02)
    assert row["high"] == pytest.approx(expected.confidence_interval.high, rel=0.02)


def test_differences_are_paired_t_tests_of_scipy(folder: Path, study: study_report.Trials) -> None:
    hits = read(folder)
    a, b = (
        [np.median([float(row["selection_s"]) for row in hits[method, who]]) for who in study.participants]
        for method in ("dwell", "press")
    )
    expected: Any = stats.ttest_rel(b, a)
    row = row_of(study_report.differences(study), difference="press - dwell")
    assert (row["test"], row["participants"]) == ("paired t", 12)
    assert row["mean"] == pytest.approx(np.mean(b) - np.mean(a))
    assert row["p"] == pytest.approx(expected.pvalue)
    limits = expected.confidence_interval()
    assert (row["low"], row["high"]) == pytest.approx((limits.low, limits.high))


def test_factors_between_participants_are_compared_by_welchs_test(tmp_path: Path) -> None:
    write_study(tmp_path, {"dwell": 1.0, "press": 0.8}, between=True, rings=RINGS[:1])
    study = study_report.trials(tmp_path)
    medians = study_report.participant_medians(study, "selection_s", "group")
    a, b = ([*medians[level,].values()] for level in "ab")
    row = row_of(study_report.differences(study), factor="group")
    assert (row["test"], row["participants"], len(a), len(b)) == ("Welch's t", 12, 6, 6)
    assert row["p"] == pytest.approx(stats.ttest_ind(b, a, equal_var=False).pvalue)
    assert row["p"] < 0.05


def test_holm_corrects_as_in_his_step_down_procedure() -> None:
    rows: list[dict[str, Any]] = [{"p": p} for p in (0.01, 0.04, 0.03, None)]
    _holm(rows)
    assert [row["p_holm"] for row in rows] == pytest.approx([0.03, 0.06, 0.06, None])


def test_outcomes_are_means_of_participants_shares(tmp_path: Path) -> None:
    write_study(tmp_path, {"dwell": 1.0}, people=5, wrong=0.3, rings=RINGS[:1])
    (row,) = study_report.outcomes(study_report.trials(tmp_path))
    hits = read(tmp_path)
    assert row["hit"] == pytest.approx(np.mean([len(rows) / 10 for rows in hits.values()]))
    assert row["missed"] == pytest.approx(1 - row["hit"]) == pytest.approx(row["wrong"])
    assert row["low"] < row["missed"] < row["high"]


def test_names_are_means_per_trial_over_participants(tmp_path: Path) -> None:
    write_study(tmp_path, {"dwell": 1.0}, people=2, wrong=0.3, rings=RINGS[:1])
    study = study_report.trials(tmp_path)
    assert "Spoken names" not in [section.title for section in sections(study)]
    with pytest.raises(ConfigError, match="no name was spoken"):
        study_report.names(study)
    for participant, count in (("P01", 4), ("P02", 2)):

        def name(row: dict[str, str], announced: int = count) -> None:
            trial = int(row["trial"])
            counts = {"announced": announced, "stepped": int(trial <= 5), "confirmed": 1}
            row.update({column: "" if trial == 10 else str(each) for column, each in counts.items()})

        edit_trials(tmp_path, participant, name)
    study = study_report.trials(tmp_path)
    (table,) = study_report.names(study)
    assert table["trials"] == 18  # in one trial of each, nothing was spoken
    assert (table["participants"], table["announced"], table["confirmed"]) == (2, 3.0, 1.0)
    assert table["stepped"] == table["with_step"] == pytest.approx(5 / 9)
    assert "Spoken names" in [section.title for section in sections(study)]


def test_learning_falls_with_the_exponent_that_people_learn_with(tmp_path: Path) -> None:
    write_study(tmp_path, {"dwell": 1.0}, rings=((0.5, 0.1),) * 6, learning=-0.2)
    study = study_report.trials(tmp_path)
    table = study_report.learning(study)
    assert [(row["first_trial"], row["last_trial"]) for row in table] == [
        (begin, begin + 5) for begin in range(1, 61, 6)
    ]
    middle = np.log([(row["first_trial"] + row["last_trial"]) / 2 for row in table])
    fit: Any = stats.linregress(middle, np.log([row["median"] for row in table]))
    assert fit.slope == pytest.approx(-0.2, abs=0.03)


def test_mixed_model_gives_the_published_estimates_of_rail() -> None:
    values = np.array([value for group in RAIL.values() for value in group], dtype=float)
    made = fit_mixed(values, np.ones((18, 1)), [str(rail) for rail in RAIL for _ in range(3)])
    assert made.effects[0] == pytest.approx(66.5, abs=1e-6)
    assert made.errors[0] == pytest.approx(10.17104, abs=1e-4)
    assert (made.between, made.residual) == pytest.approx((24.80547, 4.020779), abs=1e-3)


def test_mixed_model_gives_the_published_estimates_of_ergo_stool() -> None:
    values = np.array(ERGO_STOOL, dtype=float).ravel()
    stool = np.tile(np.arange(4), 9)
    design = np.column_stack([np.ones(36), *((stool == each).astype(float) for each in (1, 2, 3))])
    made = fit_mixed(values, design, [str(who) for who in range(9) for _ in range(4)])
    assert made.effects == pytest.approx([8.555556, 3.888889, 2.222222, 0.666667], abs=1e-5)
    assert made.errors == pytest.approx([0.5760123, 0.5186838, 0.5186838, 0.5186838], abs=1e-5)
    assert (made.between, made.residual) == pytest.approx((1.332465, 1.100295), abs=1e-4)


def test_mixed_model_of_a_study_finds_the_simulated_effects(
    study: study_report.Trials,
) -> None:
    table = study_report.mixed_model(study)
    for level, effect in (("press", 0.8), ("hold", 1.1)):
        row = row_of(table, term=f"method: {level} / dwell")
        assert row["low"] < effect < row["high"]
        assert row["p"] < 1e-6


def test_effects_that_cannot_be_told_apart_are_refused() -> None:
    with pytest.raises(PointItError, match="cannot be told apart"):
        fit_mixed(np.arange(4.0), np.ones((4, 2)), ["a", "a", "b", "b"])


def test_sus_is_scored_by_odd_and_even_items(tmp_path: Path) -> None:
    assert system_usability([4, 1, 4, 1, 2, 2, 2, 1, 3, 3]) == 67.5
    write_study(tmp_path, {"dwell": 1.0}, people=2, rings=RINGS[:1])
    write_answers(
        tmp_path, "P01", {("sus", "dwell"): [5, 1] * 5, ("nasa-tlx", "dwell"): [0, 10, 20, 30, 40, 80]}
    )
    write_answers(tmp_path, "P02", {("sus", "dwell"): [3, 3] * 5, ("own", "dwell"): [7]})
    path = next(tmp_path.rglob("P01/**/answers.csv"))
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([head, *sorted(rows), ""]))  # 1, 10, 2: items tell, not rows
    table = study_report.questionnaires(study_report.trials(tmp_path))

    assert row_of(table, questionnaire="sus")["mean"] == 75
    assert row_of(table, item="raw TLX")["mean"] == 30
    assert row_of(table, questionnaire="own") == {
        "questionnaire": "own",
        "item": "1",
        "condition": "dwell",
        "participants": 1,
        "mean": 7.0,
        "low": None,
        "high": None,
    }
    with pytest.raises(PointItError, match="10 items, not 9"):
        system_usability([3] * 9)


def test_intervals_over_participants_cover_the_median_as_often_as_stated() -> None:
    random = np.random.default_rng(0)
    limits = [interval(random.normal(size=15)) for _ in range(100)]
    covered = sum(low < 0 < high for low, high in limits if low is not None and high is not None)
    assert 89 <= covered <= 99


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


def test_no_effect_is_found_over_20_seeds_without_one(tmp_path: Path) -> None:
    assert significant(tmp_path, 1.0) <= 3


def spread(values: np.ndarray, *, is_within: bool = True) -> power.Spread:
    return power.Spread(
        first=np.zeros_like(values), second=values, is_within=is_within, mean=1.0, difference=0.0
    )


def test_power_is_that_of_the_noncentral_t_distribution() -> None:
    people = spread(stats.norm.ppf((np.arange(2000) + 0.5) / 2000))
    for row in power.power(people, 0.5, (10, 30, 50), seed=1):
        n = row["participants"]
        at = stats.t.ppf(0.975, n - 1)
        noncentrality = 0.5 * np.sqrt(n)
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


def test_power_stops_when_sufficient_and_needed_agrees_with_gpower() -> None:
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
