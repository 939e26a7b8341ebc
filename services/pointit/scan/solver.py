"""From sightings to a room: lines in each view, poses of the views, then all in one adjustment."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from pointit.scan.lines import MIN_VIEWS, ImageLine, corners, fit_lines
from pointit.scan.poses import FirstPoses, Piece
from pointit.scan.refinement import refined
from pointit.scan.result import Scan, ScanError
from pointit.scan.results import scan_of
from pointit.scan.sightings import SightingArrays
from pointit.scan.views import CameraView, KnownLength, LampSpec, StripSpec, check_known_length, check_survey

TURNED = (
    "gravity points up in the pictures, so it was taken the other way round: if the camera really was upside "
    "down, turn the pictures"
)
UPSIDE_DOWN = -0.5
"""Component of gravity along the image's y axis, down, below which it contradicts the image."""


def solve(
    strips: Sequence[StripSpec],
    lamps: Sequence[LampSpec],
    views: Sequence[CameraView],
    *,
    known_length: KnownLength | None = None,
) -> Scan:
    """Return the room that the views show.

    The first view with gravity levels the room; without any, most strips are taken as level or upright. Some
    phones and programs give gravity with the opposite sign: since cameras are held upright, or nearly, all
    signs are changed if it points up in most pictures. Lengths come from `known_length`, or else from the
    strips' pitch. Positions and sigmas of the lamps are in `Scan.lamps`.

    Raises:
        ConfigError: If names, numbers or limits are wrong.
        ScanError: If the views determine no room. One sentence: what is seen, and what to do.
    """
    check_survey(tuple(strips), tuple(lamps), tuple(views))
    if known_length is not None:
        check_known_length(known_length, strips, lamps)
    if len(views) < 2:
        raise ScanError("one view determines no room: take photographs from two positions at least")
    pitches = {number: strip.pitch_m for number, strip in enumerate(strips) if strip.pitch_m is not None}
    if not pitches:
        raise ScanError("no strip has a pitch (pixels a metre): without one there is no beginning, give it")
    rng = np.random.default_rng(0)
    specs: list[StripSpec | LampSpec] = [*strips, *lamps]
    seen = SightingArrays.of(strips, lamps, views)
    is_turned = np.nansum(seen.downs[:, 1]) < 0.0
    if is_turned:
        seen.downs[:] *= -1.0
    upside_down = np.flatnonzero(seen.downs[:, 1] < UPSIDE_DOWN)
    seen.downs[upside_down] = np.nan
    bounds: dict[Piece, tuple[float, float]] = {}
    for number, strip in enumerate(strips):
        shown = [seen.of_chain(number, view) for view in range(len(views))]
        knots = [-0.5, *corners(shown, strip.count, rng), strip.count - 0.5]
        bounds |= {(number, index): pair for index, pair in enumerate(pairwise(knots))}
    lines = [_lines_of(seen, view, bounds, rng) for view in range(len(views))]
    if not any(lines):
        raise ScanError("no view shows a strip's pixels in a row: is it a picture of blinking strips?")
    known = [{piece: line for piece, line in each.items() if piece[0] in pitches} for each in lines]
    placed = FirstPoses(seen, known, bounds, pitches).best()
    if placed is None:
        raise ScanError(
            "no two views agree on two strips: take photographs that show the same strips, a step apart"
        )
    found = refined(seen, specs, placed, bounds, lines)
    scan = scan_of(found, strips, lamps, known_length)
    reasons = [TURNED] if is_turned else []
    reasons += [
        f"gravity of view {view + 1} points to the top of its image: not used" for view in upside_down
    ]
    return replace(scan, problems=(*reasons, *scan.problems))


def _lines_of(
    seen: SightingArrays, view: int, bounds: Mapping[Piece, tuple[float, float]], rng: np.random.Generator
) -> dict[Piece, ImageLine]:
    """Return the lines of one view. If a piece is seen twice, the nearer one: a reflection is behind."""
    found: dict[Piece, ImageLine] = {}
    for piece, (low, high) in bounds.items():
        pixels, uv = seen.of_chain(piece[0], view)
        part = (pixels > low) & (pixels < high)
        if part.sum() >= MIN_VIEWS:
            middle = np.array([(low + high) / 2.0])
            candidates = fit_lines(pixels[part], uv[part], rng)
            if candidates:  # nearer for a usual focal length
                found[piece] = min(candidates, key=lambda line: _distance(line, middle))
    return found


def _distance(line: ImageLine, pixel: np.ndarray) -> float:
    return float(np.linalg.norm(line.in_camera(1000.0, 1.0, pixel)))
