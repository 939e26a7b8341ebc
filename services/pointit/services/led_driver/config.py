"""Parameters of led-driver."""

from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from pointit.geometry.colormap import colormap
from pointit.runtime.config.config import Config
from pointit.schemas.base import Rgb
from pointit.schemas.environment import KIND_COLORS, OTHER_COLOR

Board = Literal["v1", "v2", "v3"]
Level = Annotated[float, Field(ge=0.0, le=1.0)]


class ChannelConfig(Config):
    """Where a strip hangs on its controller."""

    channel: int = Field(ge=0, le=63, description="board number (0-7) times 8 plus port (0-7)")
    order: str = Field(
        default="GRB",
        description="order of the colours on the LEDs' wire: GRB, RGB, GRBW ...",
    )

    @field_validator("order")
    @classmethod
    def _each_once(cls, order: str) -> str:
        if "".join(sorted(order)) not in ("BGR", "BGRW"):
            raise ValueError("use each of R, G, B once, and W once if the LEDs have white")
        return order


class OutputConfig(Config):
    """One controller."""

    kind: Literal["none", "expander"] = Field(
        default="none", description="none, or a serial LED expander (UPXL: ElectroMage, Pixelblaze)"
    )
    port: str = Field(default="", description="path or name of the controller's port")
    baud: int = Field(default=2_000_000, gt=0, le=4_000_000, description="bits per second")
    wanted_rate_hz: float = Field(
        default=25.0, gt=0, le=1000, description="frames per second below which a warning says what fits"
    )
    board: Board = Field(
        default="v2", description="generation of the board: v1, v2, v3 drive 240, 800, 1600 pixels a channel"
    )
    gamma: float = Field(
        default=2.2, ge=1, le=4, description="of the eye: LEDs are sent v to the power of it; 1: as it is"
    )
    current_per_pixel_ma: float = Field(
        default=60.0, gt=0, le=1000, description="current of one white pixel, mA, for the estimate"
    )
    max_current_a: float | None = Field(
        default=None, gt=0, le=1000, description="frames that need more are dimmed, A; empty: none is"
    )
    channels: dict[str, ChannelConfig] = Field(
        default={}, description="by strip id; empty: the strips in the map's order on channels 0, 1, 2 ..."
    )

    @model_validator(mode="after")
    def _one_strip_a_channel(self) -> Self:
        taken: dict[int, str] = {}
        for strip_id, channel in self.channels.items():
            other = taken.setdefault(channel.channel, strip_id)
            if other != strip_id:
                raise ValueError(
                    f"channels: strips {other!r} and {strip_id!r} share channel {channel.channel}"
                )
        return self


class StyleConfig(Config):
    """How things look on a strip."""

    kind_colors: dict[str, Rgb] = Field(default=KIND_COLORS, description="red, green, blue by kind of object")
    default_color: Rgb = Field(default=OTHER_COLOR, description="of objects of any other kind")
    idle_level: Level = Field(default=0.45, description="brightness of objects that are not selected")
    margin_m: float = Field(
        default=0.07, ge=0, le=1, description="length of each margin of a selected or hovered object, m"
    )
    unknown_owner_color: Rgb = Field(
        default=(255, 255, 255), description="of the margins of what somebody without a profile has selected"
    )
    gap_level: Level = Field(
        default=0.12, description="brightness of the dark pixels in the patterns of what is selected"
    )
    tail_s: float = Field(
        default=0.15, ge=0, le=2, description="a moving object's tail is as long as its way in this time, s"
    )
    tail_max_m: float = Field(default=0.5, ge=0, le=10, description="no tail is longer, m")
    tail_level: Level = Field(
        default=0.3, description="brightness of the tail beside the object's own, fading to none"
    )


class CursorsConfig(Config):
    """How cursors look; their colour, width and colormap are in each person's profile."""

    draw_snapped: bool = Field(
        default=False, description="draw cursors where the selector draws them to, not where they truly are"
    )
    passed_level: Level = Field(
        default=0.5, description="brightness of the blinking pixel nearest to who points past everything"
    )
    distance: Literal["angle", "metres"] = Field(
        default="angle",
        description="what a cursor's colormap shows: the angle or the distance that it misses by",
    )
    range_deg: float = Field(
        default=10.0, gt=0, le=180, description="angle at which the colormap is at its start; 0 is its end"
    )
    range_m: float = Field(default=0.5, gt=0, le=1000, description="the same of the distance, m")


class LampsConfig(Config):
    """Lamps that show by their colour how far a ray passes them; pui says which, when it is asked to."""

    colormap: str = Field(
        default="viridis", description="its end is for a lamp that is hit, its start for those far away"
    )
    range_deg: float = Field(default=30.0, gt=0, le=180, description="angle that counts as far away")
    localization_timeout_s: float = Field(
        default=60.0, gt=0, le=3600, description="who is silent for so long while localizing has crashed, s"
    )

    @field_validator("colormap")
    @classmethod
    def _known(cls, name: str) -> str:
        colormap(name)
        return name


class StateLampConfig(Config):
    """How the state lamp looks."""

    idle_color: Rgb = Field(default=(40, 40, 40), description="while nobody points")
    pointing_color: Rgb = Field(default=(0, 120, 60), description="while anybody points")
    localizing_color: Rgb = Field(default=(0, 60, 255), description="pulses while anybody localizes")
    pulse_hz: float = Field(default=1.0, gt=0, le=2, description="pulses a second while localizing")
    flash_s: float = Field(default=0.4, ge=0.1, le=5, description="length of a cue's flash, s")


class LedDriverConfig(Config):
    """How strips look, how often they are drawn, and where they are sent."""

    max_rate_hz: float = Field(default=60.0, gt=0, le=1000, description="frames per second at most")
    patience_s: float = Field(
        default=1 / 30, ge=0, le=1, description="changes other than cursors wait so long for a cursor, s"
    )
    brightness: Level = Field(default=1.0, description="of everything, until a request sets another")
    cursor_timeout_s: float = Field(
        default=0.5, gt=0, le=60, description="a cursor without news for so long vanishes, s"
    )
    objects_timeout_s: float = Field(
        default=1.0, gt=0, le=60, description="objects without news for so long vanish, s"
    )
    style: StyleConfig = Field(default=StyleConfig(), description="colours and levels")
    cursors: CursorsConfig = Field(default=CursorsConfig(), description="how cursors look")
    lamps: LampsConfig = Field(default=LampsConfig(), description="lamps coloured by the angle of the ray")
    state_lamp: Annotated[str, Field(pattern=r"^([A-Za-z0-9_][A-Za-z0-9_.\-]{0,63})?$")] = Field(
        default="", description="id of a lamp that shows the state of the site; empty: none does"
    )
    state: StateLampConfig = Field(default=StateLampConfig(), description="how that one looks")
    outputs: tuple[OutputConfig, ...] = Field(default=(), description="the controllers")
