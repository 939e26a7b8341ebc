"""The command that installs an extra, optional dependencies, of PointIt."""

import functools
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

CHECKOUT = Path(__file__).parents[4]
"""Root of the checkout, if PointIt is installed from one."""


def remedy(extra: str) -> str:
    """Return the command that installs `extra`, or the package `lab`, in backticks: a script, else pip's."""
    if (CHECKOUT / "scripts" / "setup").is_file():
        return f"`scripts/setup {extra}` in the folder of PointIt"
    if extra == "lab":
        wheel = f"pointit_lab-{pointit_version()}-py3-none-any.whl"
        return f"`pip install {wheel}`; `scripts/wheel` makes this file in a checkout of PointIt"
    return f"`pip install 'pointit[{extra}]'`"


@functools.cache
def pointit_version() -> str:
    """Return the version of PointIt, or `""` if its sources run without being installed."""
    try:
        return version("pointit")
    except PackageNotFoundError:
        return ""
