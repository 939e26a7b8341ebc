"""The environment with a genuine rclpy, made once."""

from pathlib import Path
from typing import Any

import pytest

from tests.interop.ros2_dds.driven import python_of_rclpy


@pytest.fixture(scope="session")
def rclpy_python(pytestconfig: pytest.Config) -> Path:
    """Return the Python of .venv-rclpy; skips, saying why, where it cannot be made."""
    capture: Any = pytestconfig.pluginmanager.getplugin("capturemanager")

    def say(sentence: str) -> None:
        with capture.global_and_fixture_disabled():
            print(f"\n{sentence} ...", flush=True)  # noqa: T201 - a minute may pass

    return python_of_rclpy(say)
