"""From sightings to a room: lines in each view, poses of the views, then all in one adjustment."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from pointit.scan.adjustment import Array, State, project
from pointit.scan.final_adjustment import Adjusted, FinalAdjustment, Seen
from pointit.scan.first_poses import FirstPoses, Piece, Placed
from pointit.scan.lines import LEAST, ImageLine, corners, fit_lines
from pointit.scan.result import Scan, ScanError
from pointit.scan.results import scan_of
from pointit.scan.views import KnownLength, LampSpec, StripSpec, View, check_known_length, check_survey

MAX_MARKS = 60
"""Maximum number of different pixels of one strip that are used of one view."""
ELSEWHERE_PX = 25.0
"""Distance in the image from which a strip is seen elsewhere than where it is placed."""
NEARER = 0.85
"""Ratio of distances from which a strip is seen nearer than where it is placed."""
UNKNOWN_PITCHES_M = np.geomspace(0.004, 0.12, 80)


def solve(
    strips: Sequence[StripSpec],
    lamps: Sequence[LampSpec],
    views: Sequence[View],
    *,
    known_length: KnownLength | None = None,
) -> Scan:
    """Return the room that the views show.

    The first view with gravity levels the room; without any, most strips are taken as level or upright.
    Lengths come from `known_length`, or else from the strips' pitch. `Scan.lamps` has the positions and sigmas
    of the lamps.

    Raises:
        ConfigError: If names, numbers or limits are wrong.
        ScanError: If the views determine no room. One sentence: what is seen, and what to do.
    """
    check_survey(tuple(strips), tuple(lamps), tuple(views))
    if known_length is not None:
        check_known_length(known_length, strips, lamps)
    if len(views) < 2:
        raise ScanError("one view determines no room: take photographs from two positions at least")
    if all(strip.pitch_m is None for strip in strips):
        raise ScanError("no strip has a pitch (pixels a metre): without one there is no beginning, give it")
    rng = np.random.default_rng(0)
    seen = Seen.of(strips, lamps, views, MAX_MARKS)
    knots = {
        number: [-0.5, *corners(seen.of_strip(number), strip.count, rng), strip.count - 0.5]
        for number, strip in enumerate(strips)
    }
    lines = [_lines_of(seen, view, knots, rng) for view in range(len(views))]
    if not any(lines):
        raise ScanError("no view shows a strip's pixels in a row: is it a picture of blinking strips?")
    pitches = {number: strip.pitch_m for number, strip in enumerate(strips) if strip.pitch_m is not None}
    side = float(max(views[0].width, views[0].height))
    known = [{piece: line for piece, line in each.items() if piece[0] in pitches} for each in lines]
    placed = FirstPoses(known, pitches, seen.downs, side).best()
    if placed is None or len(placed.views) < 2 or placed.good < 0.3 * placed.of:
        raise ScanError(
            "no two views agree on two strips: take photographs that show the same strips, a step apart"
        )
    final = FinalAdjustment(seen, strips, lamps, side)
    starts = _chains(placed, knots)
    _add_unknown_pitches(starts, placed, strips, knots, lines)
    adjusted = final.adjusted(placed, starts)
    return scan_of(adjusted, strips, lamps, known_length, _reflections(adjusted, lines, pitches))


def _lines_of(
    seen: Seen, view: int, knots: Mapping[int, Sequence[float]], rng: np.random.Generator
) -> dict[Piece, ImageLine]:
    """Return the lines of one view. If a piece is seen twice, the nearer one: a reflection is behind."""
    found: dict[Piece, ImageLine] = {}
    for strip, places in knots.items():
        pixels, uv = seen.of_strip(strip)[view]
        for number, (low, high) in enumerate(pairwise(places)):
            part = (pixels > low) & (pixels < high)
            if part.sum() >= LEAST:
                candidates = fit_lines(pixels[part], uv[part], rng)
                if candidates:
                    found[strip, number] = min(candidates, key=lambda line: _distance(line, low, high))
    return found


def _distance(line: ImageLine, low: float, high: float) -> float:
    """Return the distance of a piece's middle in units of its pitch, for a usual focal length."""
    start, step = line.in_camera(1000.0, 1.0)
    return float(np.linalg.norm(start + (low + high) / 2.0 * step))


def _reflections(
    adjusted: Adjusted, lines: Sequence[Mapping[Piece, ImageLine]], pitches_m: Mapping[int, float]
) -> frozenset[int]:
    """Return the strips that a view has elsewhere and nearer: what the other views saw was a reflection."""
    state = adjusted.state
    found: set[int] = set()
    for index, view in enumerate(adjusted.views):
        for (strip, _), line in lines[view].items():
            if strip not in adjusted.chains or strip not in pitches_m:
                continue
            chain = np.full(len(line.pixels), adjusted.chains.index(strip))
            images, depths = adjusted.adjustment.images(state, np.full_like(chain, index), chain, line.pixels)
            start, step = line.in_camera(float(np.exp(state.log_focal)), pitches_m[strip])
            nearness = (start + line.pixels[:, None] * step)[:, 2] / np.maximum(depths, 1e-3)
            is_elsewhere = np.median(np.linalg.norm(images - line.uv, axis=1)) > ELSEWHERE_PX
            if is_elsewhere and (np.median(nearness) < NEARER or np.median(depths) < 0):
                found.add(strip)
    return frozenset(found)


def _chains(placed: Placed, knots: Mapping[int, Sequence[float]]) -> dict[int, tuple[Array, Array]]:
    """Return vertices and knots of each strip of which a piece has a place; ends are extrapolated."""
    chains: dict[int, tuple[Array, Array]] = {}
    for strip, places in knots.items():
        vertices: list[list[Array]] = [[] for _ in places]
        for number in range(len(places) - 1):
            if (strip, number) in placed.pieces:
                first = 2 * placed.pieces.index((strip, number))
                a, b = placed.state.vertices[first : first + 2]
                low, high = placed.state.knots[first : first + 2]
                for place in (number, number + 1):
                    vertices[place].append(a + (places[place] - low) / (high - low) * (b - a))
        known = [index for index, each in enumerate(vertices) if each]
        if known:
            means = np.array([np.mean(vertices[index], axis=0) for index in known])
            grid = np.array(places)
            filled = np.column_stack(
                [np.interp(np.arange(len(places)), known, means[:, axis]) for axis in range(3)]
            )
            for index in range(len(places)):  # a piece that was never seen continues its neighbour
                if index > known[-1]:
                    a, b = known[-2], known[-1]
                elif index < known[0]:
                    a, b = known[1], known[0]
                else:
                    continue
                filled[index] += (grid[index] - grid[b]) / (grid[b] - grid[a]) * (filled[b] - filled[a])
            chains[strip] = (filled, grid)
    return chains


def _add_unknown_pitches(
    chains: dict[int, tuple[Array, Array]],
    placed: Placed,
    strips: Sequence[StripSpec],
    knots: Mapping[int, Sequence[float]],
    lines: Sequence[Mapping[Piece, ImageLine]],
) -> None:
    """Add strips of unknown pitch: that with which one view predicts the images of the others best."""
    state = placed.state
    for strip, spec in enumerate(strips):
        if spec.pitch_m is not None or len(knots[strip]) > 2:
            continue
        having = [index for index, view in enumerate(placed.views) if (strip, 0) in lines[view]]
        if len(having) < 2:
            continue
        best = max(having, key=lambda index: lines[placed.views[index]][strip, 0].extent_px)
        line = lines[placed.views[best]][strip, 0]
        ends = np.array([line.pixels.min(), line.pixels.max()])
        found: list[tuple[float, Array]] = []
        for pitch_m in UNKNOWN_PITCHES_M:
            start, step = line.in_camera(float(np.exp(state.log_focal)), float(pitch_m))
            there = (start + ends[:, None] * step - state.translations[best]) @ state.rotations[best]
            error = sum(
                float(
                    np.linalg.norm(
                        _image(state, index, there) - lines[placed.views[index]][strip, 0].at(ends)
                    )
                )
                for index in having
                if index != best
            )
            grid = np.array(knots[strip])
            share = ((grid - ends[0]) / (ends[1] - ends[0]))[:, None]
            found.append((error, there[0] + share * (there[1] - there[0])))
        chains[strip] = (min(found, key=lambda each: each[0])[1], np.array(knots[strip]))


def _image(state: State, view: int, points: Array) -> Array:
    return project(state, np.full(len(points), view), points)[0]
