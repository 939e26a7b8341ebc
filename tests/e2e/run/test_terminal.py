"""`pointit run` in a terminal: it draws, is not torn by logs, and leaves the terminal as it was."""

import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.e2e.run.visitor import looking_on, own_scenario
from tests.support.bench import until
from tests.support.commands import onlooker, without_page
from tests.support.pace import within

ESCAPE = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
HIDE = "\x1b[?25l"
SHOW = "\x1b[?25h"
PATIENCE_S = 30.0
ADOPT = """
import fcntl, os, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.executable, [sys.executable, "-m", "pointit", *sys.argv[1:]])
"""
"""Makes the pseudo-terminal the one that Ctrl-C comes from."""


class Terminal:
    def __init__(self, columns: int, rows: int, *arguments: str, kind: str = "xterm-256color") -> None:
        self.raw = b""
        self.master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        self.before = termios.tcgetattr(slave)
        self._slave = slave  # kept open, to look at its settings afterwards
        environment = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES")}
        environment |= {"TERM": kind, "COLORTERM": "truecolor"}
        self.process = subprocess.Popen(
            [sys.executable, "-c", ADOPT, *without_page(arguments)], stdin=slave, stdout=slave,
            stderr=slave, start_new_session=True, env=environment,
        )  # fmt: skip

    def read(self) -> str:
        while select.select([self.master], [], [], 0)[0]:
            try:
                data = os.read(self.master, 65536)
            except OSError:  # all other ends are closed
                break
            if not data:
                break
            self.raw += data
        return self.raw.decode(errors="replace")

    @property
    def text(self) -> str:
        return ESCAPE.sub("", self.read())

    def press(self, key: bytes) -> None:
        os.write(self.master, key)

    def press_ctrl_c(self) -> None:
        self.press(b"\x03")

    async def shows(self, *what: str) -> None:
        await until(
            lambda: all(part in self.text for part in what), PATIENCE_S, f"{what} in {self.text[-3000:]}"
        )

    async def end(self) -> int:
        def has_ended() -> bool:
            self.read()  # a full terminal would make it wait
            return self.process.poll() is not None

        await until(has_ended, PATIENCE_S, f"the end; {self.text[-3000:]}")
        self.read()
        code: int = self.process.returncode
        return code

    def close(self) -> None:
        self.process.kill()
        self.process.wait(30)
        os.close(self.master)
        os.close(self._slave)

    @property
    def after(self) -> object:
        return termios.tcgetattr(self._slave)


@contextmanager
def terminal(columns: int, rows: int, *arguments: str, kind: str = "xterm-256color") -> Generator[Terminal]:
    shown = Terminal(columns, rows, *arguments, kind=kind)
    try:
        yield shown
    finally:
        shown.close()


def frames(text: str) -> list[list[str]]:
    drawn: list[list[str]] = []
    for piece in text.split("╭")[1:]:
        head, found, _ = piece.partition("╯")
        if found:
            drawn.append(("╭" + head + "╯").splitlines())
    return drawn


async def test_it_draws_and_leaves_the_terminal_as_it_was(endpoint: str) -> None:
    with terminal(40, 40, "run", "scenario_3", "--duration", "600", "--listen", endpoint) as shown:
        await shown.shows("PointIt scenario_3", "pointing", "▌", "▲", "wrist to light p50", "selected 1")
        assert HIDE in shown.read()
        await until(lambda: len(frames(shown.text)) > 5, PATIENCE_S, "more than five frames")

        drawn = frames(shown.text)
        for frame in drawn:
            assert {len(line) for line in frame} == {40}, frame

        last = [line[2:] for line in drawn[-1]]
        for strip in ("0 ", "1 "):
            assert any(line.startswith(strip) and "▌" in line for line in last)

        shown.press_ctrl_c()
        pressed_s = time.monotonic()
        assert await shown.end() == 0
        assert within(time.monotonic() - pressed_s, 4.0)
        assert "Traceback" not in shown.text
        assert shown.read().rstrip().rpartition(HIDE)[2].count(SHOW) == 1  # the cursor is back
        assert shown.after == shown.before
        assert "scenario_3 ran" in shown.text.rpartition("╯")[2]
        assert "of" in shown.text.rpartition("Selected ")[2]


@pytest.mark.long
async def test_page_address_stays_visible_and_an_open_page_extends_runs(
    endpoint: str, tmp_path: Path
) -> None:
    page = ("--web-port", "0", "--no-browser", "--listen", endpoint)
    with terminal(80, 30, "run", own_scenario(tmp_path, 10), *page) as shown:
        await shown.shows("PointIt mine", "page: http://127.0.0.1:")
        url = shown.text.rpartition("page: ")[2].split()[0]
        async with looking_on(url):
            await shown.shows("a page is open: goes on until Ctrl-C or it closes")
        assert await shown.end() == 0
        assert all({len(line) for line in frame} == {80} for frame in frames(shown.text))
        assert "mine ran" in shown.text.rpartition("╯")[2]


async def test_a_localization_and_a_refusal_are_seen_in_80_columns(endpoint: str) -> None:
    """Three lamps, then the person's position. A person who does not point sees the reason of the failure."""
    localize = ("run", "scenario_2", "--localize", "--targets", "3", "--speed", "4", "--listen", endpoint)
    with terminal(80, 40, *localize, "--seed", "2") as shown:
        await shown.shows("1 of 3", "3 of 3", "samples", "stands at", "lamps", "°/min", "user1: pointing.")
        for frame in frames(shown.text):
            assert {len(line) for line in frame} == {80}, frame
        shown.press_ctrl_c()
        assert await shown.end() == 0
        assert "user1 was found at" in shown.text.rpartition("╯")[2]
    idle = ("--set", "user-sim.points_when_asked=false", "--set", "user-sim.press_pause_s=600")
    with terminal(80, 40, *localize, *idle) as shown:
        await shown.shows("user1: refused: ")
        assert "\x1b[1;31mrefused: " in shown.read()  # red
        shown.press_ctrl_c()
        await shown.end()


async def test_space_is_the_persons_button(endpoint: str) -> None:
    with terminal(100, 40, "run", "scenario_2", "--listen", endpoint) as shown:
        await shown.shows("Space is user1's button", "user1: pointing.")
        shown.press(b"x")
        shown.press(b" ")
        await shown.shows("user1: idle. You stopped.")
        shown.press_ctrl_c()
        assert await shown.end() == 0
        assert shown.after == shown.before


@pytest.mark.long
async def test_logs_stand_above_it(endpoint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A child that is killed is reported while the view is drawn."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with terminal(
        120, 50, "run", "scenario_3", "--processes", "--duration", "600", "--listen", endpoint
    ) as shown:
        async with onlooker(endpoint) as seen:
            await seen.hears("selector")
            await shown.shows("pointing")
            os.kill(seen.health["selector"].pid, signal.SIGKILL)
        await shown.shows("selector was ended by SIGKILL", "start it again with:")

        count = len(frames(shown.text))
        await until(lambda: len(frames(shown.text)) > count + 3, PATIENCE_S, "the view to go on")
        for frame in frames(shown.text):
            assert {len(line) for line in frame} == {120}, frame

        await shown.shows("look at: selector")
        shown.press_ctrl_c()
        assert await shown.end() == 0
        assert "Traceback" not in shown.text
        assert shown.after == shown.before


@pytest.mark.parametrize("kind", ["dumb", ""], ids=["dumb", "unknown"])
async def test_without_a_view_it_logs_lines(endpoint: str, kind: str) -> None:
    arguments = ("run", "scenario_2", "--duration", "12", "--listen", endpoint)
    with terminal(100, 30, *arguments, kind=kind) as shown:
        assert await shown.end() == 0, shown.text
        assert "scenario_2 starts on site lab at" in shown.text
        assert "scenario_2 ran 12 s" in shown.text
        assert "╭" not in shown.text
        assert "\x1b" not in shown.read()
