"""An evaluation's tables: nothing is cut at any width, notes are about what is shown."""

import io
from collections.abc import Sequence
from dataclasses import replace

import pytest
from rich.console import Console

from pointit.cli.common.output import LineProgress, progress
from pointit_lab.cli.table import print_rows
from pointit_lab.evaluation.recordings.row import ALL, MetricSpread, Row

ERROR = MetricSpread(median=0.254, p90=0.512, rms=0.333)
TIME = MetricSpread(median=12.25, p90=20.5, rms=15.0)
SOLVERS = ("pointit", "mean-angle-4dof", "mean-angle-z0")


def located(condition: str, solver: str, subject: str = ALL) -> Row:
    return Row(
        set="proximity_waypoints", subject=subject, condition=condition, solver=solver, n=1234,
        position_m=ERROR, every_m=ERROR, yaw_deg=ERROR, share_above_1m=0.03, misled=0.0, within_2_sigma=1.0,
        yaw_within_2_sigma=0.9, refused=12, unsure=4, solve_ms=TIME, bound_m=0.211, taken_above_1m=0.02,
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


@pytest.mark.parametrize("width", [36, 80, 130])
@pytest.mark.parametrize("rows", [BRIEF, FULL, DRIFT])
def test_nothing_is_cut_at_any_width(rows: Sequence[Row], width: int) -> None:
    text = printed(rows, width, ["A remark that is long enough to be wrapped in any terminal there is."])
    assert "…" not in text
    assert max(len(line.rstrip()) for line in text.splitlines()) <= width


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
    with progress() as shown:
        shown("reading")
    assert capsys.readouterr().err == ""
