"""The compose files start what the registry knows, as it takes it, and confine every container."""

import os
import re
import subprocess
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

from pointit.bridges.web.server.access import CONTAINER
from pointit.launch.plan.plan import read_scenario
from pointit.runtime.host.advised_commands import CONTAINERS, USUAL_SITE
from pointit.runtime.service.process import load_config
from pointit.services.registry import PROCESSES, process
from tests.unit.deploy.stack import DEPLOY, compose, parse

BASE = compose("compose.yaml")
PERSON = compose("compose.user.yaml", USER_NAME="anna")
HARDWARE = compose("compose.hardware.yaml", IMU_DEVICE="/dev/ttyUSB0")
LEDS = compose("compose.leds.yaml", LED_DEVICE="/dev/ttyACM0")
ZENOHD = compose("compose.zenohd.yaml")
WHOLE = [(name, row) for stack in (BASE, PERSON) for name, row in stack["services"].items()]
COMMANDS = [
    row["command"]
    for stack in (BASE, PERSON, HARDWARE, LEDS)
    for row in stack["services"].values()
    if "command" in row
]


def mounted(row: dict[str, Any]) -> dict[str, str]:
    return {volume.split(":")[0]: volume.split(":", 1)[1] for volume in row.get("volumes", [])}


def test_every_file_is_known_to_these_tests() -> None:
    assert {path.name for path in DEPLOY.glob("*.yaml")} == {
        "compose.yaml",
        "compose.user.yaml",
        "compose.hardware.yaml",
        "compose.leds.yaml",
        "compose.zenohd.yaml",
    }
    named = " ".join(COMMANDS)
    for path in (DEPLOY / "config").glob("*.yaml"):
        assert f"--config /config/{path.name}" in named, path


def test_every_shared_service_of_the_scenario_runs() -> None:
    commands = [row.get("command", "") for _, row in WHOLE]
    started = {each.split()[2] for each in commands if each.startswith("service run ")}
    assert started == {*read_scenario("scenario_4").site, "web"}
    assert all(process(name).scope == "site" for name in started)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_is_one_that_pointit_takes(command: str) -> None:
    parse(command.split())


@pytest.mark.parametrize("file", sorted((DEPLOY / "config").glob("*.yaml")), ids=lambda path: path.name)
def test_a_configuration_is_one_that_its_service_takes(file: Path) -> None:
    (command,) = {command for command in COMMANDS if command.endswith(f"/{file.name}")}
    service = process(command.split()[2]).load()
    service.validate_config(load_config(service, [file], {}))


def test_configurations_are_those_of_the_scenario() -> None:
    site = read_scenario("scenario_4").site
    for name, parameters in site.items():
        service = process(name).load()
        here = load_config(service, [DEPLOY / "config" / f"{name}.yaml"], {})
        assert here == service.CONFIG.model_validate(parameters), name


@pytest.mark.parametrize(("name", "row"), WHOLE, ids=[name for name, _ in WHOLE])
def test_every_container_is_confined(name: str, row: dict[str, Any]) -> None:
    assert row["read_only"] is True
    assert row["cap_drop"] == ["ALL"]
    assert row["security_opt"] == ["no-new-privileges"]
    assert row["init"] is True
    assert row["stop_grace_period"] == "5s"
    assert row["mem_limit"]
    assert row["pids_limit"]
    assert row["logging"]["options"]["max-size"]
    assert row["tmpfs"][0].startswith("/tmp:")  # noqa: S108 - the container's own
    assert row["restart"] == ("no" if name == "init" else "always")  # what podman-restart.service starts
    for forbidden in ("privileged", "network_mode", "pid", "ipc", "cap_add", "devices"):
        assert forbidden not in row
    assert row.get("user", "10001:10001").startswith("10001:")
    for published in row.get("ports", []):
        assert published.startswith("127.0.0.1:")


def test_overlays_weaken_nothing() -> None:
    allowed = {"user", "command", "devices", "image", "pull_policy", "entrypoint", "healthcheck"}
    for stack in (HARDWARE, LEDS, ZENOHD):
        for row in stack["services"].values():
            assert set(row) <= allowed
            assert row["user"].startswith("10001:")
            assert isinstance(row["command"], str)  # lists of two files are put one after the other by some


def test_both_files_confine_alike() -> None:
    assert BASE["x-container"] == PERSON["x-container"]
    mine = BASE["services"]["user"]
    other = PERSON["services"]["user"]
    assert mine["environment"] | {"HEALTH_OF": "anna"} == other["environment"]
    assert mine["volumes"] == other["volumes"]


def test_page_is_published_on_this_machine_only() -> None:
    open_wide = compose("compose.yaml", LISTEN="0.0.0.0", PAGE_PORT="1234")["services"]  # noqa: S104
    assert open_wide["web"]["ports"] == ["127.0.0.1:1234:8090"]
    assert open_wide["web"]["command"].endswith(" --host 0.0.0.0 --published-port 1234")
    assert all(port.startswith("0.0.0.0:7447") for port in open_wide["router"]["ports"])
    assert [name for name, row in open_wide.items() if "ports" in row] == ["router", "web"]


def test_each_gets_its_own_credentials_only_and_cannot_write_them() -> None:
    for stack in (BASE, PERSON):
        volumes = {name: mounted(row) for name, row in stack["services"].items()}
        assert [name for name, where in volumes.items() if "site" in where] == ["init"]
        for name, where in volumes.items():
            if name == "init":
                continue
            credentials = {volume for volume in where if volume in ("services", "web", "person", "router")}
            assert len(credentials) == 1, name
            assert all(where[volume].endswith(":ro") for volume in credentials)
            expected = {"router": "router", "web": "web", "user": "person"}.get(name, "services")
            assert credentials == {expected}


def test_only_who_is_published_has_a_way_out() -> None:
    for stack in (BASE, PERSON):
        for name, row in stack["services"].items():
            assert row["networks"] == (["site", "outside"] if name in ("router", "web") else ["site"])
    assert BASE["networks"]["site"]["internal"] is True
    assert PERSON["networks"]["site"] == {"name": BASE["networks"]["site"]["name"], "external": True}


def test_volumes_are_shared_by_the_files_and_not_between_sites() -> None:
    for name in ("site", "router"):
        assert PERSON["volumes"][name] == BASE["volumes"][name] | {"external": True}
    names = [volume["name"] for volume in BASE["volumes"].values()]
    assert len(names) == len(set(names))
    other = compose("compose.yaml", SITE="hall")
    assert not {volume["name"] for volume in other["volumes"].values()} & set(names)


def test_the_image() -> None:
    text = (DEPLOY / "Dockerfile").read_text(encoding="utf-8")
    assert re.search(r"^ARG BASE=docker\.io/library/python:\d+\.\d+\.\d+-slim-\w+$", text, re.MULTILINE)
    last = text.split("FROM ${BASE}\n")[1]
    assert "\nUSER 10001:10001\n" in last
    assert "\nHEALTHCHECK " in last
    assert f" {CONTAINER}=" in last  # the page may listen at more than 127.0.0.1 there only
    assert f" {CONTAINERS}={USUAL_SITE} " in last
    assert "COPY --from=build /opt/pointit" in last
    ignored = (DEPLOY.parent / ".dockerignore").read_text(encoding="utf-8").splitlines()
    assert "*" in ignored  # what is not named stays out: no key, no recording, no history
    assert re.findall(r"ARG REQUIREMENTS=(.*)", text) == ["image"]
    assert text.count("pip install") == 2 + text.count("--no-deps /wheels/pointit-")
    assert text.count("--require-hashes -r") == 2
    needed = {row.extra for row in PROCESSES if row.name in BASE["services"]} - {""}
    assert needed <= LOCKS["image"]


@pytest.mark.parametrize("stack", ["compose.yaml", "compose.user.yaml"])
def test_containers_know_how_their_names_begin(stack: str) -> None:
    rows = compose(stack, SITE="hall", USER_NAME="anna")["services"].values()
    told = {row["container_name"]: row["environment"].get(CONTAINERS) for row in rows if "command" in row}
    assert set(told.values()) == {"hall"}
    assert all(name.startswith("hall-") for name in told)


def _links(folder: Path) -> set[str]:
    """Return the folders of the repository that links in `folder` lead to."""
    return {path.resolve().name for path in folder.iterdir() if path.is_symlink()}


def test_what_the_build_reads_goes_into_the_image() -> None:
    """The build in the image sees only what `.dockerignore` names."""
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    admitted = {line.removeprefix("!") for line in ignored if line.startswith("!")}

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    build = project["tool"]["hatch"]["build"]
    packages = set(build["targets"]["wheel"]["packages"])
    files = {"pyproject.toml", "LICENSE", project["project"]["readme"]}
    if "custom" in build["hooks"]:
        files.add(build["hooks"]["custom"].get("path", "hatch_build.py"))
    folders = packages.union(*(_links(ROOT / package) for package in packages))
    text = (DEPLOY / "Dockerfile").read_text(encoding="utf-8")
    copied = set(re.findall(r"^COPY (?:--chmod=\d+ )?(\w[\w/]*?)/? ", text, re.MULTILINE))

    assert {"schemas", "services", "bridges"} <= folders
    assert copied == {"requirements", "deploy/image"}
    assert files | folders | copied == admitted
    assert set(build["hooks"]) <= {"custom"}, "another hook may read other files"


def _scripts() -> Sequence[Path]:
    return sorted((DEPLOY / "image").iterdir())


@pytest.mark.parametrize("script", _scripts(), ids=lambda path: path.name)
def test_a_script_is_one(script: Path) -> None:
    assert os.access(script, os.X_OK)
    assert subprocess.run(["/bin/sh", "-n", str(script)], check=False).returncode == 0


ROOT = DEPLOY.parent
PARTS = {"ble", "discovery", "foxglove", "fusion", "mqtt", "plot", "ros2", "site", "web"}
LOCKS = {"ci": {"dev"}, "image": {"web", "site"}, "router": set[str]()}
"""The extras that each is for; `build` is for building."""
PIN = re.compile(r"^([\w.-]+)==(\S+)(?: ; .*)? \\$", re.MULTILINE)


def wanted(extras: set[str]) -> list[Requirement]:
    """Return the requirements of `extras` in pyproject.toml, without the package itself."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lines = [*project["dependencies"]]
    for extra in extras:
        lines += project["optional-dependencies"][extra]
    found = [Requirement(line) for line in lines]
    inner = set[str]().union(*(each.extras for each in found if each.name == "pointit"))
    return wanted(extras | inner) if inner - extras else [each for each in found if each.name != "pointit"]


@pytest.mark.parametrize("name", [*LOCKS, "build", "lowest"])
def test_every_line_of_a_lock_is_a_version_with_hashes(name: str) -> None:
    text = (ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8")
    assert "://" not in text
    rest = PIN.sub("", text)
    assert not re.sub(r"^    --hash=sha256:[0-9a-f]{64}(?: \\)?$", "", rest, flags=re.MULTILINE).strip()
    assert len(PIN.findall(text)) == len(re.findall(r"==.* \\\n    --hash=", text)) > 10


@pytest.mark.parametrize(("name", "extras"), LOCKS.items())
def test_a_lock_has_a_version_that_pyproject_takes(name: str, extras: set[str]) -> None:
    pins = PIN.findall((ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8"))
    for each in wanted(extras):
        versions = [version for package, version in pins if package == each.name.lower()]
        assert versions, f"{each.name} is missing in requirements/{name}.txt: run scripts/lock"
        assert all(each.specifier.contains(version) for version in versions), (
            f"requirements/{name}.txt: {each.name} {versions} is not {each.specifier}: run scripts/lock"
        )


def test_the_lowest_versions_are_those_that_pyproject_names() -> None:
    """If the exact version does not exist, as for mcap 1.2, another version of that series is accepted."""
    pins = PIN.findall((ROOT / "requirements" / "lowest.txt").read_text(encoding="utf-8"))
    for each in wanted(PARTS):
        (bound,) = (specifier.version for specifier in each.specifier if specifier.operator == ">=")
        (version,) = (version for package, version in pins if package == each.name.lower())
        assert Version(version).release[:2] == Version(f"{bound}.0").release[:2], (
            f"the lowest {each.name} is {bound}, but what is tested is {version}: run scripts/lock"
        )
