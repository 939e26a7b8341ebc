"""Foreign text on a terminal is plain text: no command, no markup, no log line of ours."""

import io
import json
import logging
import os
import re
import sys

import click
import pytest
from click.testing import CliRunner
from rich.table import Table
from rich.text import Text

from pointit.cli.common.output import OutputSection, print_table, say
from pointit.cli.view import ConsoleView
from pointit.launch.run.monitor import Monitor, RunScore
from pointit.runtime.clock import WallClock
from pointit.runtime.config.environment_variables import LOG_FORMAT
from pointit.runtime.service.logs import setup_logging
from pointit.runtime.service.plain_console import PlainConsole
from pointit.runtime.service.process import log_options
from pointit.schemas import Cursor
from pointit.schemas.printable import plain
from pointit.schemas.text import one_line

EVIL = "a\x1b]52;c;Y3VybA==\x1b\\b\x1b[2Jc\u202ed\x9be"
TAME = "a?]52;c;Y3VybA==?\\b?[2Jc?d?e"
STYLE = re.compile(r"\x1b\[[0-9;]*m")


@pytest.fixture
def console() -> PlainConsole:
    return PlainConsole(file=io.StringIO(), force_terminal=True, width=100)


def written(console: PlainConsole) -> str:
    assert isinstance(console.file, io.StringIO)
    return STYLE.sub("", console.file.getvalue())


def test_control_characters_are_question_marks_wherever_they_are(console: PlainConsole) -> None:
    table = Table("what" * 10)
    table.add_row(Text(EVIL, style="red"))
    console.print(Text(EVIL))
    console.print(table)
    print_table(console, OutputSection(name="s", about="x", rows=({"who": EVIL},)))
    text = written(console)
    assert text.count(TAME) == 3
    assert text.replace("\n", "").isprintable()


def test_plain_text_keeps_all_spaces_but_no_line_breaks(console: PlainConsole) -> None:
    text = "1\u00a0000\u202fm\tfar\u3000off"
    assert plain(text) == "1 000 m far off"
    assert plain("a\u2028b\u200bc\rd") == "a?b?c?d"
    console.print(Text("1\u00a0000\u202fm"))
    assert written(console) == "1 000 m\n"


def test_markup_of_others_is_text(console: PlainConsole) -> None:
    table = Table("what")
    table.add_row("[link=http://evil]here[/link] :skull: [/]")
    console.print(table)
    assert "[link=http://evil]here[/link] :skull: [/]" in written(console)


def test_view_shows_names_of_surfaces_as_they_are() -> None:
    console = PlainConsole(file=io.StringIO(), force_terminal=True, width=100)
    monitor = Monitor(RunScore(()), WallClock())
    monitor.cursors["anna"] = Cursor(stamp_ns=1, surface="strip", surface_id="[/x]\x1bc", position_m=1.0)
    console.print(ConsoleView(monitor, "PointIt", lambda: 0.0))
    assert "strip [/x]?c" in written(console)


def test_terminal_log_is_plain_and_coloured_by_us_alone(console: PlainConsole) -> None:
    setup_logging("warning", console)
    log = logging.getLogger("pointit.test")
    log.warning("%s says %s", "anna", EVIL)
    log.warning("[not markup] %d", 3)
    log.info("not wanted")
    text = written(console)
    assert f"anna says {TAME}" in text
    assert "WARNING  [not markup] 3" in text
    assert console.file.getvalue() != text  # pyrefly: ignore[missing-attribute]
    assert "not wanted" not in text
    with pytest.raises(json.JSONDecodeError):
        json.loads(text)


def test_log_without_a_terminal_is_plain_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.delenv(LOG_FORMAT)
    setup_logging("info")
    log = logging.getLogger("pointit.test")

    log.debug("not wanted")
    log.info("first\n2026-01-01T00:00:00.000 ERROR forged: line")
    log.error("it failed", exc_info=ValueError("broken"))

    first, second, third, *traceback = stream.getvalue().splitlines()
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3} INFO    pointit\.test: first", first)
    assert second == "    2026-01-01T00:00:00.000 ERROR forged: line"
    assert third.endswith(" ERROR   pointit.test: it failed")
    assert traceback[-1] == "ValueError: broken"


@pytest.mark.parametrize("arguments", [["--log-format", "json"], []])
def test_log_format_of_a_command_is_an_option(arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(LOG_FORMAT, "plain")
    command = click.Command("run", params=log_options()[1:], callback=lambda: None)
    assert CliRunner().invoke(command, arguments).exit_code == 0
    assert os.environ[LOG_FORMAT] == (arguments[1] if arguments else "plain")


def test_json_lines_without_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    setup_logging("info")
    log = logging.getLogger("pointit.test")
    log.debug("not wanted")
    log.info('ä "quoted"\nline of %s', "anna")
    log.error("it failed", exc_info=ValueError("broken"))
    first, second = [json.loads(line) for line in stream.getvalue().splitlines()]
    assert first["message"] == 'ä "quoted"\nline of anna'
    assert (first["level"], first["logger"]) == ("info", "pointit.test")
    assert first["time"].endswith("+00:00")
    assert "traceback" not in first
    assert second["traceback"].endswith("ValueError: broken")


def test_said_line_stays_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    say(f"done\nError: {EVIL}")
    assert capsys.readouterr().out == f"done Error: {TAME}\n"


def test_long_text_is_truncated_and_keeps_line_breaks_if_requested() -> None:
    assert one_line("a\r\n\tb") == "a b"
    assert len(one_line("x" * 10_000)) == 600
    assert plain("a\nb\x07c") == "a\nb?c"
