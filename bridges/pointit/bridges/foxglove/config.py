"""Parameters of the bridge to Foxglove."""

from pydantic import Field

from pointit.runtime.config.config import Config
from pointit.schemas.base import Rgb
from pointit.schemas.environment import KIND_COLORS


class FoxgloveConfig(Config):
    """Where viewers connect, and how much they are sent."""

    host: str = Field(
        default="127.0.0.1",
        min_length=1,
        description="address to listen on; any but the loopback shows the site to everybody who reaches it",
    )
    port: int = Field(
        default=8765,
        ge=0,
        le=65535,
        description="port to listen on, 0: any free one; in the viewer open a Foxglove WebSocket connection "
        "to ws://127.0.0.1:8765 and import the layout that is named at the start",
    )
    rate_hz: float = Field(
        default=30.0, gt=0, le=120, description="what changes is sent at most so often; the newest wins, Hz"
    )
    forget_s: float = Field(
        default=1.0,
        ge=0.1,
        le=60,
        description="rays and objects of which nothing was heard for so long are no longer shown, s",
    )
    kind_colors: dict[str, Rgb] = Field(
        default=KIND_COLORS, description="red, green, blue by kind of object; others are grey"
    )
