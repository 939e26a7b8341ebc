"""A linear mixed model: fixed effects of the factors, a random intercept of each participant."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from pointit.errors import ConfigError
from pointit.study_report.comparisons import values_of
from pointit.study_report.table import LEVEL, Table
from pointit.study_report.trial_row import Trials

Floats = NDArray[np.float64]


class ModelFit(NamedTuple):
    """Estimates of the fixed effects and their standard errors, shapes (p,); standard deviations."""

    effects: Floats
    errors: Floats
    between: float
    """Standard deviation of the random intercepts."""
    residual: float


def fit(values: Floats, design: Floats, groups: Sequence[str]) -> ModelFit:
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

    def solved(ratio: float) -> tuple[float, Floats, Floats, float]:
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
    names, columns = ["(Intercept)"], [np.ones(len(rows))]
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
