"""Plot of the rows: time, wrong and missed by condition, one marker per method, people in black."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy
from pointit.runtime.host.state_file import replaced_file
from pointit_lab.evaluation.selection.row import SelectionMetrics, SelectionTrialRow

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
        raise ConfigError(f"--plot {path}: the name must end in one of {', '.join(sorted(suffixes))}")


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
        names = list(dict.fromkeys(row.condition for row in bench_rows))
        methods = dict.fromkeys(row.method for row in bench_rows)
        for axis, (title, value) in zip(axes, PANELS, strict=True):
            # methods, in the colours of the legend
            for index, method in enumerate(methods):
                method_rows = [row for row in bench_rows if row.method == method]
                method_values = {row.condition: value(row.figures) for row in method_rows}
                axis.plot(
                    range(len(names)),
                    _heights(method_values, names),
                    color=COLORS[index % len(COLORS)],
                    marker=MARKS[index % len(MARKS)],
                    label=method,
                )

            # people, where there are recordings of the condition
            people_rows = [row for row in bench_rows if "pointing" in row.human]
            people = {row.condition: value(row.human["pointing"]) for row in people_rows}
            if people:
                axis.plot(range(len(names)), _heights(people, names), "k*--", label="people")
            axis.set_title(f"{bench}: {title}")
            axis.set_xticks(range(len(names)), names, rotation=40, ha="right", fontsize=7)
            axis.set_ylim(bottom=0.0)
    all_axes[0][0].legend(fontsize=7)
    with replaced_file(path) as part:
        figure.savefig(part)


def _heights(values: Mapping[str, float | None], names: Sequence[str]) -> list[float]:
    """Return the values of the conditions `names`; NaN, which leaves a gap, where there is none."""
    heights: list[float] = []
    for name in names:
        value = values.get(name)
        heights.append(float("nan") if value is None else value)
    return heights
