"""Reasons to doubt a strip or lamp: seen too little, from too few directions, bent, or another one."""

import math

import numpy as np

from pointit.scan.refinement import Refined

LEAST_PARALLAX_RAD = math.radians(4.0)
LEAST_SIGHTINGS = 3
"""Minimum number of pixels for a view to count for a strip."""
MAX_SIGMA_M = 0.03
"""Largest sigma with which a strip counts as identified."""
LEAST_SHARE = 0.5
"""Share of the sightings of each part of a strip that have to agree with its place."""
WINDOWS = 8
"""Number of parts of a strip; two neighbours are judged together."""
LEAST_IN_WINDOW = 4
MAX_STRETCH = 0.04
"""Relative difference of a measured pitch from the one that a strip is said to have."""


def views_of(found: Refined, chain: int) -> list[int]:
    """Return the views, as numbers in the state, that count for a chain."""
    least = LEAST_SIGHTINGS if chain < found.seen.strips else 1
    counts = np.bincount(found.seen.view[found.used & (found.seen.chain == chain)], minlength=64)
    return [index for index, view in enumerate(found.views) if counts[view] >= least]


def doubt(found: Refined, chain: int, sigma_m: float) -> str:
    """Return the reason why a strip or lamp is not identified, or `""`."""
    views = views_of(found, chain)
    if len(views) < 2:
        return "seen from one place only: photograph it from another one"
    ends = found.state.ends[found.model.chain == chain]
    middle = ends.mean(axis=(0, 1)) if chain < found.seen.strips else ends[0, 0]
    sights = middle - found.cameras[views]
    sights /= np.linalg.norm(sights, axis=1, keepdims=True)
    if np.arccos(np.clip((sights @ sights.T).min(), -1.0, 1.0)) < LEAST_PARALLAX_RAD:
        return "seen from one direction only: photograph it from a step further aside"
    if sigma_m > MAX_SIGMA_M:
        return f"its place is uncertain by {sigma_m:.2f} m: photograph it once more, from nearer"
    return "" if chain >= found.seen.strips else _disagreement(found, chain)


def unseen(found: Refined, chain: int) -> tuple[float, float]:
    """Return the first and last pixel of the longest part of a strip that no two views show.

    It is at an end of the strip, or of a straight piece.
    """
    parts: list[tuple[float, float]] = []
    for low, high in found.model.bounds[found.model.chain == chain].tolist():
        own = found.used & (found.seen.chain == chain)
        own &= (found.seen.pixel > low) & (found.seen.pixel < high)
        shown = [found.seen.pixel[own & (found.seen.view == view)] for view in found.views]
        shown = [pixels for pixels in shown if len(pixels) >= LEAST_SIGHTINGS]
        if len(shown) < 2:
            parts.append((low + 0.5, high - 0.5))
        else:
            first, last = sorted(p.min() for p in shown)[1], sorted(p.max() for p in shown)[-2]
            parts += [(low + 0.5, float(first) - 1.0), (float(last) + 1.0, high - 0.5)]
    return max(parts, key=lambda part: part[1] - part[0])


def _disagreement(found: Refined, chain: int) -> str:
    """Return which part of a strip is not where its line has it, or `""`."""
    seen = found.seen
    shown = (seen.chain == chain) & np.isin(seen.view, found.views)
    pairs, inverse = np.unique(np.column_stack([seen.pixel, seen.view])[shown], axis=0, return_inverse=True)
    agrees = np.bincount(inverse.ravel(), found.used[shown]) > 0  # a pixel and its reflection are one
    bounds: list[float] = np.linspace(float(pairs[0, 0]), float(pairs[-1, 0]), WINDOWS + 1).tolist()
    for low, high in zip(bounds[:-2], bounds[2:], strict=True):
        window = (pairs[:, 0] >= low) & (pairs[:, 0] <= high)
        if window.sum() >= LEAST_IN_WINDOW and agrees[window].mean() < LEAST_SHARE:
            return (
                f"pixels {low:.0f} to {high:.0f} are not in line with the others: is it bent there, or seen "
                "in a mirror? Photograph that part once more, with its neighbours"
            )
    return ""
