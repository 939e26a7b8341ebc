"""Comparisons of conditions with intervals: medians, outcomes, learning, a linear mixed model."""

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

BINS = 10
"""Maximum number of groups of trials in which learning is shown."""


def values_of(trials: Trials, measure: str) -> list[TrialRow]:
    """Return the counted trials with a value of `measure`: hits, and for errors also wrong selections.

    Raises: ConfigError: If no counted trial has one.
    """
    outcomes = ("hit", "wrong") if measure.startswith("error") else ("hit",)
    rows = [row for row in trials.counted if measure in row.numbers and row.outcome in outcomes]
    if not rows:
        raise ConfigError(
            f"{trials.folder}: no trial has {measure}; measures are {', '.join(filter(trials.has, MEASURES))}"
        )
    return rows


def participant_medians(
    trials: Trials, measure: str, *factors: str
) -> dict[tuple[str, ...], dict[str, float]]:
    """Return each participant's median of `measure`, by the levels of `factors` and the participant.

    Where a study has further factors, it is the mean over their levels of the medians, so that each level
    weighs the same however many trials were hit. Raises: ConfigError: If nothing is known of `measure`.
    """
    kept = [trials.index(factor) for factor in factors]
    cells: dict[tuple[tuple[str, ...], str], dict[tuple[str, ...], list[float]]] = {}
    for row in values_of(trials, measure):
        key = (tuple(row.levels[index] for index in kept), row.participant)
        cells.setdefault(key, {}).setdefault(row.levels, []).append(row.numbers[measure])
    found: dict[tuple[str, ...], dict[str, float]] = defaultdict(dict)
    for (levels, participant), values in cells.items():
        found[levels][participant] = float(np.mean([np.median(each) for each in values.values()]))
    return found


def medians(trials: Trials, measure: str = "selection_s") -> Table:
    """Return for each condition the median over participants of their medians, with its bootstrap interval.

    Raises: ConfigError: If nothing is known of `measure`.
    """
    found = participant_medians(trials, measure, *trials.factors)
    people = ([*found.get(levels, {}).values()] for levels in trials.conditions)
    rows = zip(trials.conditions, people, strict=True)
    return Table({**trials.named(levels), **summary(values, "median")} for levels, values in rows)


def differences(trials: Trials, measure: str = "selection_s") -> Table:
    """Return the differences between all pairs of levels of each factor, with intervals of t distributions.

    Within participants, differences are of the same people: paired two-sided t-test. Between participants:
    Welch's test. `p_holm` is corrected for the pairs of a factor (Holm, 1979). Raises: ConfigError: If
    nothing is known of `measure`.
    """
    table = Table()
    for factor in trials.factors:
        found = participant_medians(trials, measure, factor)
        rows: list[dict[str, Any]] = []
        for a, b in combinations(trials.levels(factor), 2):
            first = found.get((a,), {})
            second = found.get((b,), {})
            rows.append(
                {"factor": factor, "difference": f"{b} - {a}", **_difference(trials, factor, first, second)}
            )
        _holm(rows)
        table += rows
    return table


def _difference(
    trials: Trials, factor: str, first: dict[str, float], second: dict[str, float]
) -> dict[str, Any]:
    is_within = trials.is_within(factor)
    if is_within:
        both = sorted(first.keys() & second.keys())
        first, second = ({name: one[name] for name in both} for one in (first, second))
    a, b = (np.array([*one.values()]) for one in (first, second))
    row: dict[str, Any] = {"test": "paired t" if is_within else "Welch's t"}
    row["participants"] = len(a) if is_within else len(a) + len(b)
    row["mean"] = float(b.mean() - a.mean()) if a.size and b.size else None
    row |= {"low": None, "high": None, "p": None}
    if min(a.size, b.size) < 2 or _is_constant(a, b, is_within=is_within):
        return row
    result: Any = stats.ttest_rel(b, a) if is_within else stats.ttest_ind(b, a, equal_var=False)
    limits = result.confidence_interval(LEVEL)
    return {**row, "low": float(limits.low), "high": float(limits.high), "p": float(result.pvalue)}


def _is_constant(a: NDArray[np.float64], b: NDArray[np.float64], *, is_within: bool) -> bool:
    """Return True if there is no spread that a test could compare with."""
    scale = 1e-12 * max(abs(a).max(), abs(b).max(), 1e-300)
    return bool(np.ptp(b - a) <= scale if is_within else max(np.ptp(a), np.ptp(b)) <= scale)


def _holm(rows: list[dict[str, Any]]) -> None:
    tested = sorted((row for row in rows if row["p"] is not None), key=lambda row: row["p"])
    worst = 0.0
    for row in rows:
        row["p_holm"] = None
    for index, row in enumerate(tested):
        worst = max(worst, min(1.0, row["p"] * (len(tested) - index)))
        row["p_holm"] = worst


def outcomes(trials: Trials) -> Table:
    """Return for each condition the mean over participants of the share of each outcome.

    `missed` is the share of trials that did not end with a hit, of those that were not skipped, with its
    bootstrap interval.
    """
    table = Table()
    for levels in trials.conditions:
        counts: dict[str, dict[str, int]] = defaultdict(lambda: dict.fromkeys(OUTCOMES, 0))
        for row in trials.counted:
            if row.levels == levels:
                counts[row.participant][row.outcome] += 1
        shares = {
            name: float(np.mean([one[name] / sum(one.values()) for one in counts.values()]))
            for name in OUTCOMES
        }
        done = [(one, sum(one.values()) - one["skipped"]) for one in counts.values()]
        missed = [1 - one["hit"] / total for one, total in done if total]
        attempts = sum(sum(one.values()) for one in counts.values())
        columns = summary(missed, "missed", np.mean, trials=attempts, **shares)
        table.append({**trials.named(levels), **columns, "participants": len(counts)})
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
        if people:
            means = {name: _mean_of_means(people, name) for name in SPOKEN}
            shares = [np.mean([row.numbers["stepped"] > 0 for row in rows]) for rows in people.values()]
            count = sum(map(len, people.values()))
            columns = summary([*map(float, shares)], "with_step", np.mean, trials=count, **means)
            table.append({**trials.named(levels), **columns})
    return table


def _mean_of_means(people: Mapping[str, Iterable[TrialRow]], column: str) -> float:
    return float(np.mean([np.mean([row.numbers[column] for row in rows]) for rows in people.values()]))


def learning(trials: Trials, measure: str = "selection_s") -> Table:
    """Return medians by the number of the trial within its condition, in at most `BINS` groups.

    Each value is the median over participants of their medians. Numbers count trials of all outcomes. Raises:
    ConfigError: If nothing is known of `measure`.
    """
    known = {id(row) for row in values_of(trials, measure)}
    seen: Counter[tuple[tuple[str, ...], str]] = Counter()
    numbered: list[tuple[TrialRow, int]] = []
    for row in trials.counted:
        seen[row.levels, row.participant] += 1
        numbered.append((row, seen[row.levels, row.participant]))
    max_trials = max(seen.values())
    width = -(-max_trials // BINS)
    cells: dict[tuple[tuple[str, ...], int], dict[str, list[float]]] = {}
    for row, number in numbered:
        if id(row) in known:
            people = cells.setdefault((row.levels, (number - 1) // width), {})
            people.setdefault(row.participant, []).append(row.numbers[measure])
    table = Table()
    for levels in trials.conditions:
        for group in range(-(-max_trials // width)):
            values = [float(np.median(one)) for one in cells.get((levels, group), {}).values()]
            ends = {"first_trial": group * width + 1, "last_trial": min((group + 1) * width, max_trials)}
            if values:
                table.append({**trials.named(levels), **summary(values, "median", np.median, **ends)})
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
    _, member, sizes = np.unique(groups, return_inverse=True, return_counts=True)
    sums = np.zeros((len(sizes), p + 1))
    whole = np.column_stack([design, values])
    np.add.at(sums, member, whole)
    products = whole.T @ whole

    def solved(ratio: float) -> tuple[float, Array, Array, float]:
        """Return minus two log likelihoods, effects, the inverse of X'V⁻¹X and the residual variance."""
        weights = ratio / (1 + ratio * sizes)
        a = products - sums.T @ (weights[:, None] * sums)
        inverse = np.linalg.inv(a[:p, :p])
        effects = inverse @ a[:p, p]
        variance = max(float(a[p, p] - a[:p, p] @ effects), 1e-300) / (n - p)
        determinant = float(np.linalg.slogdet(a[:p, :p])[1])
        deviance = (n - p) * np.log(variance) + float(np.sum(np.log1p(ratio * sizes))) + determinant
        return float(deviance), effects, np.asarray(inverse, dtype=np.float64), variance

    found = optimize.minimize_scalar(
        lambda log_ratio: solved(float(np.exp(log_ratio)))[0], bounds=(-18, 18), method="bounded"
    )
    ratio = float(np.exp(found.x))
    if solved(0.0)[0] <= found.fun:
        ratio = 0.0
    _, effects, inverse, variance = solved(ratio)
    errors = np.sqrt(variance * np.diag(inverse))
    return ModelFit(effects, errors, float(np.sqrt(ratio * variance)), float(np.sqrt(variance)))


def mixed_model(trials: Trials, measure: str = "selection_s") -> Table:
    """Return the model of the logarithm of `measure`, of single trials: main effects of all factors.

    Effects are against the first level of a factor, as ratios: 1.2 means 20 % longer. Intervals and p (Wald)
    are of the normal distribution. The last rows are the standard deviations of the logarithm, between
    participants and within.

    Raises: ConfigError: If nothing is known of `measure`, there is no factor or only one participant, or
        effects cannot be told apart.
    """
    rows = [row for row in values_of(trials, measure) if row.numbers[measure] > 0]
    people = [row.participant for row in rows]
    if len(set(people)) < 2 or not trials.factors:
        raise ConfigError(f"{trials.folder}: a mixed model needs two participants and a factor")
    names = ["(Intercept)"]
    columns = [np.ones(len(rows))]
    for index, factor in enumerate(trials.factors):
        present = {row.levels[index] for row in rows}
        first, *others = [level for level in trials.levels(factor) if level in present]
        for level in others:
            names.append(f"{factor}: {level} / {first}")
            columns.append(np.array([float(row.levels[index] == level) for row in rows]))
    made = fit(np.log([row.numbers[measure] for row in rows]), np.column_stack(columns), people)
    quantile = float(stats.norm.ppf((1 + LEVEL) / 2))
    table = Table()
    for name, effect, error in zip(names, made.effects, made.errors, strict=True):
        table.append(
            {
                "term": name,
                "ratio": float(np.exp(effect)),
                "low": float(np.exp(effect - quantile * error)),
                "high": float(np.exp(effect + quantile * error)),
                "p": None if name == names[0] else float(2 * stats.norm.sf(abs(effect / error))),
            }
        )
    for name, size in (("SD between participants (log)", made.between), ("SD within (log)", made.residual)):
        table.append({"term": name, "ratio": size, "low": None, "high": None, "p": None})
    return table
