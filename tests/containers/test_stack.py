"""The site in containers: it works for two people, is well, is confined, comes back, and ends in time."""

import json
import os
import re
import signal
import socket
import time
import urllib.error
import urllib.request
from pathlib import Path

import pytest
from packaging.utils import canonicalize_name

from tests.containers.conftest import DEPLOY, Stack, is_well, podman, until
from tests.support.invoked import python
from tests.support.pace import within
from tests.unit.deploy.test_compose import PIN

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

SHARED = ("keeper", "pui", "selector", "led-driver", "conveyor-sim", "web")
PEOPLE = ("user1", "anna")
ALL = ("router", *SHARED, *PEOPLE)
SERVICES = 7 + 2 * 5
HANDED = {"router": {"ca.pem", "cert.pem", "key.pem", "router.json5"}}
OWN = {"ca.pem", "cert.pem", "key.pem", "link.json"}
END_S = 5.0


def test_both_people_act_and_red_packages_leave_at_bay_1(stack: Stack) -> None:
    def done() -> bool:  # a person's process tells what that person did
        logs = {name: stack.log(name) for name in PEOPLE}
        # who is slower may be refused all that they point at: both want the red ones
        return all(re.search(rf"\d (selected|refused) by {name}", log) for name, log in logs.items()) and any(
            re.search(r"red \d+ dispatched at bay 1", log) for log in logs.values()
        )

    until(done, lambda: "\n".join(stack.log(name) for name in ("init", *ALL)), 160.0)


def test_all_is_well_inside(stack: Stack) -> None:
    def well() -> bool:
        report = stack.doctor()
        return is_well(report) and len(report["services"]) == SERVICES

    until(well, lambda: str(stack.doctor()))


@pytest.mark.parametrize("name", ALL)
def test_a_container_tells_that_it_is_well(stack: Stack, name: str) -> None:
    def well() -> bool:
        if podman("healthcheck", "run", stack.name(name), check=False).returncode == 0:
            return True
        report = stack.doctor("--only", name)  # only if doctor, too, finds delays
        return not report["healthy"] and is_well(report)

    until(well, lambda: f"{stack.doctor('--only', name)} {stack.log(name)}")


def test_nobody_is_told_of_refusals(stack: Stack) -> None:
    assert [line for name in ALL for line in stack.log(name).splitlines() if "may not" in line] == []


def test_the_page_answers_whoever_has_its_link_on_this_machine(stack: Stack) -> None:
    def link() -> str:
        files = re.findall(r"/state/\S+/page-\d+\.html", stack.log("web"))
        if not files:
            return ""
        told = podman("exec", stack.name("web"), "cat", files[-1]).stdout
        return str(re.findall(r"http://127\.0\.0\.1:\d+/\?token=[\w-]+", told)[0])

    until(lambda: bool(link()), lambda: stack.log("web"))
    jar = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    with jar.open(link(), timeout=60) as answer:
        assert b"PointIt" in answer.read()
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(f"http://127.0.0.1:{stack.page_port}/", timeout=60)
    assert refused.value.code == 403
    refused.value.close()
    ports = podman("port", stack.name("web")).stdout.split("->")
    assert ports[-1].strip() == f"127.0.0.1:{stack.page_port}"
    assert f":{stack.page_port}/" in link()


def test_the_page_is_not_reached_from_other_machines(stack: Stack) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(("192.0.2.1", 9))  # sends nothing: finds the address by which others reach this machine
        address = probe.getsockname()[0]
    with socket.create_connection(("127.0.0.1", stack.page_port), timeout=60):
        pass
    with pytest.raises(OSError, match=r"refused|timed out"):
        socket.create_connection((address, stack.page_port), timeout=10)


@pytest.mark.parametrize("name", ALL)
def test_a_container_is_confined(stack: Stack, name: str) -> None:
    about = stack.about(name)
    host = about["HostConfig"]
    assert host["ReadonlyRootfs"] is True
    assert host["Privileged"] is False
    assert host["NetworkMode"] != "host"
    assert host["Memory"] > 0
    assert not about["EffectiveCaps"]
    status = stack.inside(name, "cat", "/proc/self/status").stdout
    assert re.search(r"^CapBnd:\t0+$", status, re.MULTILINE)
    assert re.search(r"^NoNewPrivs:\t1$", status, re.MULTILINE)
    assert re.search(r"^Uid:\t10001\t", status, re.MULTILINE)
    assert stack.inside(name, "touch", "/opt/pointit/x").returncode != 0
    assert stack.inside(name, "touch", "/tmp/x").returncode == 0  # noqa: S108 - the container's own


@pytest.mark.parametrize("name", ALL)
def test_a_container_has_its_own_credentials_only(stack: Stack, name: str) -> None:
    found = stack.inside(
        name, "find", "/credentials", "/handed", "/router", "/site", "/state", "-name", "*.*"
    )
    files = {path for path in found.stdout.split() if path.endswith((".pem", ".json5", "link.json"))}
    folder = "/router" if name == "router" else "/credentials"
    pages_own = {"/state/certificate.pem", "/state/key.pem"} if name == "web" else set[str]()
    assert files - pages_own == {f"{folder}/{file}" for file in HANDED.get(name, OWN)}
    assert stack.inside(name, "touch", f"{folder}/x").returncode != 0
    if name != "router":
        link = stack.inside(name, "cat", "/credentials/link.json").stdout
        expected = name if name in (*PEOPLE, "web") else "services"
        assert f'"name": "{expected}"' in link


def test_no_key_is_in_the_image(stack: Stack) -> None:
    done = podman(
        *("run", "--rm", "--network", "none", "--entrypoint", "find", stack.about("pui")["ImageName"]),
        *("/", "-xdev", "-name", "key.pem", "-o", "-name", "*.key", "-o", "-path", "/etc/passwd"),
        check=False,
    )
    assert done.stdout.split() == ["/etc/passwd"]  # it has looked


def test_the_image_lists_all_that_is_in_it_as_locked(stack: Stack) -> None:
    image = stack.about("pui")["ImageName"]

    def printed(entry: str, *arguments: str) -> str:
        return podman("run", "--rm", "--network", "none", "--entrypoint", entry, image, *arguments).stdout

    parts = json.loads(printed("cat", "/opt/pointit/sbom.cdx.json"))
    assert parts["bomFormat"] == "CycloneDX"
    listed = {canonicalize_name(part["name"]): part["version"] for part in parts["components"]}
    code = (
        "import importlib.metadata as m, json\n"
        "print(json.dumps({each.name: each.version for each in m.distributions()}))"
    )
    found = json.loads(printed("python3", "-c", code))
    there = {canonicalize_name(name): version for name, version in found.items()}
    assert listed == there
    pins = set(PIN.findall((DEPLOY.parent / "requirements" / "image.txt").read_text(encoding="utf-8")))
    assert {(name, version) for name, version in there.items() if name != "pointit"} <= pins


def test_container_on_the_internal_network_has_no_way_out(stack: Stack) -> None:
    code = (
        "import socket\n"
        "try: socket.create_connection(('192.0.2.1', 80), 2)\n"
        "except OSError as error: print(error.errno)"
    )
    for name in ("pui", "anna"):
        assert stack.inside(name, "python3", "-c", code).stdout.strip() == "101"  # ENETUNREACH


@pytest.mark.parametrize("name", ["dashboard1", "guest1"])
def test_credentials_that_are_carried_away_join_from_there(stack: Stack, tmp_path: Path, name: str) -> None:
    podman("cp", f"{stack.name('init')}:/site/identities/{name}", str(tmp_path))
    told: list[str] = []

    def well() -> bool:  # a busy machine may be late for a while, of which doctor warns
        done = python("-m", "pointit", "doctor", "--only", "pui", "--credentials", str(tmp_path / name))
        told[:] = [done.stderr, done.stdout]
        return done.returncode == 0

    until(well, lambda: "".join(told))


@pytest.mark.parametrize("name", ["selector", "router", "anna"])
def test_a_killed_container_comes_back(stack: Stack, name: str) -> None:
    before = stack.about(name)["State"]["Pid"]
    os.kill(before, signal.SIGKILL)

    def back() -> bool:
        pid = stack.about(name)["State"]["Pid"]
        return pid not in (0, before)

    assert within(until(back, lambda: stack.log(name)), 10.0)
    until(lambda: is_well(stack.doctor()), lambda: str(stack.doctor()))


def test_a_killed_program_is_begun_again(stack: Stack) -> None:
    code = (
        "import os, pathlib, signal\n"
        "for path in pathlib.Path('/proc').glob('[0-9]*'):\n"
        "    if b'bin/pointit\\0service' in (path / 'cmdline').read_bytes():\n"
        "        os.kill(int(path.name), signal.SIGKILL)\n"
        "        print('killed')"
    )
    assert stack.inside("pui", "python3", "-c", code).stdout.strip() == "killed"
    until(lambda: "exit code 137); again in 1 s" in stack.log("pui"), lambda: stack.log("pui"))
    until(lambda: is_well(stack.doctor()), lambda: str(stack.doctor()))


def test_revoked_identity_is_refused_and_reported(stack: Stack) -> None:
    said = stack.compose("compose.yaml", "run", "-T", "--rm", "--no-deps", "init", "site", "revoke", "anna")
    assert "anna has no rights any more" in said
    until(lambda: f"{stack.site}/anna may not" in stack.log("router"), lambda: stack.log("router"), 15)
    until(lambda: "this identity (anna) may do nothing here" in stack.log("anna"), lambda: stack.log("anna"))


def test_every_container_ends_in_time(stack: Stack) -> None:
    """The last test: nothing runs afterwards. The router ends first: nobody finds its name any more."""
    took_s: dict[str, float] = {}
    for name in ALL:
        began_s = time.monotonic()
        podman("stop", "--time", "20", stack.name(name))
        took_s[name] = time.monotonic() - began_s
        assert stack.about(name)["State"]["ExitCode"] == 0, stack.log(name)
    assert within(max(took_s.values()), END_S), took_s
