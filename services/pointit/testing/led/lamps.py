"""Single lamps in place of the pixels of strips, so that outputs to lamps have the same checks."""

from collections.abc import Sequence

from pointit.plugins import LampOutput
from pointit.schemas import Lamp, Strip, StripsFrame


def lamp_id(strip_id: str, pixel: int) -> str:
    """Return the id of the lamp that stands for a pixel."""
    return f"{strip_id}_{pixel}"


class LampsAsStrips:
    """An output to strips, each pixel of which is a lamp of an output to lamps."""

    light_s = 0.0
    """Not measured."""

    def __init__(self, lamps: LampOutput) -> None:
        self._lamps = lamps

    def set_strips(self, strips: Sequence[Strip]) -> None:
        """Set a lamp for each pixel."""
        self._lamps.set_lamps(
            [
                Lamp(id=lamp_id(strip.id, pixel), position_m=strip.line_m[0])
                for strip in strips
                for pixel in range(strip.pixels)
            ]
        )

    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        """Show the pixels of `frame` on their lamps."""
        del age_s
        for strip in frame.strips:
            for pixel in range(len(strip.rgb) // 3):
                red, green, blue = strip.rgb[3 * pixel : 3 * pixel + 3]
                self._lamps.show_lamp(lamp_id(strip.id, pixel), (red, green, blue))

    async def run(self) -> None:
        """Run the output to lamps."""
        await self._lamps.run()
