"""The environment of the peers, made once."""

from pathlib import Path
from typing import Any

import pytest

from tests.interop.ros2.peers import python_of_peers


@pytest.fixture(scope="session")
def peers_python(pytestconfig: pytest.Config) -> Path:
    """Return the Python of .venv-peers; skips, saying why, where it cannot be made."""
    capture: Any = pytestconfig.pluginmanager.getplugin("capturemanager")

    def say(sentence: str) -> None:
        with capture.global_and_fixture_disabled():
            print(f"\n{sentence} ...", flush=True)  # noqa: T201 - minutes may pass

    return python_of_peers(say)
