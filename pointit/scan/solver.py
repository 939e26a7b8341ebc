"""From sightings to a room: lines, poses, then all in one adjustment."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from pointit.geometry.array_types import Array
from pointit.runtime.errors import ConfigError
from pointit.scan.bundle import GRAVITY_SIGMA, vec3, vertex_blocks
from pointit.scan.lines import MIN_VIEWS, ImageLine, corners, fit_lines
from pointit.scan.poses import PITCH_SIGMA, FirstPoses, Piece, SightingArrays, levelled, upright
from pointit.scan.refinement import Refined, refined
from pointit.scan.result import Camera, Scan, ScanError, ScannedLamp, ScannedStrip
from pointit.scan.views import CameraView, KnownLength, LampSpec, StripSpec, check_known_length, check_survey

MIN_PARALLAX_RAD = math.radians(4.0)
MIN_SIGHTINGS = 3
"""Minimum number of pixels for a view to count for a strip."""
MAX_SIGMA_M = 0.03
"""Largest sigma with which a strip counts as identified."""
MAX_STRETCH = 0.04
"""Relative difference of a measured pitch from the stated one of a strip."""
MIN_SIGMA_M = 0.001
MAX_UNSEEN = 0.1
"""Share of a strip's pixels, at an end, that may be unseen."""
WIDEST_GAP = 0.12
"""Distance of the marked pixels of a strip, as a share of its pixels."""
UNSEEN_SIGMA = 0.1
"""Standard deviation of an end that was never seen, as a share of the unseen length: it may bend."""
STRIPS_LEVEL_SIGMA = math.radians(1.5)
"""Standard deviation of a level that is taken from the strips."""
MAX_RATIO = 10.0
"""Ratio of a known length and the pitches, either way, from which one of them is wrong."""


def scan_of(
    refined: Refined, strips: Sequence[StripSpec], lamps: Sequence[LampSpec], known_length: KnownLength | None
) -> Scan:
    """Return the scan of an adjustment; `known_length` scales it."""
    specs: list[StripSpec | LampSpec] = [*strips, *lamps]
    state = refined.state
    seen = refined.seen

    # Into a frame that is level and of the right size, with the lowest vertex at z = 0.
    turn, level_sigma, level_from = _level(refined)
    factor, scale_sigma, scale_from = _scale(refined, specs, known_length)
    vertices, covariance, chain_of = refined.vertices([strip.count for strip in strips])
    vertices = factor * vertices @ turn.T
    block = np.kron(np.eye(len(vertices)), turn)
    covariance = block @ covariance @ block.T
    covariance = factor**2 * _beside_each_other(covariance, vertices)
    lowest_m = vertices[:, 2].min()
    shift = np.array([0.0, 0.0, -lowest_m])
    vertices += shift

    # A chain of vertices is a strip, or a single one is a lamp.
    found_strips: dict[str, ScannedStrip] = {}
    found_lamps: dict[str, ScannedLamp] = {}
    chains: list[int] = np.unique(chain_of).tolist()
    for chain in chains:
        own = np.flatnonzero(chain_of == chain)
        views = len(_views_of(refined, chain))
        coordinates = 3 * own[:, None] + np.arange(3)
        rows = coordinates.ravel()
        line = vertices[own]
        spread = covariance[np.ix_(rows, rows)]
        name = specs[chain].name
        if chain >= len(strips):
            sigma = _sigma(spread, views)
            reason = _uncertainty_reason(refined, chain, sigma)
            found_lamps[name] = ScannedLamp(
                name=name,
                position_m=vec3(line[0]),
                sigma_m=sigma,
                views=views,
                identified=not reason,
                reason=reason,
                covariance=spread,
            )
        else:
            found_strips[name] = _strip(refined, chain, strips, line, spread)
    found_names = found_strips.keys() | found_lamps.keys()
    missing = tuple(spec.name for spec in specs if spec.name not in found_names)

    problems: list[str] = []
    for view in range(len(seen.downs)):
        if view not in refined.views:
            problems.append(
                f"view {view + 1} agrees with no other: move less between photographs, and hold still"
            )
    for name in missing:
        problems.append(f"{name!r} is not seen from two places: photograph it once more")
    if abs(math.log(factor)) > MAX_STRETCH:
        larger = "larger" if factor > 1 else "smaller"
        problems.append(
            f"the known length makes all pitches {abs(factor - 1.0):.0%} {larger} than given: measure it "
            "again, or correct the pitches"
        )

    cameras: list[Camera | None] = [None] * len(seen.downs)
    for index, view in enumerate(refined.views):
        rotation = state.rotations[index] @ turn.T
        translation_m = factor * state.translations[index] - rotation @ shift
        cameras[view] = Camera(rotation, translation_m)
    return Scan(
        cameras=tuple(cameras),
        focal_px=math.exp(state.log_focal),
        distortion=state.distortion,
        strips=found_strips,
        lamps=found_lamps,
        level_sigma_rad=level_sigma,
        level_from=level_from,
        scale_sigma=scale_sigma,
        scale_from=scale_from,
        missing=missing,
        problems=tuple(problems),
    )


def _level(refined: Refined) -> tuple[Array, float, str]:
    """Return the rotation into a level frame, its standard deviation per axis, rad, and its source."""
    state = refined.state

    # The adjustment has levelled the frame by gravity already: what is left is its error.
    down = refined.bundle.down
    has_gravity = np.isfinite(down[:, 0])
    if has_gravity.any():
        rotations = state.rotations[has_gravity]
        room_down: Array = np.einsum("vij,vi->vj", rotations, down[has_gravity])
        level_parts = room_down[:, :2]
        rms = float(np.sqrt(np.mean(level_parts**2)))
        view_sigma = max(rms, GRAVITY_SIGMA / 2.0)
        sigma = view_sigma / math.sqrt(has_gravity.sum())
        return np.eye(3), sigma, "gravity"

    # Without it, most strips are level or upright.
    ends = state.ends[refined.model.chain < refined.seen.strips]
    edges = ends[:, 1] - ends[:, 0]
    lengths = np.linalg.norm(edges, axis=1)
    up = -state.rotations[:, 1].mean(axis=0)  # cameras are held upright, or nearly
    up /= np.linalg.norm(up)
    if len(edges) < 2:
        return upright(up), math.radians(15.0), "strips"
    directions = edges / lengths[:, None]
    return levelled(directions, lengths, up), STRIPS_LEVEL_SIGMA, "strips"


def _scale(
    refined: Refined, specs: Sequence[StripSpec | LampSpec], known: KnownLength | None
) -> tuple[float, float, str]:
    """Return the factor for all lengths, its relative standard deviation, and its source."""
    if known is None:
        return 1.0, PITCH_SIGMA, "pitch"
    names = [spec.name for spec in specs]
    points: list[Array] = []
    for mark in (known.start, known.end):
        chain = names.index(mark.name)
        if chain not in refined.model.chain:
            raise ConfigError(f"the known length is at {mark.name!r}, which the views do not determine")
        pixels = np.array([float(mark.pixel)])
        points.append(refined.places(chain, pixels)[0])
    start, end = points
    measured_m = float(np.linalg.norm(end - start))
    factor = known.metres / measured_m
    if not 1.0 / MAX_RATIO < factor < MAX_RATIO:
        raise ConfigError(
            f"the known length of {known.metres:g} m is {measured_m:.3g} m by the pitches: measure it again, "
            "or correct the pitches"
        )
    sigma = math.hypot(known.sigma_m / known.metres, 0.001)
    return factor, sigma, "length"


def _beside_each_other(covariance: Array, vertices: Array) -> Array:
    """Return the covariance of the vertices beside each other: of no position, heading, level and scale.

    Badly determined vertices count less for that reference (an S-transformation, weighted).
    """
    # Movements of all vertices together that change no distance between them but by scale.
    centred = vertices - vertices.mean(axis=0)
    x, y, z = centred.T
    zero = np.zeros_like(x)
    rotations = np.array([[zero, z, -y], [-z, zero, x], [y, -x, zero]])
    gauge = np.zeros((len(vertices), 3, 7))
    gauge[:, :, :3] = np.eye(3)
    gauge[:, :, 3:6] = rotations.transpose(2, 0, 1)
    gauge[:, :, 6] = centred
    flat = gauge.reshape(-1, 7)

    # The weights follow from the result, and the result from the weights: three rounds suffice.
    weights = np.ones(len(vertices))
    result = covariance
    for _ in range(3):
        weighted = np.repeat(weights, 3)[:, None] * flat
        inverse = np.linalg.pinv(weighted.T @ flat)
        movement = flat @ inverse @ weighted.T
        shape = np.eye(len(flat)) - movement
        result = shape @ covariance @ shape.T
        spread = result.reshape(len(vertices), 3, len(vertices), 3)
        variance = np.einsum("viwi->vw", spread).diagonal()
        weights = 1.0 / (variance + 0.005**2)
    return np.asarray(result)


def _sigma(covariance: Array, views: int) -> float:
    """Return the largest standard deviation of a vertex; few views hardly notice their outliers."""
    variances = [float(np.linalg.eigvalsh(block)[-1]) for block in vertex_blocks(covariance)]
    largest = max(variances)
    few_views = 1.0 + 2.0 / max(views - 1, 1)
    sigma_m = math.sqrt(max(largest, 0.0) * few_views)
    return math.hypot(sigma_m, MIN_SIGMA_M)


def _views_of(refined: Refined, chain: int) -> list[int]:
    """Return the views, as numbers in the state, that count for a chain."""
    min_sightings = MIN_SIGHTINGS if chain < refined.seen.strips else 1
    own = refined.used & (refined.seen.chain == chain)
    counts = np.bincount(refined.seen.view[own], minlength=64)
    return [index for index, view in enumerate(refined.views) if counts[view] >= min_sightings]


def _uncertainty_reason(refined: Refined, chain: int, sigma_m: float) -> str:
    """Return the reason why a strip or lamp is not identified, or `""`."""
    views = _views_of(refined, chain)
    if len(views) < 2:
        return "seen from one place only: photograph it from another one"
    ends = refined.state.ends[refined.model.chain == chain]
    middle = ends[0, 0]
    if chain < refined.seen.strips:
        middle = ends.mean(axis=(0, 1))
    sights = middle - refined.cameras[views]
    sights /= np.linalg.norm(sights, axis=1, keepdims=True)
    cosines = sights @ sights.T
    parallax_rad = np.arccos(np.clip(cosines.min(), -1.0, 1.0))
    if parallax_rad < MIN_PARALLAX_RAD:
        return "seen from one direction only: photograph it from a step further aside"
    if sigma_m > MAX_SIGMA_M:
        return f"its place is uncertain by {sigma_m:.2f} m: photograph it once more, from nearer"
    return ""


def _unseen(refined: Refined, chain: int, count: int) -> tuple[float, float]:
    """Return the first and last pixel of the longest part of a strip of `count` that no two views show.

    It is an end of the strip, or a straight piece.
    """
    # Its pixels in each view that shows it.
    seen = refined.seen
    is_own = refined.used & (seen.chain == chain)
    shown: list[Array] = []
    for view in refined.views:
        pixels = seen.pixel[is_own & (seen.view == view)]
        if len(pixels):
            shown.append(pixels)

    # Its ends: before the second first pixel, and behind the last but one.
    parts: list[tuple[float, float]] = []
    if len(shown) > 1:
        firsts = sorted(pixels.min() for pixels in shown)
        lasts = sorted(pixels.max() for pixels in shown)
        parts.append((0.0, float(firsts[1]) - 1.0))
        parts.append((float(lasts[-2]) + 1.0, count - 1.0))

    # Its straight pieces.
    bounds = refined.model.bounds[refined.model.chain == chain]
    bends: list[float] = bounds[:-1, 1].tolist()
    for low, high in pairwise([-0.5, *bends, count - 0.5]):
        counts = [((pixels > low) & (pixels < high)).sum() for pixels in shown]
        view_count = sum(number >= MIN_SIGHTINGS for number in counts)
        if view_count < 2:
            parts.append((low + 0.5, high - 0.5))
    return max(parts, key=lambda part: part[1] - part[0])


def _strip(
    refined: Refined, chain: int, strips: Sequence[StripSpec], line: Array, covariance: Array
) -> ScannedStrip:
    """Return a strip of which `line` are the vertices. The first reason that is found is given."""
    spec = strips[chain]
    views = len(_views_of(refined, chain))
    edge_lengths_m = np.linalg.norm(np.diff(line, axis=0), axis=1)
    pitch_m = float(edge_lengths_m.sum()) / spec.count
    sigma_m = _sigma(covariance, views)
    reason = _uncertainty_reason(refined, chain, sigma_m)
    alike = [other for other in strips if _has_pitch(other, pitch_m)]
    alike = [other for other in alike if other is not spec]

    # A part that was never seen makes it less certain. If it is the end, another strip may end there.
    low, high = _unseen(refined, chain, spec.count)
    if high - low + 1.0 > max(2.0, MAX_UNSEEN * spec.count):
        unseen_sigma_m = UNSEEN_SIGMA * (high - low) * pitch_m
        sigma_m = math.hypot(sigma_m, unseen_sigma_m)
        ends_there: list[StripSpec] = []
        if high == spec.count - 1.0:
            gap = WIDEST_GAP * spec.count
            ends_there = [other for other in alike if 0.0 <= other.count - low <= gap]
        reason = reason or (
            f"no two views show pixels {low:.0f} to {high:.0f}: photograph that part, or correct its count"
            f"{_swapped(ends_there)}"
        )

    # Its pitch against the stated one.
    stretches = refined.bundle.stretch(refined.state)
    own_stretches = stretches[refined.model.chain == chain]
    if spec.pitch_m is not None and np.abs(own_stretches).max() > MAX_STRETCH:
        measured = f"{1.0 / pitch_m:.0f} pixels a metre"
        reason = reason or (
            f"it measures {measured} and is said to have {1.0 / spec.pitch_m:.0f}: "
            f"correct its pitch{_swapped(alike)}"
        )
    return ScannedStrip(
        name=spec.name,
        count=spec.count,
        line_m=tuple(vec3(vertex) for vertex in line),
        sigma_m=sigma_m,
        pitch_m=pitch_m,
        views=views,
        identified=not reason,
        reason=reason,
        covariance=covariance,
    )


def _has_pitch(strip: StripSpec, pitch_m: float) -> bool:
    """Return True if a strip is said to have about this pitch."""
    return bool(strip.pitch_m) and abs(math.log(strip.pitch_m / pitch_m)) < MAX_STRETCH


def _swapped(others: Sequence[StripSpec]) -> str:
    """Return the end of a sentence about a strip that may be another one, or `""`."""
    names = [f"{other.name!r} ({other.count} pixels)" for other in others[:2]]
    candidates = " or ".join(names)
    return f", or is it {candidates}, swapped at the controller?" if candidates else ""


def solve(
    strips: Sequence[StripSpec],
    lamps: Sequence[LampSpec],
    views: Sequence[CameraView],
    *,
    known_length: KnownLength | None = None,
) -> Scan:
    """Return the room that the views show.

    The first view with gravity levels the room; without any, most strips are taken as level or upright.
    Lengths come from `known_length`, or else from the strips' pitch. Positions and sigmas of the lamps are in
    `Scan.lamps`.

    Raises:
        ConfigError: If names, numbers or limits are wrong.
        ScanError: If the views determine no room. The message has the cause and the remedy.
    """
    check_survey(tuple(strips), tuple(lamps), tuple(views))
    if known_length is not None:
        check_known_length(known_length, strips, lamps)
    if len(views) < 2:
        raise ScanError("one view determines no room: take photographs from two positions at least")
    pitches = {number: strip.pitch_m for number, strip in enumerate(strips) if strip.pitch_m is not None}
    if not pitches:
        raise ScanError("no strip has a pitch (pixels a metre): without one there is no beginning, give it")

    # Straight pieces of strips, and their lines in each view.
    rng = np.random.default_rng(0)
    specs: list[StripSpec | LampSpec] = [*strips, *lamps]
    seen = SightingArrays.of(strips, lamps, views)
    bounds: dict[Piece, tuple[float, float]] = {}
    for number, strip in enumerate(strips):
        shown = [seen.of_chain(number, view) for view in range(len(views))]
        bends = corners(shown, strip.count, rng)
        for index, pair in enumerate(pairwise([-0.5, *bends, strip.count - 0.5])):
            bounds[number, index] = pair
    lines = [_lines_of(seen, view, bounds, rng) for view in range(len(views))]
    if not any(lines):
        raise ScanError("no view shows a strip's pixels in a row: is it a picture of blinking strips?")

    # First poses from strips of known pitch, then the adjustment of everything.
    known_lines: list[dict[Piece, ImageLine]] = []
    for view_lines in lines:
        known = {piece: line for piece, line in view_lines.items() if piece[0] in pitches}
        known_lines.append(known)
    placed = FirstPoses(seen, known_lines, bounds, pitches).best()
    if placed is None:
        raise ScanError(
            "no two views agree on two strips: take photographs that show the same strips, a step apart"
        )
    adjustment = refined(seen, specs, placed, bounds, lines)
    return scan_of(adjustment, strips, lamps, known_length)


def _lines_of(
    seen: SightingArrays, view: int, bounds: Mapping[Piece, tuple[float, float]], rng: np.random.Generator
) -> dict[Piece, ImageLine]:
    """Return the lines of one view. If a piece is seen twice, the nearer one: a reflection is behind."""
    line_by_piece: dict[Piece, ImageLine] = {}
    for piece, (low, high) in bounds.items():
        chain, _ = piece
        pixels, uv = seen.of_chain(chain, view)
        part = (pixels > low) & (pixels < high)
        if part.sum() < MIN_VIEWS:
            continue
        candidates = fit_lines(pixels[part], uv[part], rng)
        middle = (low + high) / 2.0
        if candidates:
            line_by_piece[piece] = min(candidates, key=lambda line: _distance(line, middle))
    return line_by_piece


def _distance(line: ImageLine, pixel: float) -> float:
    """Return the distance of a pixel for a usual focal length, without a scale."""
    position = line.in_camera(focal_px=1000.0, pitch_m=1.0, pixels=np.array([pixel]))
    return float(np.linalg.norm(position))
