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
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from pointit.runtime.errors import ConfigError
from pointit.study_report.model import SELECTED, TARGET, TrialRow, Trials
from pointit.study_report.table import Table, percentile_interval, resample_indices, summary

Unit = Literal["m", "deg"]
Index = Literal["m", "deg", "kopper"]
"""Index of difficulty: log2(D / W + 1) of metres or degrees, or that of Kopper et al. (2010) of degrees."""
Floats = NDArray[np.float64]

WIDTHS_PER_SD = float(np.sqrt(2 * np.pi * np.e))
"""4.133: the width that 96 % of normally distributed selections hit, in standard deviations."""
LEAST_TRIALS = 5
"""Least trials of a sequence. The standard's circles have 9 to 25."""
KOPPER_EXPONENT = 3
"""k of Kopper et al. (2010), for angles in degrees."""
MOST_UNEVEN = 1.05
"""Highest ratio of distances, and of widths, that count as equal."""
Group = tuple[tuple[str, str], ...]
"""Levels by factor, without the factors that set the distance or the width, of which difficulty is made."""


class Movement(NamedTuple):
    """A trial that began at the known target of the trial before, in the same block."""

    trial: TrialRow
    distance_m: float
    """From target to target."""
    error_m: float
    """Along that line, positive beyond the target. NaN if nothing was selected."""
    before_m: float
    """Error with which the trial before ended, along its own line. NaN if not known."""
    size_m: tuple[float, float] = (0.0, 0.0)
    """Distance and width, where those that are nearly equal are the same."""
    group: Group = ()


def movements(study: Trials) -> list[Movement]:
    """Return the movements of all counted trials with a width, a target and a target before, by condition."""
    found: list[Movement] = []
    error_m = np.nan
    for start, row in zip(study.counted, study.counted[1:], strict=False):
        before_m, error_m = error_m, np.nan
        is_next = (start.participant, start.block) == (row.participant, row.block)
        if not is_next or not all(name in each.numbers for name in TARGET for each in (start, row)):
            continue
        target = _point(row, TARGET)
        line = target - _point(start, TARGET)
        distance_m = float(np.linalg.norm(line))
        if distance_m > 0 and row.numbers.get("target_width_m", 0) > 0:
            if all(name in row.numbers for name in SELECTED):
                error_m = float((_point(row, SELECTED) - target) @ line) / distance_m
            found.append(Movement(row, distance_m, error_m, before_m))
    found.sort(key=lambda each: study.conditions.index(each.trial.levels))
    distances = _merged([each.distance_m for each in found])
    widths = _merged([each.trial.numbers["target_width_m"] for each in found])
    sizes = [(distances[each.distance_m], widths[each.trial.numbers["target_width_m"]]) for each in found]
    kept = [factor for factor in study.factors if not _sets_size(study.index(factor), found, sizes)]
    groups = (tuple((name, each.trial.levels[study.index(name)]) for name in kept) for each in found)
    return [
        each._replace(size_m=size, group=group)
        for each, size, group in zip(found, sizes, groups, strict=True)
    ]


def _sets_size(factor: int, moved: Sequence[Movement], sizes: Sequence[tuple[float, float]]) -> bool:
    """Return True if each level of a factor has one distance of its own, or one width."""
    for part in (0, 1):
        by_level: dict[str, set[float]] = defaultdict(set)
        for each, size in zip(moved, sizes, strict=True):
            by_level[each.trial.levels[factor]].add(size[part])
        values = {value for found in by_level.values() for value in found}
        if 1 < len(by_level) == len(values) and all(len(found) == 1 for found in by_level.values()):
            return True
    return False


def _point(trial: TrialRow, names: Sequence[str]) -> NDArray[np.float64]:
    return np.array([trial.numbers[name] for name in names])


def _merged(values: Sequence[float]) -> dict[float, float]:
    """Return the mean of the group of each value; groups begin at the least, with at most `MOST_UNEVEN`."""
    groups: list[list[float]] = []
    for value in sorted(set(values)):
        if not groups or value > groups[-1][0] * MOST_UNEVEN:
            groups.append([])
        groups[-1].append(value)
    return {value: sum(group) / len(group) for group in groups for value in group}


class Effective(NamedTuple):
    """A sequence of trials with one distance and one width, as it was done: means along the movement."""

    distance: float
    width: float
    """4.133 standard deviations of the errors."""
    seconds: float

    @property
    def bits(self) -> float:
        """Effective index of difficulty, bit."""
        return float(np.log2(self.distance / self.width + 1))

    @property
    def throughput(self) -> float:
        """Throughput, bit/s."""
        return self.bits / self.seconds


def effective(distance: Floats, error: Floats, before: Floats, seconds: Floats) -> Effective:
    """Return the effective distance and width of a sequence of trials, of arrays of shape (n,).

    `error` is positive beyond the target, NaN if the trial is left out. `before` is the error with which the
    movement before ended, where this one begins: it is added to the distance. NaN if not known, or if the
    trial begins at the centre of the target before.
    """
    moved = distance + error + np.nan_to_num(before)
    known = ~np.isnan(error)
    width = WIDTHS_PER_SD * float(error[known].std(ddof=1))
    return Effective(float(moved[known].mean()), width, float(seconds[known].mean()))


def throughput(study: Trials, unit: Unit = "m") -> Table:
    """Return the throughput of each `Group`: the mean over participants of the means of their sequences.

    A sequence is the trials of a block with the same condition, distance and width. A movement begins at the
    target before, so that a block's first trial is not counted. Selections further from the target than half
    the distance are gross errors and left out (Soukoreff and MacKenzie, 2004). Times include reaction and
    dwell. Errors in degrees are those in metres, at the distance of the target.

    Raises: ConfigError: If no sequence has `LEAST_TRIALS`.
    """
    found: dict[Group, dict[str, list[Effective]]] = defaultdict(lambda: defaultdict(list))
    gross: Counter[Group] = Counter()
    sequences: dict[tuple[object, ...], list[Movement]] = defaultdict(list)
    for each in movements(study):
        row = each.trial
        needed = ("selection_s", f"target_distance_{unit}", f"target_width_{unit}")
        if row.outcome in ("hit", "wrong") and not np.isnan(each.error_m) and row.numbers.keys() >= {*needed}:
            sequences[row.participant, row.block, row.levels, each.size_m].append(each)
    for moved in sequences.values():
        group = moved[0].group
        distance, error, before = (
            np.array(column) for column in zip(*(_in(one, unit) for one in moved), strict=True)
        )
        far = np.abs(error) > distance / 2
        gross[group] += int(far.sum())
        error[far] = np.nan
        if np.sum(~np.isnan(error)) < LEAST_TRIALS or np.nanstd(error) == 0:
            continue
        seconds = np.array([one.trial.numbers["selection_s"] for one in moved])
        found[group][moved[0].trial.participant].append(effective(distance, error, before, seconds))
    if not found:
        raise ConfigError(
            f"{study.folder}: no block has {LEAST_TRIALS} selections in a row with one distance and width in"
            f" {unit}, so there is no throughput; it is of tapping tasks"
        )
    table = Table()
    for group, by_participant in found.items():
        people = [[(each.throughput, each.bits, *each) for each in one] for one in by_participant.values()]
        means = np.array([np.mean(one, axis=0) for one in people])
        _, *mean = (float(each) for each in means.mean(axis=0))
        names = ("effective_bits", f"effective_distance_{unit}", f"effective_width_{unit}", "movement_s")
        columns = summary(
            means[:, 0].tolist(), "throughput_bit_per_s", np.mean, sequences=sum(map(len, people))
        )
        more = dict(zip(names, mean, strict=True))
        table.append({**dict(group), **columns, **more, "left_out": gross[group]})
    return table


def bits(distance: Floats, width: Floats, index: Index = "m") -> Floats:
    """Return the index of difficulty: log2(D / W + 1), bit; for `kopper` log2(D / W³ + 1)², of degrees."""
    if index == "kopper":
        return np.asarray(np.log2(distance / width**KOPPER_EXPONENT + 1) ** 2)
    return np.asarray(np.log2(distance / width + 1))


def fitts_points(study: Trials, index: Index = "m") -> dict[Group, tuple[Floats, Floats]]:
    """Return for each condition the indices of difficulty (k,) and times of the participants (n, k), s.

    A time is the mean of a participant's hits with that distance and width, NaN if there is none.
    """
    names = ("target_distance_deg", "target_width_deg")
    cells: dict[Group, dict[tuple[float, float], list[TrialRow]]] = defaultdict(lambda: defaultdict(list))
    for each in movements(study):
        if each.trial.outcome == "hit" and (index == "m" or each.trial.numbers.keys() >= {*names}):
            cells[each.group][each.size_m].append(each.trial)
    found: dict[Group, tuple[Floats, Floats]] = {}
    for group, sizes in cells.items():
        size = np.array(sorted(sizes))
        people = sorted({row.participant for rows in sizes.values() for row in rows})
        times = np.full((len(people), len(size)), np.nan)
        for column, rows in enumerate(sizes[key] for key in sorted(sizes)):
            for place, who in enumerate(people):
                if own := [row.numbers["selection_s"] for row in rows if row.participant == who]:
                    times[place, column] = np.mean(own)
            if index != "m":
                size[column] = np.mean([[row.numbers[name] for name in names] for row in rows], axis=0)
        found[group] = bits(size[:, 0], size[:, 1], index), times
    return found


def fitts(study: Trials, index: Index = "m") -> Table:
    """Return the regression of the time over the index of difficulty, of each `Group`.

    The points are the means over participants. Intervals are bootstrap intervals over participants.

    Raises: ConfigError: If no condition has three indices of difficulty.
    """
    table = Table()
    for group, (difficulty, times) in fitts_points(study, index).items():
        whole = times[~np.isnan(times).any(axis=1)]
        if len(set(difficulty.tolist())) < 3 or not len(whole):
            continue
        fit = stats.linregress(difficulty, whole.mean(axis=0))
        limits: list[float | None] = [None] * 4
        if len(whole) > 1:
            resampled = whole[resample_indices(len(whole))].mean(axis=1)
            centred = difficulty - difficulty.mean()
            slopes = resampled @ centred / (centred @ centred)
            limits = [
                *percentile_interval(resampled.mean(axis=1) - slopes * difficulty.mean()),
                *percentile_interval(slopes),
            ]
        row: dict[str, Any] = {
            "participants": len(whole),
            "points": len(difficulty),
            "intercept_s": float(fit.intercept),
        }
        row |= {"intercept_low": limits[0], "intercept_high": limits[1], "slope_s_per_bit": float(fit.slope)}
        row |= {"slope_low": limits[2], "slope_high": limits[3], "r2": float(fit.rvalue) ** 2}
        table.append({**dict(group), **row})
    if not table:
        raise ConfigError(
            f"{study.folder}: no condition has three different distances or widths of all its"
            " participants, so there is no regression; add targets of other sizes"
        )
    return table


def _in(moved: Movement, unit: Unit) -> tuple[float, float, float]:
    """Return distance, error along the line and the error before in `unit`."""
    if unit == "m":
        return moved.distance_m, moved.error_m, moved.before_m
    numbers = moved.trial.numbers
    degrees_per_m = numbers["target_width_deg"] / numbers["target_width_m"]
    return numbers["target_distance_deg"], moved.error_m * degrees_per_m, moved.before_m * degrees_per_m
