"""Parameters of a serial LED expander."""

from typing import Literal

from pydantic import Field

from pointit.services.led_driver.outputs import OutputConfig

Board = Literal["v1", "v2", "v3"]


class ExpanderConfig(OutputConfig):
    """A serial LED expander (UPXL: ElectroMage, Pixelblaze)."""

    kind: str = Field(default="expander", description="kind of controller")
    port: str = Field(default="", description="path or name of the controller's port")
    baud: int = Field(default=2_000_000, gt=0, le=4_000_000, description="bits per second")
    wanted_rate_hz: float = Field(
        default=25.0, gt=0, le=1000, description="frames per second below which a warning says what fits"
    )
    board: Board = Field(
        default="v2", description="generation of the board: v1, v2, v3 drive 240, 800, 1600 pixels a channel"
    )
