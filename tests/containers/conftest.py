"""A secured site of its own for two people, in containers; made once, taken down whatever happens."""

import json
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.support.buses import free_port
from tests.support.pace import Patience

DEPLOY = Path(__file__).parents[2] / "deploy"
FILE = DEPLOY / "Dockerfile"
BASE = next(
    line.removeprefix("ARG BASE=")
    for line in FILE.read_text(encoding="utf-8").splitlines()
    if line.startswith("ARG BASE=")
)
MADE_BASE = "localhost/pointit-base:ci"
"""Image that `.ci/containers` builds in place of `BASE` if no registry can be reached."""
IMAGE = "localhost/pointit-test:latest"
PODMAN = shutil.which("podman") or ""
COMPOSE = shutil.which("podman-compose") or ""
PATIENCE_S = 90.0

os.environ.setdefault("CONTAINERS_CONF", str(Path(__file__).with_name("containers.conf")))


def base() -> str:
    """Return the base image on this machine, preferably the official one, or `""` if there is none."""
    known = (
        each for each in (BASE, MADE_BASE) if podman("image", "exists", each, check=False).returncode == 0
    )
    return next(known, "")


def missing() -> str:
    """Return the reason why no containers can run here, or `""` if they can."""
    if not PODMAN or not COMPOSE:
        return "podman and podman-compose are not installed"
    if os.geteuid() != 0:
        return "networks of containers need root here"
    if not base():
        return f"the base image {BASE} is not on this machine; .ci/containers gets or replaces it"
    return ""


def podman(*arguments: str, check: bool = True, timeout_s: float = 120.0) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        [PODMAN, *arguments], check=False, capture_output=True, text=True, timeout=timeout_s
    )
    assert not check or done.returncode == 0, done.stderr + done.stdout
    return done


def is_well(report: dict[str, Any]) -> bool:
    """Return True if a report of `pointit doctor` names nothing but delays, which a busy machine has.

    All containers have one clock: what is late in all its reports looks like a clock that is behind.
    """
    return bool(report["healthy"]) or all(
        finding["severity"] == "note"
        or finding["code"] in {"clock", "slow"}
        or "the clock of machine" in finding["sentence"]
        for finding in report.get("findings", [{"severity": "error", "code": "unknown", "sentence": ""}])
    )


def until(holds: Callable[[], bool], what: Callable[[], str], patience_s: float = PATIENCE_S) -> float:
    """Wait until something holds; return how long that took, s."""
    began_s = time.monotonic()
    patience = Patience(patience_s)
    while not holds():
        assert not patience.is_over(), what()
        time.sleep(1.0)  # each look starts programs of podman
    return time.monotonic() - began_s


@dataclass(frozen=True)
class Stack:
    """The running containers of a site and their ports."""

    site: str
    port: int
    page_port: int

    def compose(self, file: str, *arguments: str, **variables: str) -> str:
        """Run podman-compose on one of the files; return what it has said."""
        own = {"SITE": self.site, "PORT": str(self.port), "PAGE_PORT": str(self.page_port), "IMAGE": IMAGE}
        done = subprocess.run(
            [COMPOSE, "-f", str(DEPLOY / file), *arguments], check=False, capture_output=True, text=True,
            timeout=300, env={**os.environ, **own, **variables},
        )  # fmt: skip
        return done.stdout + done.stderr

    def name(self, service: str) -> str:
        return f"{self.site}-{service}"

    def log(self, service: str) -> str:
        done = podman("logs", self.name(service), check=False)
        return done.stdout + done.stderr

    def inside(self, service: str, *command: str) -> subprocess.CompletedProcess[str]:
        return podman("exec", self.name(service), *command, check=False)

    def about(self, service: str) -> dict[str, Any]:
        (known,) = json.loads(podman("inspect", self.name(service)).stdout)
        return dict(known)

    def doctor(self, *arguments: str) -> dict[str, Any]:
        """Return the report of `pointit doctor` in the keeper's container."""
        done = self.inside("keeper", "pointit", "doctor", "--json", *arguments)
        return dict(json.loads(done.stdout)) if done.stdout.startswith("{") else {"healthy": False}


@pytest.fixture(scope="session")
def stack() -> Generator[Stack]:
    """Bring the site up as README.md says, and a second person."""
    if why := missing():
        pytest.skip(why)
    podman(
        *("build", "--quiet", "--network", "host", "--format", "docker", "--tag", IMAGE),
        *("--build-arg", f"BASE={base()}", "--file", str(FILE), str(DEPLOY.parent)),
        timeout_s=600,
    )
    made = Stack(site=f"test{os.getpid()}", port=free_port(), page_port=free_port())
    second = {"USER_NAME": "anna", "USER_PLACE": "2"}
    try:
        said = made.compose("compose.yaml", "up", "-d")
        said += made.compose("compose.user.yaml", "up", "-d", **second)
        started = podman("ps", "--format", "{{.Names}}").stdout.split()
        assert {made.name(each) for each in ("router", "web", "anna")} <= set(started), said
        yield made
    finally:
        made.compose("compose.user.yaml", "down", **second)
        made.compose("compose.yaml", "down")
        for kind in ("volume", "network"):
            names = podman(kind, "ls", "--format", "{{.Name}}").stdout.split()
            for name in names:
                if name == made.site or name.startswith(f"{made.site}-"):
                    podman(kind, "rm", "--force", name, check=False)
