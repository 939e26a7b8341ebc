"""Motion capture systems that `pointit devices` searches."""

from pointit.bridges.mocap.config import MocapConfig
from pointit.bridges.mocap.natnet.client import find_servers
from pointit.plugins.device_search import ShippedDevices
from pointit.runtime.config.plugins import DevicePlugin

NATNET = DevicePlugin(
    summary="OptiTrack Motive", config=MocapConfig, argument="server", discover=find_servers
)
MOCAP_SYSTEMS = ShippedDevices("mocap_systems", "motion capture system", natnet=f"{__name__}:NATNET")
