"""The core works where every optional room is deleted, and says in one sentence what is not there.

The rooms are those of the contract `core` in pyproject.toml. Scenarios have simulated people and a
simulated conveyor, so they run in a copy that keeps the simulation. Without it, the core runs with a device.
"""

import os
import shutil
import subprocess
import sysconfig
import tomllib
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.architecture.sources import ROOT
from tests.support.invoked import python

pytestmark = pytest.mark.slow

SIMULATION = ("pointit.services.conveyor_sim", "pointit.services.user_sim", "pointit.sim")
"""Optional rooms that scenarios 1 to 4 name."""

SCENARIOS = ("scenario_1", "scenario_4")

DURATION_S = 20
"""Time in which a run has its first cursor also on a busy machine; without one it fails."""

FROM_PYTHON = """
import pointit

with pointit.run("scenario_3", virtual=True) as site:
    print(site.latest.cursor["user1"].stamp_ns > 0)
    print(site.conveyor.set_speed(0.3))
"""


@dataclass(frozen=True)
class Build:
    """A copy of PointIt in one folder, as a wheel has it, without some of its rooms."""

    folder: Path

    def python(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run Python with this copy only: `-S` leaves out the .pth file of the checkout's installation."""
        paths = (str(self.folder), sysconfig.get_path("purelib"), sysconfig.get_path("platlib"))
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # each start would compile the whole copy
        environment["POINTIT_STATE"] = str(self.folder / "state")
        return python("-S", *arguments, cwd=self.folder, env=environment)

    def pointit(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        return self.python("-m", "pointit", *arguments)

    def refusal(self, *arguments: str) -> str:
        """Return the one sentence with which a command is refused."""
        done = self.pointit(*arguments)
        assert done.returncode != 0, done.stdout
        assert "Traceback" not in done.stderr
        return done.stderr.strip().removeprefix("Error: ")

    def run(self, *arguments: str) -> str:
        """Return the first sentence of the summary of a run."""
        about = ("--duration", str(DURATION_S), "--no-view", "--listen", "tcp/127.0.0.1:0")
        done = self.pointit("run", *arguments, *about)
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()[0]


def optional_rooms() -> list[str]:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    (core,) = (contract for contract in contracts if contract["name"] == "core")
    rooms: list[str] = core["forbidden_modules"]
    return rooms


def build_without(rooms: Sequence[str], folder: Path) -> Build:
    unused = shutil.ignore_patterns("__pycache__", "client", "static")
    shutil.copytree(ROOT / "pointit", folder / "pointit", ignore=unused)
    for room in rooms:
        path = folder.joinpath(*room.split("."))
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.with_suffix(".py").unlink()
    return Build(folder)


@pytest.fixture(scope="module")
def simulating(tmp_path_factory: pytest.TempPathFactory) -> Build:
    """The core and the simulation."""
    rooms = [room for room in optional_rooms() if room not in SIMULATION]
    return build_without(rooms, tmp_path_factory.mktemp("simulating"))


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Build:
    return build_without(optional_rooms(), tmp_path_factory.mktemp("bare"))


def test_scenarios_run_to_their_end(simulating: Build, bare: Build) -> None:
    with ThreadPoolExecutor(2) as pool:
        with_device = pool.submit(bare.run, "scenario_2", "--imu", "simulated")
        for name, line in zip(SCENARIOS, pool.map(simulating.run, SCENARIOS), strict=True):
            assert line.startswith(f"{name} ran {DURATION_S} s with ")
    assert with_device.result().startswith(f"scenario_2 ran {DURATION_S} s with 7 services")


def test_a_program_runs_a_site(simulating: Build) -> None:
    done = simulating.python("-c", FROM_PYTHON)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("True\n")


def test_help_shows_the_whole_table_of_commands(bare: Build) -> None:
    done = bare.pointit("--help")
    assert done.returncode == 0, done.stderr
    assert "doctor" in done.stdout
    assert "--imu" in bare.pointit("run", "--help").stdout


@pytest.mark.parametrize(
    ("arguments", "what", "room"),
    [
        (("doctor",), "this command", "pointit.cli.inspect"),
        (("run", "scenario_5"), "robot", "pointit.services.robot"),
        (("run", "scenario_1"), "user-sim", "pointit.services.user_sim"),
        (("run", "scenario_2", "--imu", "simulated", "--ros2"), "ros2", "pointit.bridges"),
        (("service", "run", "web", "--help"), "web", "pointit.bridges"),
    ],
)
def test_absent_part_is_reported_in_one_sentence(
    bare: Build, arguments: Sequence[str], what: str, room: str
) -> None:
    assert bare.refusal(*arguments) == f"{what} is not part of this build of PointIt: there is no {room}"


def test_device_without_its_room_is_an_error_of_one_sentence(bare: Build) -> None:
    sentence = bare.refusal("run", "scenario_2", "--imu", "serial:/dev/ttyUSB0")
    assert sentence.startswith("--imu 'serial:/dev/ttyUSB0': ")
    assert "pointit.services.imu_bridge.serial" in sentence
    assert "\n" not in sentence
