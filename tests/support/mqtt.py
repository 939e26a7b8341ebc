"""A genuine MQTT broker for one test."""

import shutil
import subprocess
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.support.buses import free_port

MOSQUITTO = shutil.which("mosquitto")


@contextmanager
def broker(folder: Path, port: int = 0, options: str = "") -> Generator[int]:
    """Run a broker on this machine for the body, and yield its port, on which it may not listen yet.

    Without `options`, lines of its configuration, it is open to this machine. Its log is in `folder`.
    """
    if MOSQUITTO is None:
        pytest.skip("mosquitto is not installed")
    port = port or free_port()
    words = [MOSQUITTO, "-p", str(port)]
    if options:
        (folder / "mosquitto.conf").write_text(f"listener {port} 127.0.0.1\n{options}", encoding="utf-8")
        words = [MOSQUITTO, "-c", str(folder / "mosquitto.conf")]
    with (folder / "broker.log").open("ab") as log:
        process = subprocess.Popen(words, stdout=log, stderr=log)
        try:
            yield port
        finally:
            process.terminate()
            process.wait(30)
