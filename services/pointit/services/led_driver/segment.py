"""Parts of strips on the pixels of an output, as configured."""

from pydantic import Field, field_validator

from pointit.runtime.config.config import Config

LARGEST_OFFSET = 65535


def validated_order(order: str) -> str:
    """Return `order` if it names each of R, G, B once, and W at most once. Raises ValueError otherwise."""
    if "".join(sorted(order)) not in ("BGR", "BGRW"):
        raise ValueError("use each of R, G, B once, and W once if the LEDs have white")
    return order


class Segment(Config):
    """A part of a strip, on consecutive pixels of an output."""

    strip: str = Field(description="id of the strip in the map")
    first: int = Field(0, ge=0, description="first pixel of the strip")
    pixels: int | None = Field(None, gt=0, description="number of pixels; up to the strip's end if empty")
    offset: int | None = Field(
        None,
        ge=0,
        le=LARGEST_OFFSET,
        description="first pixel of the output, or of `universe` if set; next to the segment before if empty",
    )
    universe: int | None = Field(
        None, ge=0, le=63999, description="universe from which `offset` counts (E1.31, Art-Net)"
    )
    order: str = Field(
        "RGB", description="order of the colours that are sent: RGB, GRB, RGBW ...; W stays dark"
    )
    reversed: bool = Field(False, description="send the last pixel first")

    _order = field_validator("order")(validated_order)
