"""Reasons to doubt a strip or lamp: seen too little, from too few directions, bent, or another one."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from pointit.scan.adjustment import Array
from pointit.scan.final_adjustment import Adjusted
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


def views_of(adjusted: Adjusted, chain: int) -> list[int]:
    """Return the views, as numbers in the state, that count for a chain."""
    seen = adjusted.seen
    least = LEAST_SIGHTINGS if chain < seen.strips else 1
    own = adjusted.used & (seen.chain == chain)
    return [index for index, view in enumerate(adjusted.views) if (own & (seen.view == view)).sum() >= least]


def doubt(adjusted: Adjusted, number: int, chain: int, views: Sequence[int], sigma_m: float) -> str:
    """Return the reason why a strip or lamp is not identified, or `""`."""
    if len(views) < 2:
        return "seen from one place only: photograph it from another one"
    if _parallax_rad(adjusted, number, views) < LEAST_PARALLAX_RAD:
        return "seen from one direction only: photograph it from a step further aside"
    if sigma_m > MAX_SIGMA_M:
        return f"its place is uncertain by {sigma_m:.2f} m: photograph it once more, from nearer"
    if chain >= adjusted.seen.strips:
        return ""
    return _lonely_piece(adjusted, number, chain) or _disagreement(adjusted, chain)


def _lonely_piece(adjusted: Adjusted, number: int, chain: int) -> str:
    """Return which straight piece of a bent strip is seen by fewer than two views, or `""`."""
    first, last = adjusted.adjustment.layout.first[number : number + 2]
    own = adjusted.used & (adjusted.seen.chain == chain)
    for low, high in pairwise(adjusted.state.knots[first:last]):
        piece = own & (adjusted.seen.pixel > low) & (adjusted.seen.pixel < high)
        counts = np.bincount(adjusted.seen.view[piece], minlength=1)
        if (counts >= LEAST_SIGHTINGS).sum() < 2:
            return (
                f"pixels {max(low, 0):.0f} to {high:.0f}, beyond a corner, are seen from one place only: "
                "photograph them from another one, too"
            )
    return ""


def seen_twice(adjusted: Adjusted, chain: int) -> tuple[float, float]:
    """Return the first and last pixel of a strip up to which the sightings of two views reach.

    The whole strip counts as unseen, 0 and -1, if there are none.
    """
    own = np.flatnonzero(adjusted.used & (adjusted.seen.chain == chain))
    own = own[np.argsort(adjusted.seen.pixel[own], kind="stable")]
    pixels, views = adjusted.seen.pixel[own], adjusted.seen.view[own]
    ends: list[float] = []
    for order in (np.arange(len(own)), np.arange(len(own))[::-1]):
        for count in range(1, len(own)):
            if len(set(views[order[: count + 1]].tolist())) > 1:
                ends.append(float(pixels[order[count]]))
                break
    return (ends[0], ends[1]) if len(ends) == 2 else (0.0, -1.0)


def _disagreement(adjusted: Adjusted, chain: int) -> str:
    """Return which part of a strip is not where its line has it, or `""`."""
    seen = adjusted.seen
    shown = (seen.chain == chain) & np.isin(seen.view, adjusted.views)
    pairs, inverse = np.unique(np.column_stack([seen.pixel, seen.view])[shown], axis=0, return_inverse=True)
    agrees = np.bincount(inverse.ravel(), adjusted.used[shown]) > 0  # a pixel and its reflection are one
    bounds: list[float] = np.linspace(float(pairs[0, 0]), float(pairs[-1, 0]), WINDOWS + 1).tolist()
    for low, high in zip(bounds[:-2], bounds[2:], strict=True):
        window = (pairs[:, 0] >= low) & (pairs[:, 0] <= high)
        if window.sum() >= LEAST_IN_WINDOW and agrees[window].mean() < LEAST_SHARE:
            return (
                f"pixels {low:.0f} to {high:.0f} are not in line with the others: is it bent there, or seen "
                "in a mirror? Photograph that part once more, with its neighbours"
            )
    return ""


def _parallax_rad(adjusted: Adjusted, number: int, views: Sequence[int]) -> float:
    """Return the largest angle between two lines of sight to the middle of a chain."""
    state, layout = adjusted.state, adjusted.adjustment.layout
    middle = state.vertices[layout.first[number] : layout.first[number + 1]].mean(axis=0)
    sights: list[Array] = []
    for index in views:
        sight = middle + state.rotations[index].T @ state.translations[index]
        sights.append(sight / np.linalg.norm(sight))
    cosines = np.array(sights) @ np.array(sights).T
    return float(np.arccos(np.clip(cosines.min(), -1.0, 1.0)))


def swapped(found: Mapping[str, ScannedStrip], strips: Sequence[StripSpec], factor: float) -> list[str]:
    """Return a sentence for each two strips of which each measures the pitch of the other."""
    known = {strip.name: strip.pitch_m for strip in strips if strip.pitch_m and strip.name in found}

    def fits(name: str, pitch_m: float) -> bool:
        return abs(math.log(found[name].pitch_m / factor / pitch_m)) < 2 * MAX_STRETCH

    return [
        f"{a!r} and {b!r} look swapped at the controller: each has the pitch of the other"
        for a in known
        for b in known
        if a < b
        and not fits(a, known[a])
        and not fits(b, known[b])
        and abs(math.log(found[a].pitch_m * known[a] / found[b].pitch_m / known[b])) < 2 * MAX_STRETCH
    ]
