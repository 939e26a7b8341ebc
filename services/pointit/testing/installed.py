"""Harnesses of installed plug-ins, found by entry points of the group `pointit.fake_devices`."""

from importlib.metadata import entry_points
from typing import Any

from pointit.plugins import ConfigError, Plugin, SelectionMethod, ServicePlugin
from pointit.testing import SUITES, Harness
from pointit.testing.methods import MethodHarness
from pointit.testing.service import ServiceHarness

FAKE_DEVICES = "pointit.fake_devices"


def installed_harness(name: str, plugin: Plugin) -> Harness[Any] | None:
    """Return the harness that a package declares for its `plugin`, or None if it needs one and has none.

    Raises:
        ConfigError: If it is declared and cannot be imported.
    """
    for entry in entry_points(group=FAKE_DEVICES, name=name):
        try:
            harness: Harness[Any] = entry.load()
        except Exception as error:  # code of others, which may raise anything when it is imported
            reason = f"{type(error).__name__}: {error}"
            raise ConfigError(
                f"fake device {name!r}: {entry.value} cannot be imported ({reason}); correct the entry point"
            ) from error
        if type(harness) in SUITES and harness.plugin is plugin:
            return harness
    if isinstance(plugin, SelectionMethod):
        return MethodHarness(plugin=plugin)
    return ServiceHarness(plugin=plugin) if isinstance(plugin, ServicePlugin) else None
