"""Decision cores load no Zenoh: they are tested, replayed and spawned without a network."""

import subprocess
import sys

from pointit.services.registry import PROCESSES
from tests.architecture.sources import ROOT, shipped

HARMLESS = ("access", "diagnosis", "geometry", "plugins", "schemas", "sim")
"""Rooms with modules that are all loaded."""


def modules() -> list[str]:
    """Modules of the harmless rooms and of every service, except those that start a process."""
    rooms = ["pointit_lab.evaluation", *(f"pointit.{room}" for room in HARMLESS)]
    rooms += [row.package for row in PROCESSES if row.room == "services"]
    names: list[str] = []
    for path in shipped():
        parts = path.relative_to(ROOT).with_suffix("").parts[1:]
        name = ".".join(parts).removesuffix(".__init__")
        if parts[-1] != "__main__" and any(name == room or name.startswith(f"{room}.") for room in rooms):
            names.append(name)
    return names


def test_what_decides_loads_no_zenoh() -> None:
    names = ["pointit.runtime.service.service", *modules()]
    assert {
        "pointit_lab.evaluation.localization.localization",
        "pointit.services.selector.selection_engine",
    } <= set(names)
    script = (
        "import importlib, sys\n"
        "for name in sys.stdin.read().split():\n"
        "    importlib.import_module(name)\n"
        "    if 'zenoh' in sys.modules: sys.exit(f'{name} loads zenoh')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], input="\n".join(names), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
