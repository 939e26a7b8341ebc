"""A genuine MQTT broker (mosquitto) for a test."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.mqtt import broker


@pytest.fixture
def port(tmp_path: Path) -> Iterator[int]:
    with broker(tmp_path) as port:
        yield port
