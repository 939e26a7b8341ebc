"""A site with its bridge in processes, and a ROS graph beside it with a peer in it."""

import contextlib
import sys
from collections.abc import Generator
from pathlib import Path

from tests.interop.ros2.peers import DOMAIN, Dora
from tests.support.buses import free_port
from tests.support.commands import Command, Commands

BOTH = ("--users", "2", "--imu", "sim", "--imu", "page")
"""Options for two users: user1 is simulated, and user2's arm orientation comes from the peer."""


class Site:
    """Running processes of the site. Each can be ended and started again."""

    def __init__(self, folder: Path, python: Path) -> None:
        self.ours = f"tcp/127.0.0.1:{free_port()}"
        self.ros = f"tcp/127.0.0.1:{free_port()}"
        self.folder = folder
        self.dora = Dora(python, folder, self.ros, "robot")
        self._commands = Commands(folder)
        self._environment = {"POINTIT_STATE": str(folder / "state")}

    def run(self, *arguments: str) -> Command:
        """Start `pointit run scenario_4`."""
        whole = ("run", "scenario_4", "--no-view", *BOTH, "--listen", self.ours, *arguments)
        return self._commands.start(*whole, environment=self._environment)

    def run_with_bridge(self, *arguments: str) -> Command:
        """Start it with the bridge in it, which is the ROS router."""
        settings = (f"endpoint={self.ros}", "mode=router", f"domain_id={DOMAIN}")
        pairs = [("--set", f"ros2.backend.{setting}") for setting in settings]
        return self.run("--ros2", *(argument for pair in pairs for argument in pair), *arguments)

    def bridge(self, mode: str) -> Command:
        """Start the bridge as a process of its own."""
        settings = {"endpoint": self.ros, "mode": mode, "domain-id": f"{DOMAIN}"}
        pairs = [(f"--backend.{name}", value) for name, value in settings.items()]
        command = [sys.executable, "-m", "pointit.bridges.ros2", "--connect", self.ours]
        command += [argument for pair in pairs for argument in pair]
        return self._commands.run(command, self._environment)

    def end(self) -> None:
        """End everything."""
        self.dora.kill()
        self._commands.kill_all()


@contextlib.contextmanager
def site(folder: Path, python: Path) -> Generator[Site]:
    """Yield a site of which nothing runs yet, and end what was started."""
    made = Site(folder, python)
    try:
        yield made
    finally:
        made.end()
