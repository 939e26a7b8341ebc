"""Logs: JSON lines in files and pipes, rich lines on a terminal."""

import io
import json
import logging
import re
import sys
from collections.abc import Iterator

import pytest
from rich.console import Console

from pointit.runtime.service.logs import setup_logging


@pytest.fixture(autouse=True)
def root() -> Iterator[None]:
    """Put the root logger back as it was."""
    logger = logging.getLogger()
    handlers, level = list(logger.handlers), logger.level
    yield
    logger.handlers[:] = handlers
    logger.setLevel(level)


def test_json_lines_without_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    setup_logging("info")
    log = logging.getLogger("pointit.test")
    log.debug("not wanted")
    log.info('ä "quoted"\nline of %s', "anna")
    log.error("it failed", exc_info=ValueError("broken"))
    lines = stream.getvalue().splitlines()
    first, second = [json.loads(line) for line in lines]
    assert first["message"] == 'ä "quoted"\nline of anna'
    assert (first["level"], first["logger"]) == ("info", "pointit.test")
    assert first["time"].endswith("+00:00")
    assert "traceback" not in first
    assert second["traceback"].endswith("ValueError: broken")


def test_rich_lines_on_a_console() -> None:
    stream = io.StringIO()
    setup_logging("warning", Console(file=stream, force_terminal=True, width=80))
    logging.getLogger("pointit.test").warning("[not markup] %d", 3)
    logging.getLogger("pointit.test").info("not wanted")
    colored = stream.getvalue()
    text = re.sub(r"\x1b\[[0-9;]*m", "", colored)
    assert "WARNING  [not markup] 3" in text
    assert colored != text
    assert "not wanted" not in text
    with pytest.raises(json.JSONDecodeError):
        json.loads(text)
