"""Plot of the rows: time, wrong and missed by condition, one marker per method, people in black."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy
from pointit.runtime.host.state_file import replaced_file
from pointit_lab.evaluation.selection.row import SelectionMetrics, SelectionTrialRow

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Value = Callable[[SelectionMetrics], float | None]

PANELS: tuple[tuple[str, Value], ...] = (
    ("time, s", lambda figures: None if figures.time_s is None else figures.time_s.median),
    ("wrong, %", lambda figures: None if figures.wrong_rate is None else 100.0 * figures.wrong_rate),
    ("missed, %", lambda figures: None if figures.missed_rate is None else 100.0 * figures.missed_rate),
)

COLORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")
"""Colours of methods in order (Okabe and Ito)."""
MARKS = ("o", "s", "^", "D", "v", "P")

INCHES = (4.2, 3.4)
"""Size of one panel."""


def check_plot(path: Path) -> None:
    """Check before minutes of work that a picture can be drawn.

    Raises:
        ConfigError: If matplotlib is not installed, or cannot write files with this suffix.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415 - an extra, wanted here only
    except ImportError as error:
        raise ConfigError(f"--plot {path}: needs matplotlib; run {remedy('plot')}") from error
    suffixes = FigureCanvasAgg.get_supported_filetypes()
    if path.suffix.removeprefix(".") not in suffixes:
        endings = ", ".join(sorted(suffixes))
        raise ConfigError(f"--plot {path}: the name must end in one of {endings}")


def plot(rows: Sequence[SelectionTrialRow], path: Path) -> None:
    """Write a picture of `rows` to `path`, in the format of its suffix: png, svg, pdf.

    Raises:
        ConfigError: If the file cannot be written.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra, wanted here only

    benches = list(dict.fromkeys(row.bench for row in rows))
    width = INCHES[0] * len(PANELS)
    height = INCHES[1] * len(benches)
    figure = Figure(figsize=(width, height), layout="constrained")
    all_axes = figure.subplots(len(benches), len(PANELS), squeeze=False)
    for bench, axes in zip(benches, all_axes, strict=True):
        bench_rows = [row for row in rows if row.bench == bench]
        for axis, (title, value) in zip(axes, PANELS, strict=True):
            axis.set_title(f"{bench}: {title}")
            _draw_panel(axis, bench_rows, value)
    all_axes[0][0].legend(fontsize=7)
    with replaced_file(path) as part:
        figure.savefig(part)


def _draw_panel(axis: "Axes", rows: Sequence[SelectionTrialRow], value: Value) -> None:
    """Draw the `value` of the rows of a bench into its panel."""
    names = list(dict.fromkeys(row.condition for row in rows))
    ticks = range(len(names))

    # methods, in the colours of the legend
    methods = dict.fromkeys(row.method for row in rows)
    for index, method in enumerate(methods):
        own_rows = [row for row in rows if row.method == method]
        values = {row.condition: value(row.figures) for row in own_rows}
        color = COLORS[index % len(COLORS)]
        mark = MARKS[index % len(MARKS)]
        axis.plot(ticks, _heights(values, names), color=color, marker=mark, label=method)

    # people, where there are recordings of the condition
    people_rows = [row for row in rows if "pointing" in row.human]
    people = {row.condition: value(row.human["pointing"]) for row in people_rows}
    if people:
        axis.plot(ticks, _heights(people, names), "k*--", label="people")
    axis.set_xticks(ticks, names, rotation=40, ha="right", fontsize=7)
    axis.set_ylim(bottom=0.0)


def _heights(values: Mapping[str, float | None], names: Sequence[str]) -> list[float]:
    """Return the values of the conditions `names`; NaN, which leaves a gap, where there is none."""
    heights: list[float] = []
    for name in names:
        value = values.get(name)
        heights.append(float("nan") if value is None else value)
    return heights
