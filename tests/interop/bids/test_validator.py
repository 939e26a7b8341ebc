"""An exported dataset in the public validator of the Brain Imaging Data Structure."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from pointit.conversion.export_bids import export_bids
from tests.support.environments import python_of
from tests.unit.conversion.session import session


@pytest.fixture(scope="session")
def validator(say: Callable[[str], None]) -> Path:
    """Return the validator; skips, saying why, where it cannot be installed."""
    requirements = Path(__file__).parent / "requirements.txt"
    return python_of(".venv-bids", requirements, "the validator of BIDS", say).parent / "bids-validator-deno"


def errors_of(validator: Path, folder: Path) -> list[str]:
    done = subprocess.run(
        (validator, "--json", folder), capture_output=True, text=True, timeout=300, check=False
    )
    report = json.loads(done.stdout)
    assert report["summary"]["modalities"] == ["motion"], "it has read the dataset"
    issues = report["issues"]["issues"]
    return [f"{each['code']} {each['location']}" for each in issues if each["severity"] == "error"]


def test_the_public_validator_finds_errors_in_damaged_datasets_only(validator: Path, tmp_path: Path) -> None:
    export_bids(session("anna", "bob_2"), tmp_path, task="put that there")
    export_bids(session("anna"), tmp_path, task="put that there", session="2")
    assert errors_of(validator, tmp_path) == []
    channels = next(tmp_path.rglob("*imu_channels.tsv"))
    channels.write_text(channels.read_text(encoding="utf-8").replace("ORNT", "ANGLE"), encoding="utf-8")
    (tmp_path / "sub-anna" / "motion" / "notes.tsv").write_text("x\n", encoding="utf-8")
    assert len(errors_of(validator, tmp_path)) >= 2
