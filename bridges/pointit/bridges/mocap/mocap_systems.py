"""Motion capture systems that `pointit devices` searches."""

from importlib.metadata import EntryPoint

from pointit.bridges.mocap.config import MocapConfig
from pointit.bridges.mocap.natnet.client import find_servers
from pointit.runtime.config.plugins import DevicePlugin, PluginGroup

NATNET = DevicePlugin(
    summary="OptiTrack Motive", config=MocapConfig, argument="server", discover=find_servers
)


class _MocapSystems(PluginGroup[DevicePlugin]):
    """The systems of this package. Others join as trackers, without a search."""

    def find(self) -> dict[str, tuple[EntryPoint, ...]]:
        """Return the systems by name."""
        return {"natnet": (EntryPoint("natnet", f"{__name__}:NATNET", self.group),)}

    def package(self, name: str) -> str:
        """Return the package that brings the system `name`."""
        return "pointit" if name in self.names else super().package(name)


MOCAP_SYSTEMS = _MocapSystems("pointit.mocap_systems", DevicePlugin, "motion capture system")
