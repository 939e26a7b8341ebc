"""Where the recordings are; tests that need them skip, saying so, where they are absent."""

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
