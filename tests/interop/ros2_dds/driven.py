"""Processes in the environment with a genuine rclpy that do as they are told."""

import os
from pathlib import Path
from typing import Any

from pointit.bridges.ros2.types.types import Types
from tests.architecture.sources import ROOT
from tests.support.told import Told

HERE = Path(__file__).parent
TYPES = Types("jazzy")
DOMAIN = 10 + os.getpid() % 90
"""Apart from others on this machine; up to 101, whose ports the system gives to nobody else."""


def environment(folder: Path) -> dict[str, str]:
    """Return variables of a process that finds our sources and a ROS graph on this machine alone."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("ROS_", "RMW_"))}
    return kept | {
        "HOME": f"{folder}",
        "POINTIT_STATE": f"{folder / 'state'}",
        "PYTHONPATH": f"{ROOT}",
        "PYTHONWARNINGS": "ignore",
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_HOME": f"{folder}",
    }


class Driven(Told):
    """A node in a process of its own: `bridge_side.py` or `rclpy_peer.py`."""

    def __init__(self, python: Path, folder: Path, script: str, node: str) -> None:
        command = (f"{python}", f"{HERE / script}", node, f"{DOMAIN}")
        super().__init__(node, command, folder / f"{node.rpartition('/')[2]}.stderr", environment(folder))

    async def do(self, what: str, **order: Any) -> Any:
        """Tell it to do something; return what it answers."""
        if "type" in order:
            order = {"hash": TYPES.kind(order["type"]).hash, **order}
        return await super().do(what, **order)


def cdr(name: str, **fields: Any) -> str:
    """Return a message's CDR, hexadecimal."""
    return TYPES.encode(name, TYPES.make(name, **fields)).hex()


def value(name: str, text: str) -> Any:
    """Return the message decoded from hexadecimal CDR."""
    return TYPES.decode(name, bytes.fromhex(text))
