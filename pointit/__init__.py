"""Point at things and the things react.

`connect` joins a running site, `open` does so for scripts and notebooks, `run` starts a site in this process,
`run_virtually` does so in virtual time. What is imported is loaded at its first use.
"""

import importlib
import os
import sys
from typing import Any

if os.path.isfile(f"{__path__[0]}/services"):  # noqa: PTH113 - `pathlib` takes longer than all else here
    _REMEDY = (
        "the archive was unpacked without links; unpack it with a program that keeps them (`unzip`, `tar`), "
        "install a wheel, or clone the repository with git"
    )
    if os.path.exists(f"{__path__[0]}/../.git"):  # noqa: PTH110 - as above
        _REMEDY = (
            "git wrote this checkout without links; on Windows, switch on its developer mode; then run "
            "`git config core.symlinks true`, then `git checkout -- pointit`, or install a wheel"
        )
    _SENTENCE = (
        f"{__path__[0]}: services, schemas and bridges are text files here, not symbolic links: {_REMEDY}"
    )
    if sys.argv[0] == "-m" or os.path.basename(sys.argv[0]) in ("pointit", "pointit.exe"):  # noqa: PTH119
        print(f"Error: {_SENTENCE}", file=sys.stderr)  # noqa: T201 - unlike its `write`, also if it is closed
        sys.exit(2)
    raise ImportError(_SENTENCE)

_HOMES = {
    "PointItError": "pointit.errors",
    "Site": "pointit.api.site",
    "SyncSite": "pointit.api.sync_site",
    "connect": "pointit.api.connection",
    "open": "pointit.api.connection",
    "run": "pointit.api.run",
    "run_virtually": "pointit.runtime.virtual_time",
}
"""Modules of the public names; types of all of them are in `__init__.pyi`."""


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    if name == "errors":
        return importlib.import_module("pointit.errors")
    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("pointit")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES, "errors", "__version__"})
