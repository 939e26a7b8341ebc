"""The command that installs an extra, optional dependencies, of PointIt."""

from pathlib import Path

CHECKOUT = Path(__file__).parents[4]
"""Root of the checkout, if PointIt is installed from one."""


def remedy(extra: str) -> str:
    """Return the command that installs `extra`, in backticks: in a checkout its script, else pip's."""
    if (CHECKOUT / "scripts" / "setup").is_file():
        return f"`scripts/setup {extra}` in the folder of PointIt"
    return f"`pip install 'pointit[{extra}]'`"
