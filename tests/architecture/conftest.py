"""Fixtures of tests of the scripts."""

from pathlib import Path

import pytest

from tests.architecture.machine import Machine


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)
