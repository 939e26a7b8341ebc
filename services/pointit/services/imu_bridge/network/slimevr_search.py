"""Search for SlimeVR trackers that call."""

from collections.abc import Sequence

from pointit.runtime.config.plugins import FoundDevice
from pointit.services.imu_bridge.network import slimevr_protocol as protocol
from pointit.services.imu_bridge.network.slimevr_trackers import Tracker
from pointit.services.imu_bridge.network.udp_server import ANY_HOST, Address, overhear

TAKEN = (
    "end the program that has it, such as a SlimeVR server, or set slimevr.port here and in the tracker's app"
)
MOST_FOUND = 64


async def discover(seconds: float) -> Sequence[FoundDevice]:
    """Return the trackers that call, without an answer to any. Those connected to a server do not call.

    Raises:
        ConfigError: If the port is taken by a program that does not share it.
    """
    found: dict[str, FoundDevice] = {}

    def on_datagram(data: bytes, address: Address) -> None:
        datagram = protocol.decode(data) if len(found) < MOST_FOUND else None
        for packet in datagram.packets if datagram is not None else ():
            if isinstance(packet, protocol.Handshake):
                tracker = Tracker(address, packet, 0.0, 0.0, 0.0)
                details: dict[str, str | float] = {
                    "ip": address[0],
                    "firmware": packet.firmware,
                    "board": float(packet.board),
                }
                label = f"{tracker.label()}; set imu-bridge.slimevr.host={ANY_HOST}"
                found[tracker.identity] = FoundDevice(tracker.identity, label, details)

    await overhear(protocol.PORT, seconds, on_datagram, remedy=TAKEN)
    return [found[identity] for identity in sorted(found)]
