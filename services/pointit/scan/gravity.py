"""Gravity of views that was measured with the opposite sign, as some phones and programs give it."""

from collections.abc import Sequence
from dataclasses import replace

from pointit.geometry.vector import scale
from pointit.scan.views import View

TURNED = (
    "gravity points up in the pictures, so it was taken the other way round: if the camera really was upside "
    "down, turn the pictures"
)


def upright(views: Sequence[View]) -> tuple[tuple[View, ...], str]:
    """Return `views` with gravity that points down in the pictures, and `TURNED` if it did not, else `""`.

    Cameras are held upright, or nearly: all signs are changed if gravity points up in most pictures.
    """
    if sum(view.gravity[1] for view in views if view.gravity is not None) >= 0.0:
        return tuple(views), ""
    turned = (replace(view, gravity=view.gravity and scale(view.gravity, -1.0)) for view in views)
    return tuple(turned), TURNED
