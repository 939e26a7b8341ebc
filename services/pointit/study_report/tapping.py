"""Throughput after ISO 9241-411, and regressions of Fitts' law, in metres and in degrees.

- ISO/TS 9241-411:2012, annex B. Soukoreff, R. W. and MacKenzie, I. S. (2004). Towards a standard for pointing
  device evaluation. Int. J. Human-Computer Studies 61, 751-789: effective width, mean of means.
- MacKenzie, I. S. (2015). Fitts' throughput and the remarkable case of touch-based target selection. HCI
  International, LNCS 9170, 238-249: the effective distance, and the calculation in two dimensions.
- Kopper, R., Bowman, D. A., Silva, M. G. and McMahan, R. P. (2010). A human motor behavior model for distal
  pointing tasks. Int. J. Human-Computer Studies 68, 603-615: angles, and an index that grows with the square.
- Lane, L., Lu, F., Davari, S., Teather, R. J. and Bowman, D. A. (2025). Revisiting performance models of
  distal pointing tasks in virtual reality. IEEE TVCG (arXiv 2505.03027): Fitts' index of angles fits best.
"""

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from pointit.runtime.errors import ConfigError
from pointit.study_report.reading import POINTS, Trial, Trials
from pointit.study_report.table import Table, bounds, interval, picks

Unit = Literal["m", "deg"]
Index = Literal["m", "deg", "kopper"]
"""Index of difficulty: log2(D / W + 1) of metres or degrees, or that of Kopper et al. (2010) of degrees."""
Floats = NDArray[np.float64]

WIDTHS_PER_SD = float(np.sqrt(2 * np.pi * np.e))
"""4.133: the width that 96 % of normally distributed selections hit, in standard deviations."""
MOST_UNEVEN = 1.05
"""Highest ratio of distances, and of widths, of trials that are one sequence."""
LEAST_TRIALS = 5
"""Least trials of a sequence. The standard's circles have 9 to 25."""
KOPPER_EXPONENT = 3
"""k of Kopper et al. (2010), for angles in degrees."""


@dataclass(frozen=True, kw_only=True)
class Effective:
    """What was done in a sequence of trials with one distance and one width."""

    distance: float
    """Effective distance: the mean of the movements along the line from start to target."""
    width: float
    """Effective width: 4.133 standard deviations of the errors along that line."""
    seconds: float
    """Mean time of a movement, s."""

    @property
    def bits(self) -> float:
        """Effective index of difficulty, bit."""
        return float(np.log2(self.distance / self.width + 1))

    @property
    def throughput(self) -> float:
        """Throughput, bit/s."""
        return self.bits / self.seconds


def along(start: Floats, target: Floats, selected: Floats) -> tuple[Floats, Floats]:
    """Return distances from `start` to `target` and errors along that line, (n,), of points (n, d)."""
    line = target - start
    distance = np.linalg.norm(line, axis=1)
    return distance, np.sum((selected - target) * line, axis=1) / distance


def effective(distance: Floats, error: Floats, before: Floats, seconds: Floats) -> Effective:
    """Return the effective distance and width of a sequence of trials, of arrays of shape (n,).

    `error` is positive beyond the target, NaN if the trial is left out. `before` is the error with which the
    movement before ended, where this one begins: it is added to the distance. NaN if not known, or if the
    trial begins at the centre of the target before.
    """
    moved = distance + error + np.nan_to_num(before)
    known = ~np.isnan(error)
    return Effective(
        distance=float(moved[known].mean()),
        width=WIDTHS_PER_SD * float(error[known].std(ddof=1)),
        seconds=float(seconds[known].mean()),
    )


def throughput(study: Trials, unit: Unit = "m") -> Table:
    """Return the throughput of each condition: the mean over participants of the means of their sequences.

    A sequence is the trials of a block with the same condition, distance and width. A movement begins at the
    target before, so that a block's first trial is not counted. Selections further from the target than half
    the distance are gross errors and left out (Soukoreff and MacKenzie, 2004). Times include reaction and
    dwell. In degrees, an error's share along the line is that in metres.

    Raises: ConfigError: If no sequence has `LEAST_TRIALS`.
    """
    found: dict[tuple[str, ...], dict[str, list[Effective]]] = defaultdict(lambda: defaultdict(list))
    gross: Counter[tuple[str, ...]] = Counter()
    for rows in _sequences(study, unit):
        distance, error, seconds = _movements(rows, unit)
        far = np.abs(error) > distance / 2
        gross[rows[0][1].levels] += int(far.sum())
        error[far] = np.nan
        ended = {id(row): each for (_, row), each in zip(rows, error, strict=True)}
        before = np.array([ended.get(id(start), np.nan) for start, _ in rows])
        if np.sum(~np.isnan(error)) < LEAST_TRIALS or np.nanstd(error) == 0:
            continue
        trial = rows[0][1]
        found[trial.levels][trial.participant].append(effective(distance, error, before, seconds))
    if not found:
        raise ConfigError(
            f"{study.folder}: no block has {LEAST_TRIALS} selections in a row with one distance and width in"
            f" {unit}, so there is no throughput; it is of tapping tasks"
        )
    table = Table()
    for levels in study.conditions:
        people = [
            [(each.throughput, each.bits, each.distance, each.width, each.seconds) for each in sequences]
            for sequences in found.get(levels, {}).values()
        ]
        if not people:
            continue
        means = np.array([np.mean(one, axis=0) for one in people])
        low, high = interval(means[:, 0], np.mean)
        mean = [float(each) for each in means.mean(axis=0)]
        table.append(
            {
                **dict(zip(study.factors, levels, strict=True)),
                "participants": len(people),
                "sequences": sum(map(len, people)),
                "throughput_bit_per_s": mean[0],
                "low": low,
                "high": high,
                "effective_bits": mean[1],
                f"effective_distance_{unit}": mean[2],
                f"effective_width_{unit}": mean[3],
                "movement_s": mean[4],
                "left_out": gross[levels],
            }
        )
    return table


def bits(distance: Floats, width: Floats, index: Index = "m") -> Floats:
    """Return the index of difficulty: log2(D / W + 1), bit; for `kopper` log2(D / W³ + 1)², of degrees."""
    if index == "kopper":
        return np.asarray(np.log2(distance / width**KOPPER_EXPONENT + 1) ** 2)
    return np.asarray(np.log2(distance / width + 1))


def fitts_points(study: Trials, index: Index = "m") -> dict[tuple[str, ...], tuple[Floats, Floats]]:
    """Return for each condition the indices of difficulty (k,) and times of the participants (n, k), s.

    A time is the mean of a participant's hits with that distance and width, NaN if there is none.
    """
    unit: Unit = "m" if index == "m" else "deg"
    rows = [row for row in _sized(study, unit) if row.outcome == "hit"]
    size = {id(row): key for row, key in zip(rows, _sizes(rows, unit), strict=True)}
    found: dict[tuple[str, ...], tuple[Floats, Floats]] = {}
    for levels in study.conditions:
        own = [row for row in rows if row.levels == levels]
        keys = sorted({size[id(row)] for row in own})
        cells: dict[tuple[str, tuple[float, float]], list[float]] = defaultdict(list)
        for row in own:
            cells[row.participant, size[id(row)]].append(row.numbers["selection_s"])
        people = sorted({row.participant for row in own})
        times = [[np.mean(cells[who, key]) if cells[who, key] else np.nan for key in keys] for who in people]
        if keys:
            sizes = np.array(keys)
            found[levels] = bits(sizes[:, 0], sizes[:, 1], index), np.array(times)
    return found


def fitts(study: Trials, index: Index = "m") -> Table:
    """Return the regression of the time over the index of difficulty, of each condition.

    The points are the means over participants. Intervals are bootstrap intervals over participants.

    Raises: ConfigError: If no condition has three indices of difficulty.
    """
    table = Table()
    for levels, (difficulty, times) in fitts_points(study, index).items():
        whole = times[~np.isnan(times).any(axis=1)]
        if len(set(difficulty.tolist())) < 3 or not len(whole):
            continue
        fit = stats.linregress(difficulty, whole.mean(axis=0))
        limits: list[float | None] = [None] * 4
        if len(whole) > 1:
            resampled = whole[picks(len(whole))].mean(axis=1)
            centred = difficulty - difficulty.mean()
            slopes = resampled @ centred / (centred @ centred)
            limits = [*bounds(resampled.mean(axis=1) - slopes * difficulty.mean()), *bounds(slopes)]
        table.append(
            {
                **dict(zip(study.factors, levels, strict=True)),
                "participants": len(whole),
                "points": len(difficulty),
                "intercept_s": float(fit.intercept),
                "intercept_low": limits[0],
                "intercept_high": limits[1],
                "slope_s_per_bit": float(fit.slope),
                "slope_low": limits[2],
                "slope_high": limits[3],
                "r2": float(fit.rvalue) ** 2,
            }
        )
    if not table:
        raise ConfigError(
            f"{study.folder}: no condition has three different distances or widths of all its"
            " participants, so there is no regression; add targets of other sizes"
        )
    return table


def _sized(study: Trials, unit: Unit) -> list[Trial]:
    """Return the counted trials with a distance and a width, whether they were hit or not."""
    names = (f"target_distance_{unit}", f"target_width_{unit}")
    return [row for row in study.counted if all(row.numbers.get(name, 0) > 0 for name in names)]


def _sizes(rows: Sequence[Trial], unit: Unit) -> list[tuple[float, float]]:
    """Return distance and width of each of `rows`, where those that are nearly equal get the same."""
    distances, widths = (
        _merged([row.numbers[f"target_{what}_{unit}"] for row in rows]) for what in ("distance", "width")
    )
    return [
        (distances[row.numbers[f"target_distance_{unit}"]], widths[row.numbers[f"target_width_{unit}"]])
        for row in rows
    ]


def _merged(values: Sequence[float]) -> dict[float, float]:
    """Return the mean of the group of each value; groups begin at the least, with at most `MOST_UNEVEN`."""
    groups: list[list[float]] = []
    for value in sorted(set(values)):
        if not groups or value > groups[-1][0] * MOST_UNEVEN:
            groups.append([])
        groups[-1].append(value)
    return {value: sum(group) / len(group) for group in groups for value in group}


def _sequences(study: Trials, unit: Unit) -> list[list[tuple[Trial, Trial]]]:
    """Return sequences of pairs: the trial before, from whose target the movement begins, and the trial."""
    rows = _sized(study, "m")
    size = {id(row): key for row, key in zip(rows, _sizes(rows, "m"), strict=True)}
    before: dict[int, Trial] = {}
    for first, second in zip(study.counted, study.counted[1:], strict=False):
        if (first.participant, first.block) == (second.participant, second.block):
            before[id(second)] = first
    found: dict[tuple[object, ...], list[tuple[Trial, Trial]]] = defaultdict(list)
    for row in rows:
        start = before.get(id(row))
        needed = (*POINTS, "selection_s", *(("error_deg", "target_distance_deg") if unit == "deg" else ()))
        if (
            start is None
            or row.outcome not in ("hit", "wrong")
            or not all(name in row.numbers for name in needed)
        ):
            continue
        if all(name in start.numbers for name in POINTS[:3]) and _point(start, 0) != _point(row, 0):
            found[row.participant, row.block, row.levels, size[id(row)]].append((start, row))
    return [*found.values()]


def _point(trial: Trial, begin: int) -> tuple[float, ...]:
    return tuple(trial.numbers[name] for name in POINTS[begin : begin + 3])


def _movements(rows: Sequence[tuple[Trial, Trial]], unit: Unit) -> tuple[Floats, Floats, Floats]:
    """Return distances, errors along the line and times of a sequence, in `unit` and s."""
    target = np.array([_point(row, 0) for _, row in rows])
    selected = np.array([_point(row, 3) for _, row in rows])
    distance, error = along(np.array([_point(start, 0) for start, _ in rows]), target, selected)
    if unit == "deg":
        whole = np.linalg.norm(selected - target, axis=1)
        share = np.divide(error, whole, out=np.zeros_like(error), where=whole > 0)
        error = share * np.array([row.numbers["error_deg"] for _, row in rows])
        distance = np.array([row.numbers["target_distance_deg"] for _, row in rows])
    return distance, error, np.array([row.numbers["selection_s"] for _, row in rows])
