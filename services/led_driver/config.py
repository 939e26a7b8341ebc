"""Parameters of led-driver."""

from typing import Annotated

from pydantic import BeforeValidator, Field, SerializeAsAny, field_validator

from pointit.geometry.colormap import colormap
from pointit.runtime.config.config import Config
from pointit.schemas.base import Rgb
from pointit.schemas.environment import KIND_COLORS, OTHER_COLOR
from pointit.services.led_driver.outputs import OutputConfig, validate_output

Level = Annotated[float, Field(ge=0.0, le=1.0)]


class StyleConfig(Config):
    """Appearance of objects on a strip."""

    kind_colors: dict[str, Rgb] = Field(default=KIND_COLORS, description="red, green, blue by kind of object")
    default_color: Rgb = Field(default=OTHER_COLOR, description="colour of objects of any other kind")
    idle_level: Level = Field(default=0.45, description="brightness of objects that are not selected")
    pending_level: Level = Field(
        default=0.7,
        description="brightness of selected objects whose carriers have not reported yet that they are on",
    )
    margin_m: float = Field(
        default=0.07, ge=0, le=1, description="length of each margin of a selected or hovered object, m"
    )
    gap_level: Level = Field(
        default=0.12, description="brightness of the dark pixels in the patterns of selected objects"
    )
    tail_s: float = Field(
        default=0.15, ge=0, le=2, description="length of a moving object's tail, as its travel time, s"
    )
    tail_level: Level = Field(
        default=0.3, description="brightness of the tail relative to the object's, fading to 0"
    )


class LampsConfig(Config):
    """Lamps whose colour shows how far a ray passes them. pui reports them if so configured."""

    colormap: str = Field(default="viridis", description="colormap from lamps far away to a lamp that is hit")
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
    lamps: LampsConfig = Field(default=LampsConfig(), description="lamps coloured by the angle of the ray")
    outputs: tuple[SerializeAsAny[Annotated[OutputConfig, BeforeValidator(validate_output)]], ...] = Field(
        default=(), description="the controllers"
    )
