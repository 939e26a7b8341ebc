"""Parameters of the bridge to Foxglove."""

from pydantic import Field

from pointit.plugins import AddressConfig


class FoxgloveConfig(AddressConfig):
    """Listening address of the viewers' server, and rates."""

    host: str = Field(
        default="127.0.0.1",
        min_length=1,
        description="address to listen on; anything but the loopback shows the site to the whole network",
    )
    port: int = Field(
        default=8765,
        ge=0,
        le=65535,
        description="port to listen on, 0: any free port; in the viewer open a Foxglove WebSocket connection "
        "to ws://127.0.0.1:8765 and import the layout named in the log",
    )
    rate_hz: float = Field(
        default=30.0, gt=0, le=120, description="maximum rate of updates, Hz; only the newest state is sent"
    )
