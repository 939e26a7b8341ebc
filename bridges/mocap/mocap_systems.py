"""Motion capture systems: the session and the client of each, and their search by `pointit devices`."""

from collections.abc import Callable

from pointit.bridges.mocap import natnet_client as natnet
from pointit.bridges.mocap import qtm_client as qtm
from pointit.bridges.mocap.bodies import TimedFrame
from pointit.bridges.mocap.config import MocapConfig
from pointit.bridges.mocap.natnet_client import NatNetSession
from pointit.bridges.mocap.natnet_packets import COMMAND_PORT
from pointit.bridges.mocap.qtm_client import QtmSession
from pointit.plugins.device_search import ShippedDevices
from pointit.runtime.config.plugins import DevicePlugin

NATNET = DevicePlugin(
    summary="OptiTrack Motive", config=MocapConfig, argument="server", discover=natnet.find_servers
)
QTM = DevicePlugin(
    summary="Qualisys Track Manager", config=MocapConfig, argument="server", discover=qtm.find_servers
)
MOCAP_SYSTEMS = ShippedDevices(
    "mocap_systems", "motion capture system", natnet=f"{__name__}:NATNET", qtm=f"{__name__}:QTM"
)


def check_system(config: MocapConfig) -> None:
    """Check that the packages that a system needs are installed. Raises: ConfigError: If they are not."""
    if config.system == "qtm":
        qtm.check_qtm_rt()


def open_system(
    config: MocapConfig,
    now_ns: Callable[[], int],
    *,
    on_frame: Callable[[TimedFrame], None],
    warn: Callable[[str], None],
) -> tuple[NatNetSession | QtmSession, natnet.NatNetClient | qtm.QtmClient]:
    """Return the session and the client of the configured server; nothing is connected yet.

    Args:
        config: names the system and its server.
        now_ns: time of the site, ns.
        on_frame: called with each frame that can be used.
        warn: called with a sentence about the network, or `""`.
    """
    interface = config.interface
    if config.system == "qtm":
        session = QtmSession(config.server, on_frame)
        port = config.port or qtm.PORT
        return session, qtm.QtmClient(session, now_ns, warn, port=port, interface=interface)
    natnet_session = NatNetSession(config.server, on_frame)
    port = config.port or COMMAND_PORT
    return natnet_session, natnet.NatNetClient(natnet_session, now_ns, warn, port=port, interface=interface)
