"""An evaluation's tables: nothing is cut at any width, notes are about what is shown."""

import io
import re
from collections.abc import Sequence
from dataclasses import replace

import pytest
from rich.console import Console

from pointit.cli.common.progress import LINE_EVERY_S, LineProgress, progress
from pointit_lab.cli import honesty_table
from pointit_lab.cli.table import print_rows
from pointit_lab.evaluation.honesty.row import EVERY, HonestyRow
from pointit_lab.evaluation.recordings.row import ALL, Row, Spread
from pointit_lab.evaluation.selection.difference import Interval

ERROR = Spread(median=0.254, p90=0.512, rms=0.333)
TIME = Spread(median=12.25, p90=20.5, rms=15.0)
SOLVERS = ("pointit", "mean-angle-4dof", "mean-angle-z0")


def located(condition: str, solver: str, subject: str = ALL) -> Row:
    return Row(
        set="proximity_waypoints", subject=subject, condition=condition, solver=solver, n=1234,
        position_m=ERROR, every_m=ERROR, yaw_deg=ERROR, share_above_1m=0.03, misled=0.0, within_2_sigma=1.0,
        yaw_within_2_sigma=0.9, refused=12, unsure=4, solve_ms=TIME, bound_m=0.211,
    )  # fmt: skip


BRIEF = [located(condition, solver) for condition in ("2 s", "3 targets") for solver in SOLVERS]
FULL = [replace(row, subject=subject) for row in BRIEF for subject in (ALL, "track_1")]
DRIFT = [
    Row(
        set="simulated_drift", subject=ALL, condition="3 min, 1 anchor/min, 5° scatter",
        solver="re-anchored, constant rate", n=300, yaw_deg=ERROR, yaw_within_2_sigma=0.9,
    )
]  # fmt: skip


def printed(rows: Sequence[Row], width: int, remarks: Sequence[str] = ()) -> str:
    screen = Console(file=io.StringIO(), width=width)
    print_rows(screen, rows, remarks)
    assert isinstance(screen.file, io.StringIO)
    return screen.file.getvalue()


def heads(text: str) -> str:
    return next(line for line in text.splitlines() if "condition" in line)


@pytest.mark.parametrize("width", [36, 80, 130])
@pytest.mark.parametrize("rows", [BRIEF, FULL, DRIFT])
def test_nothing_is_cut_at_any_width(rows: Sequence[Row], width: int) -> None:
    text = printed(rows, width, ["A remark that is long enough to be wrapped in any terminal there is."])
    assert "…" not in text
    assert max(len(line.rstrip()) for line in text.splitlines()) <= width


def test_80_columns_show_what_counts_most() -> None:
    text = printed(BRIEF, 80)
    assert heads(text).split()[:8] == ["condition", "solver", "n", "refused", "m", "p90", "2", "sigma"]
    assert heads(text).split()[-1] == "ms"
    line = next(line for line in text.splitlines() if "3 targets" in line and "4-DoF" in line)
    assert line.split()[:9] == ["3", "targets", "4-DoF", "1234", "12", "0.254", "0.512", "100", "%"]
    assert "`4-DoF`, `z=0`: the baselines mean-angle-4dof" in " ".join(text.split())
    assert "shows also: unsure, all m, p90 of all m, bound" in " ".join(text.split())


def test_without_a_terminal_a_line_is_written_every_ten_seconds(capsys: pytest.CaptureFixture[str]) -> None:
    lines: list[str] = []
    now_s = [100.0]
    tell = LineProgress(240, lines.append, lambda: now_s[0])
    for done in range(40):
        now_s[0] = 100.0 + done
        tell("localizations", done)
    assert lines == [
        "localizations: 10 of 240, for 10 s",
        "localizations: 20 of 240, for 20 s",
        "localizations: 30 of 240, for 30 s",
    ]
    uncounted = LineProgress(None, lines.append, lambda: now_s[0])
    now_s[0] += LINE_EVERY_S
    uncounted("correcting vr_eyefinger")
    assert lines[-1] == "correcting vr_eyefinger, for 10 s"
    with progress() as shown:
        shown("reading")
    assert capsys.readouterr().err == ""


LONGEST = "shoulder right, body still"
"""The longest condition that `pointit evaluate honesty` has."""


@pytest.mark.parametrize(("width", "least"), [(80, 5), (100, 7), (140, 10)])
def test_a_condition_and_figures_are_not_cut(width: int, least: int, monkeypatch: pytest.MonkeyPatch) -> None:
    row = HonestyRow(
        set="simulated", condition=LONGEST, duration=EVERY, n=1234, taken=1.0,
        error_m=Spread(median=0.25, p90=0.51, rms=0.33), within_2_sigma=1.0, yaw_within_2_sigma=1.0,
        square=1.25, wrong=Interval(value=0.123, low=0.101, high=0.145), without_one=(0.93, 1.0),
        wrong_without_one=(0.1, 0.12),
    )  # fmt: skip
    text = io.StringIO()
    monkeypatch.setattr(honesty_table, "evaluation_console", lambda: Console(file=text, width=width))
    honesty_table.print_honesty([row], [], durations=False)
    _title, _gap, head, _line, line = text.getvalue().splitlines()[:5]
    assert LONGEST in line
    assert "12.3 [10.1, 14.5] %" in line
    figures = re.split(r" {2,}", head.strip())[1:]
    assert set(figures) <= set(honesty_table.FIGURES)
    assert len(figures) >= least
