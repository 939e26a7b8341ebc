"""A secured site with two people who select, every service a process that can be killed or stopped."""

import contextlib
import json
import shlex
import shutil
import subprocess
import time
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import Any

from pointit.access.site_folder import SiteFolder
from pointit.services.selector.audit import audit
from pointit.services.selector.journal import FILE
from tests.integration.access.secured import NAMES, endpoint_of, make_site
from tests.support.commands import Command, Commands
from tests.support.pace import Patience

SITE = "plant"
PEOPLE = ("user1", "user2")
SHARED = ("pui", "selector", "led-driver", "conveyor-sim", "keeper")
PERSONAL = ("pointing", "localizer", "supervisor", "user-sim")
FLOODERS = ("flooder1", "flooder2", "flooder3")
"""Persons who write without limit. Each is cut off for a while, which must not affect other tests."""
LONG_WRITER = "flooder4"
"""The same of a person who writes long messages."""
INSTANCES = (*SHARED, *(f"{name}.{person}" for person in PEOPLE for name in PERSONAL))
START_S = 120.0
"""Fifteen processes on a busy machine."""
FLOWS_S = 30.0
NOTICED_S = 15.0
"""Doctor takes 2 s, and its start on a busy machine."""
BUSY = """\
conveyor-sim:
  rate_hz: 10
  feeders:
    entry:
      belt: part_e
      probabilities: {red: 0.8, blue: 0.2}
      min_interval_s: 1.6
      max_interval_s: 2.2
      length_m: 0.4
led-driver:
  max_rate_hz: 5
user-sim:
  rate_hz: 15
"""
"""More to select than people would have, and fewer samples and frames: fifteen processes share two cores."""
DASHBOARD_HZ = 20.0
DISK_BYTES = 32 * 1024 * 1024
AGAIN = " start it again with: "


class Site:
    """The processes of the site, which can be killed, stopped and started again."""

    def __init__(
        self, path: Path, commands: Commands, users: int = len(PEOPLE), *, password: bool = False
    ) -> None:
        """Start the router and, once it listens, the run; its state is kept in `path / "state"`.

        Args:
            path: folder for all of it.
            commands: start the processes.
            users: how many people.
            password: the site goes by passwords instead of by certificates; dashboards come by QUIC then.
        """
        self.path = path
        self.commands = commands
        self.folder: SiteFolder = make_site(
            path / "site",
            SITE,
            password=password,
            dashboard_rate_hz=DASHBOARD_HZ if password else 0.0,
            names={**NAMES, **dict.fromkeys((*FLOODERS, LONG_WRITER), "user")},
        )
        self.state = path / "state"
        self.state.mkdir(exist_ok=True)
        self.has_small_disk = False
        """Whether its state is on a disk that tests may fill."""
        self._users = users
        self.router = self.route()
        self.run: Command | None = None
        self.again: dict[str, Command] = {}
        """Services that were started again, by instance."""
        self._commands: dict[str, str] = {}

    @contextlib.contextmanager
    def on_small_disk(self) -> Generator[None]:
        """Put the state on a small disk of its own, where that is allowed."""
        options = ("-t", "tmpfs", "-o", f"size={DISK_BYTES}", "tmpfs", str(self.state))
        mount = shutil.which("mount")
        unmount = shutil.which("umount")
        if mount is not None and unmount is not None:
            done = subprocess.run([mount, *options], check=False, capture_output=True)
            self.has_small_disk = done.returncode == 0
        try:
            yield
        finally:
            if self.has_small_disk:
                subprocess.run([str(unmount), "--lazy", str(self.state)], check=True)

    @property
    def endpoint(self) -> str:
        return endpoint_of(self.folder)

    def environment(self, name: str = "supervisor") -> Mapping[str, str]:
        identity = str(self.folder.identity_folder(name))
        return {"POINTIT_STATE": str(self.state), "POINTIT_CREDENTIALS": identity}

    def route(self) -> Command:
        """Start the router, again where it was killed."""
        environment = {"POINTIT_STATE": str(self.state)}
        folder = str(self.folder.path)
        self.router = self.commands.start_program("router", "--site-folder", folder, environment=environment)
        return self.router

    async def begin(self) -> None:
        if self.run is not None:
            return
        await self.router.says("router listens")
        busy = self.path / "busy.yaml"
        busy.write_text(BUSY)
        options = ("--users", str(self._users), "--processes", "--duration", "3600", "--no-view")
        self.run = self.commands.start_program(
            "run", "scenario_4", *options, "--config", str(busy), environment=self.environment()
        )

    def start(self, *arguments: str, name: str = "supervisor") -> Command:
        return self.commands.start(*arguments, environment=self.environment(name))

    def says_lost(self) -> int:
        """Return the number of times that the run has logged the loss of its router."""
        assert self.run is not None
        return sum("is lost; trying again" in line for line in self.run.logged())

    def command(self, instance: str) -> str:
        if instance not in self._commands:
            assert self.run is not None
            said = f"{instance} was ended"
            (line,) = (line for line in self.run.logged() if line.startswith(said))
            self._commands[instance] = line.partition(AGAIN)[2].partition(" (its log: ")[0]
        return self._commands[instance]

    def restart(self, instance: str, more: Mapping[str, str] | None = None) -> Command:
        command = shlex.split(self.command(instance))
        environment = {**self.environment(), **(more or {})}
        again = self.again[instance] = self.commands.run(command, environment)
        return again

    async def doctor(self, *arguments: str) -> dict[str, Any]:
        command = self.start("doctor", "--json", *arguments)
        report: dict[str, Any] = json.loads((await command.end()).out)
        return report

    async def content(self, patience_s: float = FLOWS_S) -> float:
        """Ask doctor until all is well, however slow the machine is; return how long that took, s."""
        began_s = time.monotonic()
        patience = Patience(patience_s)
        while True:
            findings = (await self.doctor())["findings"]
            found = [item for item in findings if item["severity"] != "note" and item["code"] != "slow"]
            if not found:
                return time.monotonic() - began_s
            assert not patience.is_over(), f"doctor still finds {found}"

    @property
    def journal(self) -> Path:
        return self.state / SITE / "selector" / FILE

    def told(self) -> list[tuple[int, str, str]]:
        """Return number, object and event of what the selector's journal marks as published."""
        records = audit(self.journal)
        return [(each.seq, each.object_id, each.event) for each in records if each.seq is not None]
