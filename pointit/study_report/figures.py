"""Figures of a report. They need matplotlib, the extra `plot`.

Text and axes are of a colour that `svg` replaces by that of the page, so that they are readable on light and
on dark. The palette of the data is that of Okabe and Ito, for all kinds of colour vision.
"""

import re
import warnings
from collections.abc import Sequence
from io import StringIO
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from pointit.study.table_file import OUTCOMES
from pointit.study_report import comparisons, tapping_movements
from pointit.study_report.reading import MEASURES, Trials
from pointit.study_report.table import Table
from pointit.study_report.tapping_movements import Index

INK = "#7a7a7b"
"""Readable on white and on black; `svg` replaces it by the colour of the page's text."""
COLOURS = ("#1f83c8", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8a8a8a")
STYLE: dict[str, Any] = {
    **dict.fromkeys(("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color"), INK),
    "axes.facecolor": "none",
    "axes.spines.right": False,
    "axes.spines.top": False,
    "figure.facecolor": "none",
    "font.size": 10,
    "text.parse_math": False,  # names of levels are no formulas
    "svg.fonttype": "none",
    "svg.hashsalt": "pointit",
}
WIDE_IN = 6.4


def medians(trials: Trials, measure: str = "selection_s") -> Figure:
    """Return the table `medians` as a figure; small dots are participants."""
    table = comparisons.medians(trials, measure)
    people = comparisons.participant_medians(trials, measure, *trials.factors)
    figure, axes = _axes(len(table))
    for place, (row, levels) in enumerate(zip(table, trials.conditions, strict=True)):
        values = [*people.get(levels, {}).values()]
        offsets = np.zeros(len(values))
        if len(values) > 1:
            offsets = np.linspace(-0.25, 0.25, len(values))
        axes.plot(values, place + offsets, "o", color=COLOURS[place % 7], ms=3, alpha=0.55)
        _interval(axes, place, row, "median")
    _rows(axes, [trials.label(levels) for levels in trials.conditions])
    axes.set_xlim(left=0)
    axes.set_xlabel(MEASURES.get(measure, measure))
    return figure


def differences(trials: Trials, measure: str = "selection_s") -> Figure:
    """Return the table `differences` as a figure."""
    table = comparisons.differences(trials, measure)
    figure, axes = _axes(len(table))
    axes.axvline(0, color=INK, lw=0.8, ls=":")
    for place, row in enumerate(table):
        _interval(axes, place, row, "mean")
    _rows(axes, [f"{row['factor']}: {row['difference']}" for row in table])
    axes.set_xlabel(f"difference, {MEASURES.get(measure, measure)}")
    return figure


def outcomes(trials: Trials) -> Figure:
    """Return the shares of outcomes as a figure."""
    table = comparisons.outcomes(trials)
    figure, axes = _axes(len(table), legend=True)
    begin = np.zeros(len(table))
    for name, colour in zip(OUTCOMES, ("#009e73", "#d55e00", "#e69f00", "#8a8a8a"), strict=True):
        shares = np.array([row[name] for row in table])
        axes.barh(range(len(table)), shares * 100, left=begin * 100, color=colour, height=0.6, label=name)
        begin += shares
    _rows(axes, [trials.label(levels) for levels in trials.conditions])
    axes.set_xlim(0, 100)
    axes.set_xlabel("share of trials, %")
    axes.legend(loc="lower center", bbox_to_anchor=(0.4, 1.0), ncols=4, frameon=False, labelcolor=INK)
    return figure


def learning(trials: Trials, measure: str = "selection_s") -> Figure:
    """Return the table `learning` as a figure, a line for each condition."""
    figure, axes = _axes(6)
    by_condition = _by_condition(trials, comparisons.learning(trials, measure))
    for place, (label, rows) in enumerate(by_condition):
        colour = COLOURS[place % 7]
        ends = np.array([[row["first_trial"], row["last_trial"]] for row in rows])
        numbers = ends.sum(axis=1) / 2
        medians = [row["median"] for row in rows]
        axes.plot(numbers, medians, "o-", ms=4, color=colour, label=label)
        low = [row["low"] for row in rows]
        high = [row["high"] for row in rows]
        if None not in low:
            axes.fill_between(numbers, low, high, color=colour, alpha=0.15, lw=0)
    axes.set_ylim(bottom=0)
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_xlabel("number of the trial within its condition")
    axes.set_ylabel(MEASURES.get(measure, measure))
    _key(axes)
    return figure


def fitts(trials: Trials, index: Index = "m") -> Figure:
    """Return the regressions of the table `fitts` as a figure; dots are means over participants."""
    points = tapping_movements.fitts_points(trials, index)
    figure, axes = _axes(6)
    for place, row in enumerate(tapping_movements.fitts(trials, index)):
        group = tuple((factor, row[factor]) for factor in trials.factors if factor in row)
        bits = points[group].bits
        mean_times = points[group].times.mean(axis=0)
        colour = COLOURS[place % 7]
        label = trials.label(level for _, level in group)
        axes.plot(bits, mean_times, "o", color=colour, ms=5, label=label)
        ends = np.array([bits.min(), bits.max()])
        seconds = row["intercept_s"] + row["slope_s_per_bit"] * ends
        axes.plot(ends, seconds, color=colour)
    axes.set_ylim(bottom=0)
    unit = " of Kopper et al." if index == "kopper" else ", bit"
    axes.set_xlabel(f"index of difficulty{unit}")
    axes.set_ylabel(MEASURES["selection_s"])
    _key(axes)
    return figure


def svg(figure: Figure, name: str) -> str:
    """Return `figure` as an SVG element for an HTML page; `name` makes the element's ids its own."""
    text = StringIO()
    settings: Any = mpl  # its stubs list every parameter there is
    with settings.rc_context(STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # the page has fonts of its own
        saved: Any = figure
        saved.savefig(text, format="svg", metadata={"Date": None, "Creator": None}, bbox_inches="tight")

    # An element of the page: without a head, in the page's colour and font, with ids of its own.
    document = text.getvalue()
    element = document[document.index("<svg") :].replace(INK, "currentColor")
    element = re.sub(r"<metadata>.*?</metadata>", "", element, flags=re.DOTALL)
    element = re.sub(r"font: (\S+) [^;\"]+", r"font-size: \1; font-family: inherit", element)
    return re.sub(r'(id="|href="#|url\(#)', rf"\g<1>{name}-", element)


def _axes(rows: int, *, legend: bool = False) -> tuple[Figure, Any]:
    settings: Any = mpl
    with settings.rc_context(STYLE):
        height_in = 0.9 + 0.42 * max(rows, 1) + 0.3 * legend
        figure: Any = Figure(figsize=(WIDE_IN, height_in))
        axes: Any = figure.add_subplot()
    return figure, axes


def _rows(axes: Any, labels: Sequence[str]) -> None:
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(len(labels) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0)


def _interval(axes: Any, place: int, row: dict[str, Any], column: str) -> None:
    """Draw the interval of `row` about its `column`."""
    colour = COLOURS[place % 7]
    if row["low"] is not None:
        axes.plot([row["low"], row["high"]], [place, place], color=colour, lw=2.5, solid_capstyle="butt")
    if row[column] is not None:
        axes.plot([row[column]], [place], "D", color=colour, ms=6)


def _by_condition(trials: Trials, table: Table) -> list[tuple[str, list[dict[str, Any]]]]:
    rows_by_label: dict[str, list[dict[str, Any]]] = {}
    for row in table:
        label = trials.label(row[factor] for factor in trials.factors)
        rows_by_label.setdefault(label, []).append(row)
    return [*rows_by_label.items()]


def _key(axes: Any) -> None:
    if len(axes.get_legend_handles_labels()[1]) > 1:
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, labelcolor=INK)
