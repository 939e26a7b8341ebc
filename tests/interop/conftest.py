"""The environments of others' programs, each made once."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.support.environments import python_of

HERE = Path(__file__).parent


@pytest.fixture(scope="session")
def say(pytestconfig: pytest.Config) -> Callable[[str], None]:
    """Return a function that prints a sentence immediately, despite the output capture of pytest."""
    capture: Any = pytestconfig.pluginmanager.getplugin("capturemanager")

    def say(sentence: str) -> None:
        with capture.global_and_fixture_disabled():
            print(f"\n{sentence} ...", flush=True)  # noqa: T201 - minutes may pass

    return say


@pytest.fixture(scope="session")
def peers_python(say: Callable[[str], None]) -> Path:
    """Return the Python of .venv-peers; skips, saying why, where it cannot be made."""
    return python_of(".venv-peers", HERE / "requirements.txt", "independent ROS 2 peers", say)


@pytest.fixture(scope="session")
def rclpy_python(say: Callable[[str], None]) -> Path:
    """Return the Python of .venv-rclpy; skips, saying why, where it cannot be made."""
    return python_of(".venv-rclpy", HERE / "ros2_dds" / "requirements.txt", "a genuine ROS 2", say)
