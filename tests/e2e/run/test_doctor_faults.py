"""`pointit doctor` on real sites whose processes are killed, stopped and cut off: one cause, one remedy."""

import contextlib
import json
import os
import re
import signal
import subprocess
from collections.abc import AsyncGenerator, Generator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from tests.integration.access.secured import endpoint_of, make_site
from tests.support.commands import Command, Commands
from tests.support.pace import Patience

PATIENCE_S = 90.0
START_S = 150.0
"""Doctor waits for services that are starting, on a busy machine for a minute and more."""
PEOPLE = ("anna", "ben", "cleo")
OF_BUSY_MACHINES = ("slow", "starved")
"""Codes of findings of this machine, on which tests run beside each other."""
pytestmark = [pytest.mark.slow, pytest.mark.long]


@dataclass
class Plant:
    """A site whose processes are started as a shell does."""

    commands: Commands
    options: tuple[str, ...]
    """Options of doctor."""
    environment: Mapping[str, str]
    run: Command
    people: dict[str, Command] = field(default_factory=dict[str, Command])
    router: Command | None = None

    async def findings(self) -> list[dict[str, Any]]:
        command = self.commands.start("doctor", "--json", *self.options, environment=self.environment)
        ended = await command.end(START_S)
        findings: list[dict[str, Any]] = json.loads(ended.out)["findings"]
        problems = [each for each in findings if each["severity"] != "note"]
        assert ended.code == (1 if problems else 0)
        return [each for each in problems if each["code"] not in OF_BUSY_MACHINES]

    async def finds(self, *codes: str) -> dict[str, Any]:
        """Return the only finding, as soon as it has one of `codes`."""
        patience = Patience(PATIENCE_S)
        while True:
            found = await self.findings()
            if len(found) == 1 and found[0]["code"] in codes:
                return found[0]
            assert not patience.is_over(), found

    async def is_well(self) -> None:
        patience = Patience(PATIENCE_S)
        while found := await self.findings():
            assert not patience.is_over(), found


@contextlib.asynccontextmanager
async def stopped(pid: int) -> AsyncGenerator[None]:
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


def run_at(commands: Commands, endpoint: str, *options: str, state: Path | None = None) -> Plant:
    arguments = ("run", "scenario_3", "--no-view", "--duration", "3600", *options, "--listen", endpoint)
    environment = {"POINTIT_STATE": str(state)} if state else {}
    run = commands.start_program(*arguments, environment=environment)
    return Plant(commands, ("--connect", endpoint), {}, run)


@contextlib.contextmanager
def small_disk(path: Path) -> Generator[Path]:
    """Yield a folder with room for 1 MB."""
    path.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(path)]
    if subprocess.run(mount, check=False, capture_output=True).returncode:
        pytest.skip("a small disk needs the right to mount one")
    try:
        yield path
    finally:
        subprocess.run(["umount", "--lazy", str(path)], check=True)  # noqa: S607 - as above


async def finds_it_stopped(plant: Plant) -> None:
    pid = plant.run.process.pid
    async with stopped(pid):
        finding = await plant.finds("stopped")
        assert finding["remedy"].startswith(f"continue it: `kill -CONT {pid}`")
    await plant.is_well()


async def finds_it_killed(plant: Plant, endpoint: str) -> None:
    plant.run.kill()
    finding = await plant.finds("unreachable")
    assert finding["sentence"] == f"nothing runs at {endpoint}"
    assert "`pointit run`" in finding["remedy"]


async def test_a_run_that_is_stopped_or_killed(commands: Commands, endpoint: str) -> None:
    plant = run_at(commands, endpoint)
    await plant.is_well()
    await finds_it_stopped(plant)
    await finds_it_killed(plant, endpoint)


async def test_doctor_names_stopped_and_killed_processes_but_not_starting_ones(
    commands: Commands, endpoint: str
) -> None:
    """One run for all: its processes take ten seconds of CPU to start."""
    plant = run_at(commands, endpoint, "--processes")
    await plant.run.says("starts on site")
    # on a busy machine services that start may warn of messages that come late
    assert [each for each in await plant.findings() if each["code"] != "warning"] == [], "while it starts"

    await plant.is_well()
    await finds_it_stopped(plant)
    pui = next(
        each for each in plant.run.family() if each.cmdline()[1:4] == ["-m", "pointit.services", "pui"]
    )
    async with stopped(pui.pid):
        finding = await plant.finds("stopped")
        assert f"process {pui.pid} is stopped" in finding["sentence"]
        assert finding["service"] == "pui"
    await plant.is_well()
    pui.kill()

    finding = await plant.finds("absent")
    assert finding["service"] == "pui"
    assert "pointit service run pui" in finding["remedy"]
    await finds_it_killed(plant, endpoint)


async def test_a_disk_that_becomes_full(commands: Commands, endpoint: str, tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk") as disk:
        plant = run_at(commands, endpoint, state=disk)
        await plant.is_well()
        with (disk / "filling").open("wb", buffering=0) as filling, contextlib.suppress(OSError):
            while True:
                filling.write(bytes(4096))
        finding = await plant.finds("disk")
        assert str(disk) in finding["sentence"]
        assert "make room there" in finding["sentence"]
        (disk / "filling").unlink()
        await plant.is_well()
        await plant.run.stop()


@contextlib.asynccontextmanager
async def secured_plant(commands: Commands, path: Path) -> AsyncGenerator[Plant]:
    """Yield a secured site with three people, each in a process of their own."""
    names = {"supervisor": "supervisor", "operator": "operator", **dict.fromkeys(PEOPLE, "user")}
    folder = make_site(path / "site", "hall", names=names)  # pyrefly: ignore[bad-argument-type]

    def of(name: str) -> dict[str, str]:
        return {"POINTIT_CREDENTIALS": str(folder.identity_folder(name))}

    router = commands.start_program("router", "--site-folder", str(folder.path))
    await router.says("router listens")
    run = commands.start_program(
        "run", "scenario_3", "--site-only", "--no-view", "--duration", "3600", environment=of("supervisor")
    )
    options = ("--duration", "3600", "--no-view")
    people = {
        name: commands.start_program("person", "add", name, *options, environment=of(name)) for name in PEOPLE
    }
    plant = Plant(commands, (), of("operator"), run, people, router)
    assert endpoint_of(folder)
    await plant.is_well()
    yield plant


async def test_a_router_with_three_people(commands: Commands, tmp_path: Path) -> None:
    async with secured_plant(commands, tmp_path) as plant:
        async with stopped(plant.run.process.pid):
            finding = await plant.finds("stopped")
            assert f"process {plant.run.process.pid} is stopped" in finding["sentence"]
        await plant.is_well()
        anna = plant.people["anna"]
        async with stopped(anna.process.pid):
            finding = await plant.finds("stopped")
            assert (finding["service"], str(anna.process.pid) in finding["remedy"]) == ("anna", True)
        await plant.is_well()
        anna.kill()

        finding = await plant.finds("absent")
        assert finding["service"] == "anna"
        assert re.search(r"`pointit person add anna --credentials \S+/anna`", finding["remedy"])
        assert plant.router is not None

        async with stopped(plant.router.process.pid):
            finding = await plant.finds("stopped")
            assert f"process {plant.router.process.pid} is stopped" in finding["sentence"]
        plant.router.kill()
        await plant.finds("unreachable")


async def test_a_service_with_the_rights_of_another_person(commands: Commands, tmp_path: Path) -> None:
    async with secured_plant(commands, tmp_path) as plant:
        cleo = {"POINTIT_CREDENTIALS": str(tmp_path / "site" / "identities" / "cleo")}
        commands.start_program("service", "run", "pointing", "--user", "dora", environment=cleo)
        finding = await plant.finds("denied")
        assert finding["sentence"].startswith("hall/cleo may not write ")
        assert "pointing.dora" in finding["sentence"] or "users/dora" in finding["sentence"]
        assert "those of cleo" in finding["remedy"]


async def test_shared_services_that_are_killed_leave_nobody_a_cursor(
    commands: Commands, tmp_path: Path
) -> None:
    async with secured_plant(commands, tmp_path) as plant:
        plant.run.kill()
        finding = await plant.finds("no-cursor")
        assert finding["sentence"].startswith(
            "anna, ben and cleo have no cursor: pui and selector do not run"
        )
        assert "`pointit run --site-only --credentials " in finding["remedy"]
