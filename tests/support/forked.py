"""The command line in processes forked from one that has loaded its modules: each starts in milliseconds."""

import multiprocessing
import os
import pkgutil
import runpy
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import pointit.cli

_processes = multiprocessing.get_context("forkserver")
_modules = (each.name for each in pkgutil.walk_packages(pointit.cli.__path__, f"{pointit.cli.__name__}."))
_processes.set_forkserver_preload(
    ["tests.support.forked", *(name for name in _modules if not name.endswith(".__main__"))]
)


def run(arguments: Sequence[str], patience_s: float) -> tuple[int, str, str]:
    """Run `pointit …` to its end with this process's environment.

    Args:
        arguments: what follows `pointit`.
        patience_s: seconds after which it is killed.

    Returns:
        The exit code, what it printed, and what it printed as errors.
    """
    with tempfile.TemporaryDirectory() as folder:
        out, err = Path(folder, "out"), Path(folder, "err")
        process = _processes.Process(target=_command, args=(list(arguments), out, err, dict(os.environ)))
        process.start()
        process.join(patience_s)
        if process.exitcode is None:
            process.kill()
            process.join()
        code = process.exitcode
        process.close()
        assert code is not None
        return code, out.read_text(), err.read_text()


def _command(arguments: list[str], out: Path, err: Path, environment: Mapping[str, str]) -> None:
    os.environ.clear()
    os.environ.update(environment)
    for path, number in ((out, 1), (err, 2)):
        file = os.open(path, os.O_WRONLY | os.O_CREAT)
        os.dup2(file, number)
        os.close(file)
    sys.argv = ["pointit", *arguments]
    runpy.run_module("pointit.cli", run_name="__main__", alter_sys=True)
