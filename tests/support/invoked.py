"""Commands run in this process, and Python in a process of its own."""

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
from click.testing import CliRunner


def printed(command: click.Command, *arguments: str, env: Mapping[str, str] | None = None) -> tuple[str, str]:
    """Return the standard output and standard error of `command`, or raise its exception."""
    result = CliRunner().invoke(command, arguments, standalone_mode=False, env=env)
    if result.exception is not None:
        raise result.exception
    return result.stdout, result.stderr


def python(*arguments: str | Path, check: bool = False, **more: Any) -> subprocess.CompletedProcess[str]:
    """Run Python with `arguments`; `check`: it must not fail."""
    command = [sys.executable, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=check, timeout=150, **more)
