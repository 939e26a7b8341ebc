"""Comparisons of conditions with intervals: medians, outcomes, learning, a linear mixed model."""

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from pointit.errors import ConfigError
from pointit.geometry.array_types import Array
from pointit.study.table_file import OUTCOMES, SPOKEN
from pointit.study_report.reading import MEASURES, TrialRow, Trials
from pointit.study_report.table import LEVEL, Table, summary

Levels = tuple[str, ...]
"""Levels of factors, in their order."""

BINS = 10
"""Maximum number of groups of trials in which learning is shown."""


def values_of(trials: Trials, measure: str) -> list[TrialRow]:
    """Return the counted trials with a value of `measure`: hits, and for errors also wrong selections.

    Raises: ConfigError: If no counted trial has one.
    """
    outcomes = ("hit", "wrong") if measure.startswith("error") else ("hit",)
    measured = [row for row in trials.counted if measure in row.numbers]
    rows = [row for row in measured if row.outcome in outcomes]
    if not rows:
        measures = ", ".join(filter(trials.has, MEASURES))
        raise ConfigError(f"{trials.folder}: no trial has {measure}; measures are {measures}")
    return rows


def participant_medians(trials: Trials, measure: str, *factors: str) -> dict[Levels, dict[str, float]]:
    """Return each participant's median of `measure`, by the levels of `factors` and the participant.

    Where a study has further factors, it is the mean over their levels of the medians, so that each level
    weighs the same however many trials were hit. Raises: ConfigError: If nothing is known of `measure`.
    """
    indices = [trials.index(factor) for factor in factors]
    cells: dict[tuple[Levels, str], dict[Levels, list[float]]] = {}
    for row in values_of(trials, measure):
        levels = tuple(row.levels[index] for index in indices)
        by_all_levels = cells.setdefault((levels, row.participant), {})
        own_values = by_all_levels.setdefault(row.levels, [])
        own_values.append(row.numbers[measure])

    results: dict[Levels, dict[str, float]] = defaultdict(dict)
    for (levels, participant), by_all_levels in cells.items():
        cell_medians = [np.median(values) for values in by_all_levels.values()]
        results[levels][participant] = float(np.mean(cell_medians))
    return results


def medians(trials: Trials, measure: str = "selection_s") -> Table:
    """Return for each condition the median over participants of their medians, with its bootstrap interval.

    Raises: ConfigError: If nothing is known of `measure`.
    """
    by_condition = participant_medians(trials, measure, *trials.factors)
    table = Table()
    for levels in trials.conditions:
        values = [*by_condition.get(levels, {}).values()]
        columns = summary(values, "median")
        table.append({**trials.named(levels), **columns})
    return table


def differences(trials: Trials, measure: str = "selection_s") -> Table:
    """Return the differences between all pairs of levels of each factor, with intervals of t distributions.

    Within participants, differences are of the same people: paired two-sided t-test. Between participants:
    Welch's test. `p_holm` is corrected for the pairs of a factor (Holm, 1979). Raises: ConfigError: If
    nothing is known of `measure`.
    """
    table = Table()
    for factor in trials.factors:
        by_level = participant_medians(trials, measure, factor)
        is_within = trials.is_within(factor)
        rows: list[dict[str, Any]] = []
        for a, b in combinations(trials.levels(factor), 2):
            first = by_level.get((a,), {})
            second = by_level.get((b,), {})
            row = {"factor": factor, "difference": f"{b} - {a}"}
            rows.append(row | _difference(first, second, is_within=is_within))
        _holm(rows)
        table += rows
    return table


def paired_values(
    first: Mapping[str, float], second: Mapping[str, float], *, is_within: bool
) -> tuple[Array, Array]:
    """Return the values at two levels, which are by participant.

    Within participants they are of those who have both, in the same order.
    """
    if not is_within:
        return np.array([*first.values()]), np.array([*second.values()])
    people = sorted(first.keys() & second.keys())
    first_values = [first[name] for name in people]
    second_values = [second[name] for name in people]
    return np.array(first_values), np.array(second_values)


def _difference(
    first: Mapping[str, float], second: Mapping[str, float], *, is_within: bool
) -> dict[str, Any]:
    a, b = paired_values(first, second, is_within=is_within)
    row: dict[str, Any] = {"test": "Welch's t", "participants": len(a) + len(b)}
    if is_within:
        row = {"test": "paired t", "participants": len(a)}
    row |= {"mean": None, "low": None, "high": None, "p": None}
    if not a.size or not b.size:
        return row
    row["mean"] = float(b.mean() - a.mean())

    # A test needs a spread.
    if min(a.size, b.size) < 2 or _is_constant(a, b, is_within=is_within):
        return row
    if is_within:
        result: Any = stats.ttest_rel(b, a)
    else:
        result = stats.ttest_ind(b, a, equal_var=False)
    limits = result.confidence_interval(LEVEL)
    row["low"] = float(limits.low)
    row["high"] = float(limits.high)
    row["p"] = float(result.pvalue)
    return row


def _is_constant(a: NDArray[np.float64], b: NDArray[np.float64], *, is_within: bool) -> bool:
    """Return True if there is no spread that a test could compare with."""
    largest = max(abs(a).max(), abs(b).max(), 1e-300)
    spread = np.ptp(b - a) if is_within else max(np.ptp(a), np.ptp(b))
    return bool(spread <= 1e-12 * largest)


def _holm(rows: list[dict[str, Any]]) -> None:
    """Add the corrected p of each row: the least first, and none below one before it."""
    for row in rows:
        row["p_holm"] = None
    tested = [row for row in rows if row["p"] is not None]
    tested.sort(key=lambda row: row["p"])
    largest_p = 0.0
    for index, row in enumerate(tested):
        comparisons = len(tested) - index
        corrected_p = min(1.0, row["p"] * comparisons)
        largest_p = max(largest_p, corrected_p)
        row["p_holm"] = largest_p


def outcomes(trials: Trials) -> Table:
    """Return for each condition the mean over participants of the share of each outcome.

    `missed` is the share of trials that did not end with a hit, of those that were not skipped, with its
    bootstrap interval.
    """
    table = Table()
    for levels in trials.conditions:
        people: dict[str, Counter[str]] = defaultdict(Counter)
        for row in trials.counted:
            if row.levels == levels:
                people[row.participant][row.outcome] += 1

        # Participants weigh the same, however many trials they did.
        shares: dict[str, float] = {}
        for outcome in OUTCOMES:
            own_shares = [counts[outcome] / counts.total() for counts in people.values()]
            shares[outcome] = float(np.mean(own_shares))

        missed: list[float] = []
        for counts in people.values():
            done = counts.total() - counts["skipped"]
            if done:
                missed.append(1 - counts["hit"] / done)
        attempts = sum(counts.total() for counts in people.values())
        columns = summary(missed, "missed", np.mean, trials=attempts, **shares)
        table.append({**trials.named(levels), **columns, "participants": len(people)})
    return table


def names(trials: Trials) -> Table:
    """Return for each condition the means over participants of names, steps and confirmations per trial.

    Trials of all outcomes count in which names were spoken. `with_step` is the share of those with a step,
    with its bootstrap interval. Raises: ConfigError: If no name was spoken.
    """
    spoken = [row for row in trials.counted if SPOKEN[0] in row.numbers]
    if not spoken:
        raise ConfigError(f"{trials.folder}: no name was spoken; see `pointit run --announce`")
    table = Table()
    for levels in trials.conditions:
        people: dict[str, list[TrialRow]] = defaultdict(list)
        for row in spoken:
            if row.levels == levels:
                people[row.participant].append(row)
        if not people:
            continue
        means = {name: _mean_of_means(people, name) for name in SPOKEN}
        # Participants weigh the same, however many trials they did.
        shares: list[float] = []
        for rows in people.values():
            has_step = [row.numbers["stepped"] > 0 for row in rows]
            shares.append(float(np.mean(has_step)))
        count = sum(map(len, people.values()))
        columns = summary(shares, "with_step", np.mean, trials=count, **means)
        table.append({**trials.named(levels), **columns})
    return table


def _mean_of_means(people: Mapping[str, Iterable[TrialRow]], column: str) -> float:
    """Return the mean over participants of their means."""
    means: list[np.floating[Any]] = []
    for rows in people.values():
        own_values = [row.numbers[column] for row in rows]
        means.append(np.mean(own_values))
    return float(np.mean(means))


def learning(trials: Trials, measure: str = "selection_s") -> Table:
    """Return medians by the number of the trial within its condition, in at most `BINS` groups.

    Each value is the median over participants of their medians. Numbers count trials of all outcomes. Raises:
    ConfigError: If nothing is known of `measure`.
    """
    # Trials of all outcomes are numbered within condition and participant.
    used_rows = {id(row) for row in values_of(trials, measure)}
    counts: Counter[tuple[Levels, str]] = Counter()
    numbered: list[tuple[TrialRow, int]] = []
    for row in trials.counted:
        key = (row.levels, row.participant)
        counts[key] += 1
        numbered.append((row, counts[key]))
    max_trials = max(counts.values())
    width = math.ceil(max_trials / BINS)

    # The values of a group of trials, by participant.
    cells: dict[tuple[Levels, int], dict[str, list[float]]] = {}
    for row, number in numbered:
        if id(row) in used_rows:
            group = (number - 1) // width
            people = cells.setdefault((row.levels, group), {})
            own_values = people.setdefault(row.participant, [])
            own_values.append(row.numbers[measure])

    table = Table()
    for levels in trials.conditions:
        for group in range(math.ceil(max_trials / width)):
            people = cells.get((levels, group), {})
            if not people:
                continue
            values = [float(np.median(own_values)) for own_values in people.values()]
            first_trial = group * width + 1
            last_trial = min((group + 1) * width, max_trials)
            columns = summary(values, "median", first_trial=first_trial, last_trial=last_trial)
            table.append({**trials.named(levels), **columns})
    return table


class ModelFit(NamedTuple):
    """Estimates of the fixed effects and their standard errors, shapes (p,); standard deviations."""

    effects: Array
    errors: Array
    between: float
    """Standard deviation of the random intercepts."""
    residual: float


def fit(values: Array, design: Array, groups: Sequence[str]) -> ModelFit:
    """Fit `values` (n,) = `design` (n, p) @ effects + intercept of the group + noise.

    Restricted maximum likelihood, profiled over the ratio of the variances (Pinheiro and Bates, 2000,
    Mixed-effects models in S and S-PLUS, chapter 2).

    Raises: ConfigError: If the effects cannot be told apart.
    """
    n, p = design.shape
    if n <= p or np.linalg.matrix_rank(design) < p:
        raise ConfigError("the factors' effects cannot be told apart: some levels occur only together")

    # The sums of products do not depend on the ratio of the variances; those of groups enter with weights.
    _, member, sizes = np.unique(groups, return_inverse=True, return_counts=True)
    sums = np.zeros((len(sizes), p + 1))
    design_and_values = np.column_stack([design, values])
    np.add.at(sums, member, design_and_values)
    products = design_and_values.T @ design_and_values

    def solved(ratio: float) -> tuple[float, Array, Array, float]:
        """Return minus two log likelihoods, effects, the inverse of X'V⁻¹X and the residual variance."""
        weights = ratio / (1 + ratio * sizes)
        weighted_sums = weights[:, None] * sums
        weighted_products = products - sums.T @ weighted_sums

        # The blocks X'V⁻¹X, X'V⁻¹y and y'V⁻¹y
        information = weighted_products[:p, :p]
        moment = weighted_products[:p, p]
        square = weighted_products[p, p]
        inverse = np.asarray(np.linalg.inv(information), dtype=np.float64)
        effects = inverse @ moment
        residual_sum = max(float(square - moment @ effects), 1e-300)
        variance = residual_sum / (n - p)

        _, log_determinant = np.linalg.slogdet(information)
        log_weights = float(np.sum(np.log1p(ratio * sizes)))
        deviance = (n - p) * np.log(variance) + log_weights + float(log_determinant)
        return float(deviance), effects, inverse, variance

    def deviance_of(log_ratio: float) -> float:
        deviance, *_ = solved(float(np.exp(log_ratio)))
        return deviance

    # The logarithm never reaches a ratio of 0, people who do not differ, so this is tried beside it.
    minimum = optimize.minimize_scalar(deviance_of, bounds=(-18, 18), method="bounded")
    ratio = float(np.exp(minimum.x))
    if solved(0.0)[0] <= minimum.fun:
        ratio = 0.0
    _, effects, inverse, variance = solved(ratio)
    errors = np.sqrt(variance * np.diag(inverse))
    between = float(np.sqrt(ratio * variance))
    return ModelFit(effects, errors, between, float(np.sqrt(variance)))


def mixed_model(trials: Trials, measure: str = "selection_s") -> Table:
    """Return the model of the logarithm of `measure`, of single trials: main effects of all factors.

    Effects are against the first level of a factor, as ratios: 1.2 means 20 % longer. Intervals and p (Wald)
    are of the normal distribution. The last rows are the standard deviations of the logarithm, between
    participants and within.

    Raises: ConfigError: If nothing is known of `measure`, there is no factor or only one participant, or
        effects cannot be told apart.
    """
    measured = values_of(trials, measure)
    rows = [row for row in measured if row.numbers[measure] > 0]
    people = [row.participant for row in rows]
    if len(set(people)) < 2 or not trials.factors:
        raise ConfigError(f"{trials.folder}: a mixed model needs two participants and a factor")

    # Each level but the first of its factor is a column of 0 and 1.
    terms = ["(Intercept)"]
    columns = [np.ones(len(rows))]
    for index, factor in enumerate(trials.factors):
        present = {row.levels[index] for row in rows}
        first, *others = [level for level in trials.levels(factor) if level in present]
        for level in others:
            terms.append(f"{factor}: {level} / {first}")
            has_level = [float(row.levels[index] == level) for row in rows]
            columns.append(np.array(has_level))
    logarithms = np.log([row.numbers[measure] for row in rows])
    model = fit(logarithms, np.column_stack(columns), people)

    quantile = float(stats.norm.ppf((1 + LEVEL) / 2))
    table = Table()
    for term, effect, error in zip(terms, model.effects, model.errors, strict=True):
        p: float | None = None
        if term != terms[0]:
            score = abs(effect / error)
            p = float(2 * stats.norm.sf(score))
        margin = quantile * error
        row = {
            "term": term,
            "ratio": float(np.exp(effect)),
            "low": float(np.exp(effect - margin)),
            "high": float(np.exp(effect + margin)),
            "p": p,
        }
        table.append(row)
    deviations = {"SD between participants (log)": model.between, "SD within (log)": model.residual}
    for term, deviation in deviations.items():
        table.append({"term": term, "ratio": deviation, "low": None, "high": None, "p": None})
    return table
