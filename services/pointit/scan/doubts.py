"""Reasons to doubt a strip or lamp: seen too little, from too few directions, bent, or another one."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from pointit.scan.bundle import Array
from pointit.scan.refinement import Refined
from pointit.scan.result import ScannedStrip
from pointit.scan.views import StripSpec

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


def doubt(found: Refined, chain: int, middle: Array, sigma_m: float) -> str:
    """Return the reason why a strip or lamp with its middle at `middle` is not identified, or `""`."""
    views = views_of(found, chain)
    if len(views) < 2:
        return "seen from one place only: photograph it from another one"
    sights = middle - found.cameras[views]
    sights /= np.linalg.norm(sights, axis=1, keepdims=True)
    if np.arccos(np.clip((sights @ sights.T).min(), -1.0, 1.0)) < LEAST_PARALLAX_RAD:
        return "seen from one direction only: photograph it from a step further aside"
    if sigma_m > MAX_SIGMA_M:
        return f"its place is uncertain by {sigma_m:.2f} m: photograph it once more, from nearer"
    return "" if chain >= found.seen.strips else _lonely_piece(found, chain) or _disagreement(found, chain)


def _lonely_piece(found: Refined, chain: int) -> str:
    """Return which straight piece of a bent strip is seen by fewer than two views, or `""`."""
    own = found.used & (found.seen.chain == chain)
    for low, high in found.model.bounds[found.model.chain == chain].tolist():
        piece = own & (found.seen.pixel > low) & (found.seen.pixel < high)
        if (np.bincount(found.seen.view[piece], minlength=1) >= LEAST_SIGHTINGS).sum() < 2:
            return (
                f"pixels {max(low, 0):.0f} to {high:.0f}, beyond a corner, are seen from one place only: "
                "photograph them from another one, too"
            )
    return ""


def seen_twice(found: Refined, chain: int) -> tuple[float, float]:
    """Return the first and last pixel of a strip up to which the sightings of two views reach.

    The whole strip counts as unseen, 0 and -1, if there are none.
    """
    own = np.flatnonzero(found.used & (found.seen.chain == chain))
    own = own[np.argsort(found.seen.pixel[own], kind="stable")]
    pixels, views = found.seen.pixel[own], found.seen.view[own]
    ends: list[float] = []
    for order in (np.arange(len(own)), np.arange(len(own))[::-1]):
        for count in range(1, len(own)):
            if len(set(views[order[: count + 1]].tolist())) > 1:
                ends.append(float(pixels[order[count]]))
                break
    return (ends[0], ends[1]) if len(ends) == 2 else (0.0, -1.0)


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


def swapped(scanned: Mapping[str, ScannedStrip], strips: Sequence[StripSpec], factor: float) -> list[str]:
    """Return a sentence for each two strips of which each measures the pitch of the other."""
    known = {strip.name: strip.pitch_m for strip in strips if strip.pitch_m and strip.name in scanned}

    def fits(name: str, pitch_m: float) -> bool:
        return abs(math.log(scanned[name].pitch_m / factor / pitch_m)) < 2 * MAX_STRETCH

    return [
        f"{a!r} and {b!r} look swapped at the controller: each has the pitch of the other"
        for a in known
        for b in known
        if a < b
        and not fits(a, known[a])
        and not fits(b, known[b])
        and abs(math.log(scanned[a].pitch_m * known[a] / scanned[b].pitch_m / known[b])) < 2 * MAX_STRETCH
    ]
