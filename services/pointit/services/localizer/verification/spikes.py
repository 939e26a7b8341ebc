"""Rays that no arm can have followed: their directions leap away from the ones before and after."""

import math

import numpy as np

from pointit.services.localizer.estimation.sample_blocks import Pointings

NEIGHBOURS = 3
"""Number of samples before and after, with whose median a ray is compared."""

SPIKE_RAD = math.radians(12.0)
"""Least angle between a spike and the median. An arm that reaches, by 100 degrees a second, is 4 degrees off
within 40 ms (pointing.md §7)."""


def without_spikes(pointings: Pointings) -> Pointings:
    """Return the samples whose rays are near the median of their neighbours."""
    width = 2 * NEIGHBOURS + 1
    if len(pointings) < width:
        return pointings
    rays = np.pad(pointings.directions, ((NEIGHBOURS, NEIGHBOURS), (0, 0)), mode="reflect")
    middles = np.median(np.lib.stride_tricks.sliding_window_view(rays, width, axis=0), axis=2)
    lengths = np.maximum(np.linalg.norm(middles, axis=1), 1e-9)
    along = np.einsum("ij,ij->i", pointings.directions, middles) / lengths
    near = along >= math.cos(SPIKE_RAD)
    return pointings if near.all() else pointings.only(near)
