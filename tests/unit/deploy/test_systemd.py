"""The units for hosts without containers start what `pointit` takes, and confine it."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from pointit.launch.plan.plan import read_scenario
from tests.unit.deploy.stack import DEPLOY, parse

UNITS = DEPLOY / "systemd"
SERVICES = sorted(UNITS.glob("*.service"))
PROGRAM = "/opt/pointit/bin/pointit"
MOST_EXPOSURE = 2.0
"""Maximum exposure level by `systemd-analyze security`: 0 is confined, 10 is open."""


def instance_of(path: Path) -> str:
    """Return the name of a unit, or of an instance of a template."""
    return path.name.replace("@.", "@pui." if "service@" in path.name else "@anna.")


def settings(path: Path) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    instance = instance_of(path).partition("@")[2].partition(".")[0]
    for line in path.read_text(encoding="utf-8").splitlines():
        if match := re.fullmatch(r"(\w+)=(.*)", line):
            found.setdefault(match[1], []).append(match[2].replace("%i", instance))
    return found


@pytest.mark.parametrize("path", SERVICES, ids=lambda path: path.name)
def test_a_command_is_one_that_pointit_takes(path: Path) -> None:
    (command,) = settings(path)["ExecStart"]
    for assignment in settings(path).get("Environment", ()):
        name, _, value = assignment.strip('"').partition("=")
        command = command.replace(f"${name}", value)
    program, *words = command.split()
    assert program == PROGRAM
    assert "$" not in command
    parse(words)


def test_target_starts_the_router_the_page_and_every_shared_service() -> None:
    wanted = {name for line in settings(UNITS / "pointit.target")["Wants"] for name in line.split()}
    shared = {f"pointit-service@{name}.service" for name in read_scenario("scenario_4").site}
    assert wanted == {"pointit-router.service", "pointit-web.service", *shared}
    for name in read_scenario("scenario_4").site:
        assert (DEPLOY / "config" / f"{name}.yaml").exists(), name


def test_only_the_router_has_a_user_that_stays() -> None:
    for path in SERVICES:
        is_router = path.stem == "pointit-router"
        assert settings(path).get("DynamicUser", []) == ([] if is_router else ["yes"]), path.name
        identities = [each for each in settings(path).get("Environment", ()) if each.startswith("IDENTITY=")]
        assert bool(identities) is not is_router, path.name


@pytest.fixture
def units(tmp_path: Path) -> Path:
    """Return the units with a program that exists here; skip without systemd's checks."""
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not installed")
    folder = tmp_path / "units"
    shutil.copytree(UNITS, folder, symlinks=True)
    for path in folder.glob("*.service"):
        path.write_text(path.read_text(encoding="utf-8").replace(PROGRAM, "/bin/true"), encoding="utf-8")
    return folder


def analyze(units: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["systemd-analyze", *arguments],  # noqa: S607 - as it is installed
        env={"PATH": "/usr/bin:/bin", "SYSTEMD_UNIT_PATH": f"{units}:"},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


def test_systemd_finds_no_fault(units: Path) -> None:
    names = [str(units / instance_of(path)) for path in [*SERVICES, UNITS / "pointit.target"]]
    checked = analyze(units, "verify", "--man=no", *names)
    about_ours = [line for line in checked.stderr.splitlines() if "pointit" in line]
    assert (checked.returncode, about_ours) == (0, [])


@pytest.mark.parametrize("path", SERVICES, ids=lambda path: path.name)
def test_systemd_calls_each_service_confined(units: Path, path: Path) -> None:
    limit = str(round(10 * MOST_EXPOSURE))
    checked = analyze(
        units,
        "security",
        "--offline=yes",
        f"--threshold={limit}",
        "--no-pager",
        str(units / instance_of(path)),
    )
    assert checked.returncode == 0, checked.stdout[-300:] + checked.stderr
