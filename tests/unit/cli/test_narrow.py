"""Tables on narrow terminals leave columns out rather than break words."""

import fcntl
import io
import os
import pty
import re
import struct
import subprocess
import sys
import termios

import pytest
from rich.console import Console

from pointit.cli.common.output import ROOMY_WIDTH, Section, print_table
from pointit.cli.evaluate import honesty_table
from pointit.evaluation.honesty.row import EVERY, HonestyRow
from pointit.evaluation.recordings.row import Spread
from pointit.evaluation.selection.difference import Interval

SECTION = Section(
    name="things", about="of a test", rows=({"name": "a", "detail": "b"},), roomy=frozenset({"detail"})
)


@pytest.mark.parametrize(("width", "shown"), [(ROOMY_WIDTH - 1, False), (ROOMY_WIDTH, True)])
def test_a_narrow_terminal_does_without_the_roomy_columns(*, width: int, shown: bool) -> None:
    text = io.StringIO()
    print_table(Console(file=text, width=width), SECTION)
    assert "name" in text.getvalue()
    assert ("detail" in text.getvalue()) is shown


def test_a_list_before_a_pager_is_as_wide_as_the_terminal() -> None:
    leader, terminal = pty.openpty()
    try:
        fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        command = [sys.executable, "-m", "pointit.cli", "list"]
        out = subprocess.run(command, stdout=subprocess.PIPE, stderr=terminal, check=True).stdout.decode()
    finally:
        os.close(leader)
        os.close(terminal)
    assert "scenario_4" in out
    assert max(map(len, out.splitlines())) <= 80


LONGEST = "shoulder right, body still"
"""The longest condition that `pointit evaluate honesty` has."""


@pytest.mark.parametrize(("width", "least"), [(80, 5), (100, 7), (140, 10)])
def test_a_condition_and_its_figures_are_never_cut(
    width: int, least: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    row = HonestyRow(
        set="simulated",
        condition=LONGEST,
        duration=EVERY,
        n=1234,
        taken=1.0,
        error_m=Spread(median=0.25, p90=0.51, rms=0.33),
        within_2_sigma=1.0,
        yaw_within_2_sigma=1.0,
        square=1.25,
        wrong=Interval(value=0.123, low=0.101, high=0.145),
        without_one=(0.93, 1.0),
        wrong_without_one=(0.1, 0.12),
    )
    text = io.StringIO()
    monkeypatch.setattr(honesty_table, "evaluation_console", lambda: Console(file=text, width=width))
    honesty_table.print_honesty([row], [], durations=False)
    _title, _gap, head, _line, line = text.getvalue().splitlines()[:5]
    assert LONGEST in line
    assert "12.3 [10.1, 14.5] %" in line
    figures = re.split(r" {2,}", head.strip())[1:]
    assert set(figures) <= set(honesty_table.FIGURES)
    assert len(figures) >= least
