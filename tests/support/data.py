"""The folder of recordings. Tests that need them are skipped with a reason if they are missing."""

import os
from pathlib import Path

import pytest

_ROOT = Path(os.environ.get("POINTIT_DATA", Path(__file__).parents[2].parent / "shared" / "data"))


def data_file(relative: str) -> Path:
    """Return the path of a file of the data folder, or skip the test."""
    path = _ROOT / relative
    if not path.exists():
        pytest.skip(f"{path} is absent; set POINTIT_DATA to the folder with the recordings")
    return path
