"""Installations of exactly what requirements/ci.txt names."""

import os
from pathlib import Path

import pytest

from tests.scripts.machine import PYTHON, Machine
from tests.scripts.test_scripts import PIP

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the scripts are for POSIX shells")


def test_locked_installation_fetches_a_missing_uv_by_its_hash(tmp_path: Path) -> None:
    machine = Machine(tmp_path)
    machine.add("python3", PYTHON)
    (machine.root / "requirements").mkdir()
    uv = "uv==1.2 \\\n    --hash=sha256:12 \\\n    --hash=sha256:34\n"

    locked = machine.root / "requirements" / "ci.txt"
    locked.write_text(
        f"tqdm==1.0 \\\n    --hash=sha256:56\n{uv}zarr==1.0 \\\n    --hash=sha256:78\n", "utf-8"
    )
    assert machine.run("setup", "dev", LOCKED="1").returncode == 0
    assert (machine.root / ".venv" / "uv.txt").read_text("utf-8") == uv

    install = f"fetched uv pip install --quiet --python {machine.root}/.venv/bin/python"
    assert machine.calls == [
        f"python -m venv --without-pip {machine.root}/.venv",
        f"{PIP} --require-hashes -r {machine.root}/.venv/uv.txt",
        f"{install} --require-hashes -r {locked}",
        f"{install} --no-deps --no-build-isolation -e {machine.root} -e {machine.root}/lab",
    ]
