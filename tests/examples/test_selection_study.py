"""The paper's selection study, a round of its six orders of methods: killed in the middle, and checked."""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

from tests.architecture.sources import ROOT
from tests.unit.study.studies import read_rows

STUDY = ROOT / "examples" / "selection_study.yaml"
PEOPLE = 6
TRIALS = 21
PATIENCE_S = 120.0


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "pointit", "study", *arguments]


@pytest.mark.slow
def test_selection_study_is_whole_after_kill_9_in_the_middle(tmp_path: Path) -> None:
    data = tmp_path / "data"
    study = tmp_path / STUDY.name
    study.write_text(STUDY.read_text().replace("participants: 12 ", f"participants: {PEOPLE} "))
    run = command("run", str(study), "--simulated", str(PEOPLE), "--to", str(data))
    with subprocess.Popen(run, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as killed:
        end_s = time.monotonic() + PATIENCE_S
        while sum(len(read_rows(file)) for file in data.glob("P02/trials.csv")) < TRIALS // 2:
            assert killed.poll() is None
            assert time.monotonic() < end_s
            time.sleep(0.02)
        os.kill(killed.pid, signal.SIGKILL)

    done = subprocess.run(run, check=True, capture_output=True, text=True)
    assert done.stdout.startswith(f"{PEOPLE - 1} simulated participants have done")
    checked = subprocess.run(command("check", str(data)), check=True, capture_output=True, text=True)
    assert "nothing is missing or wrong" in checked.stdout

    rows = [row for file in sorted(data.glob("*/trials.csv")) for row in read_rows(file)]
    assert len(rows) == PEOPLE * TRIALS  # none is there twice
    cells = Counter((row["method"], row["width"]) for row in rows if row["practice"] == "0")
    assert set(cells.values()) == {PEOPLE * 3}
    assert len(cells) == 6
    assert sum(row["outcome"] == "hit" for row in rows) > 0.9 * len(rows)
