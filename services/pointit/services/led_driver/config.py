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
    """Connection of a strip to its controller."""

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
        default=2.2,
        ge=1,
        le=4,
        description="exponent of the gamma correction of LED values; 1: no correction",
    )
    current_per_pixel_ma: float = Field(
        default=60.0, gt=0, le=1000, description="current of one white pixel, mA"
    )
    max_current_a: float | None = Field(
        default=None, gt=0, le=1000, description="limit above which frames are dimmed, A; no limit if empty"
    )
    channels: dict[str, ChannelConfig] = Field(
        default={},
        description="connections by strip id; strips in the map's order on channels 0, 1, 2 ... if empty",
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
    """Appearance of objects on a strip."""

    kind_colors: dict[str, Rgb] = Field(default=KIND_COLORS, description="red, green, blue by kind of object")
    default_color: Rgb = Field(default=OTHER_COLOR, description="colour of objects of any other kind")
    idle_level: Level = Field(default=0.45, description="brightness of objects that are not selected")
    margin_m: float = Field(
        default=0.07, ge=0, le=1, description="length of each margin of a selected or hovered object, m"
    )
    unknown_owner_color: Rgb = Field(
        default=(255, 255, 255), description="colour of the margins of an object whose owner has no profile"
    )
    gap_level: Level = Field(
        default=0.12, description="brightness of the dark pixels in the patterns of selected objects"
    )
    tail_s: float = Field(
        default=0.15, ge=0, le=2, description="length of a moving object's tail, as its travel time, s"
    )
    tail_max_m: float = Field(default=0.5, ge=0, le=10, description="maximum length of a tail, m")
    tail_level: Level = Field(
        default=0.3, description="brightness of the tail relative to the object's, fading to 0"
    )


class CursorsConfig(Config):
    """Appearance of cursors. Their colour, width and colormap are in each person's profile."""

    draw_snapped: bool = Field(
        default=False, description="draw cursors where the selector snaps them to, not at their true position"
    )
    passed_level: Level = Field(
        default=0.5,
        description="brightness of the blinking pixel nearest to a ray that passes everything",
    )
    distance: Literal["angle", "metres"] = Field(
        default="angle",
        description="quantity shown by a cursor's colormap: angle or distance by which the ray misses",
    )
    range_deg: float = Field(
        default=10.0, gt=0, le=180, description="angle at the start of the colormap; its end is 0"
    )
    range_m: float = Field(default=0.5, gt=0, le=1000, description="distance at the start of the colormap, m")


class LampsConfig(Config):
    """Lamps whose colour shows how far a ray passes them. pui reports them if so configured."""

    colormap: str = Field(default="viridis", description="colormap from lamps far away to a lamp that is hit")
    range_deg: float = Field(default=30.0, gt=0, le=180, description="angle that counts as far away")
    localization_timeout_s: float = Field(
        default=60.0,
        gt=0,
        le=3600,
        description="silence after which a person's localization counts as crashed, s",
    )

    @field_validator("colormap")
    @classmethod
    def _known(cls, name: str) -> str:
        colormap(name)
        return name


class StateLampConfig(Config):
    """Appearance of the state lamp."""

    idle_color: Rgb = Field(default=(40, 40, 40), description="colour while no person points")
    pointing_color: Rgb = Field(default=(0, 120, 60), description="colour while a person points")
    localizing_color: Rgb = Field(
        default=(0, 60, 255), description="colour of the pulses while a person localizes"
    )
    pulse_hz: float = Field(default=1.0, gt=0, le=2, description="pulses per second while localizing")
    flash_s: float = Field(default=0.4, ge=0.1, le=5, description="length of a cue's flash, s")


class LedDriverConfig(Config):
    """Appearance of strips, rate of drawing, and outputs."""

    max_rate_hz: float = Field(default=60.0, gt=0, le=1000, description="maximum number of frames per second")
    patience_s: float = Field(
        default=1 / 30, ge=0, le=1, description="time for which other changes wait for a cursor, s"
    )
    brightness: Level = Field(default=1.0, description="brightness of all strips until a request changes it")
    cursor_timeout_s: float = Field(
        default=0.5, gt=0, le=60, description="age at which a cursor disappears, s"
    )
    objects_timeout_s: float = Field(
        default=1.0, gt=0, le=60, description="age at which objects disappear, s"
    )
    style: StyleConfig = Field(default=StyleConfig(), description="colours and levels")
    cursors: CursorsConfig = Field(default=CursorsConfig(), description="appearance of cursors")
    lamps: LampsConfig = Field(default=LampsConfig(), description="lamps coloured by the angle of the ray")
    state_lamp: Annotated[str, Field(pattern=r"^([A-Za-z0-9_][A-Za-z0-9_.\-]{0,63})?$")] = Field(
        default="", description="id of the lamp that shows the state of the site; no lamp if empty"
    )
    state: StateLampConfig = Field(default=StateLampConfig(), description="appearance of the state lamp")
    outputs: tuple[OutputConfig, ...] = Field(default=(), description="the controllers")
