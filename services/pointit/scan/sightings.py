"""The sightings of all views as arrays."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pointit.scan.bundle import Array, Indices
from pointit.scan.views import CameraView, LampSpec, StripSpec

MAX_MARKS = 60
"""Maximum number of different pixels of one strip that are used."""
EXPECTED_FOCAL = 0.78
"""Focal length of a phone, as a share of the image's longer side."""


@dataclass(frozen=True)
class SightingArrays:
    """All sightings as arrays.

    Attributes:
        view, chain, pixel, uv: n, n, n, n x 2 from the images' centres. Chains are strips, then lamps.
        downs: directions of gravity, views x 3, NaN if unknown.
        strips: number of strips.
        side_px: longer side of the images.
    """

    view: Indices
    chain: Indices
    pixel: Array
    uv: Array
    downs: Array
    strips: int
    side_px: float

    @classmethod
    def of(
        cls, strips: Sequence[StripSpec], lamps: Sequence[LampSpec], views: Sequence[CameraView]
    ) -> "SightingArrays":
        """Return the sightings in `views`, of at most `MAX_MARKS` different pixels of each."""
        specs: list[StripSpec | LampSpec] = [*strips, *lamps]
        numbers = {spec.name: number for number, spec in enumerate(specs)}
        rows = [
            (index, numbers[seen.name], seen.pixel, seen.u - view.width / 2.0, seen.v - view.height / 2.0)
            for index, view in enumerate(views)
            for seen in view.sightings
        ]
        table = np.array(rows, dtype=np.float64).reshape(-1, 5)
        keep = np.ones(len(table), dtype=bool)
        for chain in range(len(strips)):
            pixels = np.unique(table[table[:, 1] == chain, 2])
            if len(pixels) > MAX_MARKS:
                chosen = pixels[np.linspace(0, len(pixels) - 1, MAX_MARKS).astype(int)]
                keep &= (table[:, 1] != chain) | np.isin(table[:, 2], chosen)
        table = table[keep]
        downs = np.array([view.gravity or (np.nan,) * 3 for view in views], dtype=np.float64)
        downs /= np.linalg.norm(downs, axis=1, keepdims=True)
        view, chain = table[:, :2].T.astype(np.intp)
        side_px = float(max(views[0].width, views[0].height))
        return cls(view, chain, table[:, 2], table[:, 3:], downs, len(strips), side_px)

    def of_chain(self, chain: int, view: int) -> tuple[Array, Array]:
        """Return the pixels and images of one strip or lamp in one view."""
        part = (self.view == view) & (self.chain == chain)
        return self.pixel[part], self.uv[part]

    @property
    def log_focal(self) -> float:
        """Return the expected logarithm of the focal length in image pixels."""
        return float(np.log(EXPECTED_FOCAL * self.side_px))
