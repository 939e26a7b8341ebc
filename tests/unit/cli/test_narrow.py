"""Tables on narrow terminals leave columns out rather than break words."""

import fcntl
import io
import os
import pty
import struct
import subprocess
import sys
import termios

import pytest
from rich.console import Console

from pointit.cli.common.output import ROOMY_WIDTH, Section, print_table

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
