"""A package outside this project adds a wrist, a light, a method and a service: `pointit run` uses all."""

import json
import shutil
from pathlib import Path

import pytest

from tests.support.commands import Commands

PACKAGE = Path(__file__).with_name("strangers_package")
SUMMARY = "Devices of a workshop"
ENTRY_POINTS = """
[pointit.imu_sources]
waving = strangers_devices:WAVING
broken = strangers_devices:ABSENT

[pointit.led_outputs]
notebook = strangers_devices:NOTEBOOK

[pointit.selection_methods]
eager = strangers_devices:EAGER

[pointit.services]
witness = strangers_devices:WITNESS
"""


@pytest.fixture
def installed(tmp_path: Path) -> dict[str, str]:
    """Return the environment in which the package is installed."""
    folder = tmp_path / "installed"
    shutil.copytree(PACKAGE, folder)
    info = folder / "strangers_devices-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: strangers-devices\nVersion: 1.0\nSummary: {SUMMARY}\n"
    )
    (info / "entry_points.txt").write_text(ENTRY_POINTS)
    return {"PYTHONPATH": str(folder)}


async def test_a_package_adds_any_kind(commands: Commands, installed: dict[str, str], tmp_path: Path) -> None:
    shown = tmp_path / "shown.txt"
    seen = tmp_path / "seen.txt"
    state = tmp_path / "state"
    run = commands.start_program(
        *("run", "scenario_3", "--duration", "10", "--no-view"),
        *("--imu", "waving:40", "--output", f"notebook:{shown}", "--method", "eager", "--with", "witness"),
        *("--set", f"witness.path={seen}", "--set", "selector.eager.dwell_s=0.2"),
        environment=installed | {"POINTIT_STATE": str(state)},
    )
    await run.end(code=0)

    strips, *frames = shown.read_text().splitlines()
    assert strips == "2 strips"
    assert frames.count("dark") == 1  # a frame may still be shown while the service ends
    assert any(frame.startswith("255 ") for frame in frames), frames  # the cursor is white
    assert seen.read_text().startswith("user1 ")

    stored = state / "users/user1/plugins/selection_methods/eager/state.json"
    assert json.loads(stored.read_text()) == {"dwell_s": 0.2}


async def test_third_party_plugins_are_listed_and_faulty_ones_refused(
    commands: Commands, installed: dict[str, str]
) -> None:
    ended = await commands.start_program("plugin", "list", "--json", environment=installed).end(code=0)
    about = {row["use"]: row["about"] for row in json.loads(ended.out)["plugins"]}
    devices = {"--imu waving:RATE_HZ", "--output notebook:PATH", "--imu broken"}
    assert {*devices, "--with witness"} <= about.keys()
    assert about["--imu waving:RATE_HZ"] == SUMMARY
    arguments = ("run", "scenario_2", "--imu", "broken")
    refused = await commands.start_program(*arguments, environment=installed).end(code=2)
    assert "--imu 'broken': IMU source 'broken' of strangers-devices" in refused.err
