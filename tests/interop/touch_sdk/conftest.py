"""The environment of the maker's client."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.environments import python_of


@pytest.fixture(scope="session")
def touch_sdk_python(say: Callable[[str], None]) -> Path:
    """Return the Python of .venv-touch-sdk; skips, saying why, where it cannot be made."""
    requirements = Path(__file__).parent / "requirements.txt"
    return python_of(".venv-touch-sdk", requirements, "the maker's client of the Touch SDK", say)
