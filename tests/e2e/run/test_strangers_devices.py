"""A package that is not part of this project adds a wrist and a light, and `pointit run` uses both."""

import shutil
from pathlib import Path

import pytest

from tests.support.commands import Commands

PACKAGE = Path(__file__).with_name("strangers_package")
ENTRY_POINTS = """
[pointit.imu_sources]
waving = strangers_devices:WAVING
broken = strangers_devices:ABSENT

[pointit.led_outputs]
notebook = strangers_devices:NOTEBOOK
"""


@pytest.fixture
def installed(tmp_path: Path) -> dict[str, str]:
    """Return the environment in which the package is installed."""
    folder = tmp_path / "installed"
    shutil.copytree(PACKAGE, folder)
    info = folder / "strangers_devices-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: strangers-devices\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(ENTRY_POINTS)
    return {"PYTHONPATH": str(folder)}


@pytest.mark.timeout(120)
async def test_package_of_a_stranger_adds_a_wrist_and_a_light(
    commands: Commands, installed: dict[str, str], tmp_path: Path
) -> None:
    shown = tmp_path / "shown.txt"
    run = commands.start_program(
        *("run", "scenario_2", "--duration", "4", "--no-view"),
        *("--imu", "waving:40", "--leds", f"notebook:{shown}"),
        environment=installed,
    )
    ended = await run.end(60)
    assert ended.code == 0, ended.err
    strips, *frames, dark = shown.read_text().splitlines()
    assert (strips, dark) == ("2 strips", "dark")
    assert any(frame.startswith("255 ") for frame in frames), frames  # the cursor is white


async def test_plugins_of_strangers_are_listed_with_what_is_wrong(
    commands: Commands, installed: dict[str, str]
) -> None:
    wide = installed | {"COLUMNS": "200"}
    ended = await commands.start_program("list", "plugins", environment=wide).end()
    assert ended.code == 0, ended.err
    assert "--imu waving:RATE_HZ" in ended.out
    assert "IMU source 'broken' of strangers-devices cannot be imported" in ended.out
    arguments = ("run", "scenario_2", "--imu", "broken")
    refused = await commands.start_program(*arguments, environment=installed).end()
    assert refused.code == 2
    assert "--imu 'broken': IMU source 'broken' of strangers-devices" in refused.err
