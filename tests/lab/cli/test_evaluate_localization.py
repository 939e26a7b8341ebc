"""`pointit evaluate`: what people read, what programs read, what is refused, how it ends."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from pointit.cli.main import command
from pointit.runtime.errors import ConfigError
from pointit_lab.evaluation.pointing import drift
from tests.support.invoked import printed
from tests.support.pace import slowness
from tests.support.published_recordings import Stand, write_acts, write_motion, write_track

COMMAND = ("-m", "pointit", "evaluate", "localization", "--jobs", "2")


def invoke(*arguments: str) -> tuple[str, str]:
    return printed(command, "evaluate", *arguments)


@pytest.fixture
def data(tmp_path: Path) -> Path:
    write_track(tmp_path / "recordings", Stand(), duration_s=3.0)
    return tmp_path


def test_a_table_for_people_and_json_for_programs(data: Path) -> None:
    file = data / "rows.json"
    out, err = invoke("localization", "--data", str(data), "--only-ours", "--jobs", "1", "--json", str(file))
    assert "proximity_waypoints" in out
    lines = [line.split()[:5] for line in out.splitlines() if "pointit" in line]
    assert lines == [
        [f"{length}", "s", subject, "pointit", f"{4 - length}"]
        for length in (1, 2, 3)
        for subject in ("all", "user9")
    ]
    assert "motion_relloc is skipped" in err
    rows = json.loads(file.read_text())["rows"]
    assert [(row["condition"], row["subject"], row["n"]) for row in rows] == [
        (f"{length} s", subject, 4 - length) for length in (1, 2, 3) for subject in ("all", "user9")
    ]


def test_sets_and_subjects_may_be_chosen(tmp_path: Path) -> None:
    write_motion(tmp_path, Stand(), duration_s=3.0)
    path = write_track(tmp_path, Stand(), duration_s=3.0).parent / "index.json"
    index = json.loads(path.read_text())
    (path.parent / "track_1.csv").write_bytes((path.parent / "track_9.csv").read_bytes())
    index["files"].append({**index["files"][1], "file": "track_1.csv", "subject": "2"})
    path.write_text(json.dumps(index))
    out, _ = invoke(
        *("localization", "--data", str(tmp_path), "--set", "proximity_waypoints", "--subject", "2"),
        *("--only-ours", "--jobs", "1", "--json", "-"),
    )
    found = {(row["set"], row["subject"]) for row in json.loads(out)["rows"]}
    assert found == {("proximity_waypoints", "all"), ("proximity_waypoints", "2")}


def test_mistakes_are_told_before_the_work(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("POINTIT_DATA", raising=False)
    with pytest.raises(ConfigError, match="--data DIR or set POINTIT_DATA"):
        invoke("localization")
    with pytest.raises(ConfigError, match="no such set; there are motion_relloc"):
        invoke("localization", "--data", str(data), "--set", "motion")
    with pytest.raises(ConfigError, match="is a folder"):
        invoke("localization", "--data", str(data), "--json", str(data))
    with pytest.raises(ConfigError, match="cannot be written"):
        invoke("localization", "--data", str(data), "--json", str(data / "nowhere" / "rows.json"))
    with pytest.raises(ConfigError, match="no subject 'anna'"):
        invoke("localization", "--data", str(data), "--subject", "anna")


def test_pointing_evaluation_refuses_missing_data_and_compares_solvers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(drift, "PEOPLE", 5)
    with pytest.raises(ConfigError, match="has no folder proximity_feedback"):
        invoke("pointing", "--data", str(tmp_path))
    with pytest.raises(ConfigError, match="no such set; there are proximity_feedback"):
        invoke("pointing", "--data", str(tmp_path), "--set", "motion_relloc")
    file = tmp_path / "rows.json"
    out, _ = invoke("pointing", "--data", str(tmp_path), "--set", "simulated_drift", "--json", str(file))
    assert out.startswith("simulated_drift")
    rows = json.loads(file.read_text())["rows"]
    assert {row["set"] for row in rows} == {"simulated_drift"}
    assert {"raw", "pointit"} <= {row["solver"] for row in rows}


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="signals of a terminal")
@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)])
def test_it_ends_at_once_with_all_its_processes(number: int, tmp_path: Path) -> None:
    write_acts(tmp_path, {str(i): (1.7, Stand(noise_deg=4.0)) for i in range(6)})
    running = subprocess.Popen(
        [sys.executable, *COMMAND, "--data", str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        workers = await_workers(running.pid)
        os.killpg(running.pid, number)
        began = time.monotonic()
        _, err = running.communicate(timeout=90.0)
        assert time.monotonic() - began < 5.0 * slowness()
        assert running.returncode == 130
        assert "Traceback" not in err
        gone, alive = psutil.wait_procs(workers, timeout=30.0)
        assert len(gone) >= 2
        assert not alive
    finally:
        if running.poll() is None:
            os.killpg(running.pid, signal.SIGKILL)
            running.communicate()


def await_workers(pid: int) -> list[psutil.Process]:
    """Return the processes that work for `pid`, once two of them have used a second of a core each."""
    until = time.monotonic() + 60.0 * slowness()
    while time.monotonic() < until:
        workers = [child for child in psutil.Process(pid).children() if sum(child.cpu_times()[:2]) > 1.0]
        if len(workers) >= 2:
            return workers
        time.sleep(0.05)
    raise AssertionError("no processes were started")
