"""From an adjustment to a scan: covariance, what is identified, level, scale, and sentences."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from pointit.geometry.vector import Vec3
from pointit.runtime.errors import ConfigError
from pointit.scan.adjustment import PITCH_SIGMA, Array
from pointit.scan.alignment import levelled, upright
from pointit.scan.doubts import MAX_STRETCH, doubt, seen_twice, swapped, views_of
from pointit.scan.final_adjustment import Adjusted
from pointit.scan.result import Camera, Scan, ScannedLamp, ScannedStrip
from pointit.scan.views import KnownLength, LampSpec, StripSpec

LEAST_SIGMA_M = 0.001
MAX_UNSEEN = 0.1
"""Share of a strip's pixels, at an end, that may be unseen."""
UNSEEN_SIGMA = 0.1
"""Standard deviation of an end that was never seen, as a share of the unseen length: it may bend."""
STRAIGHT_RAD = math.radians(2.5)
STRIPS_LEVEL_SIGMA = math.radians(1.5)
"""Standard deviation of a level that is taken from the strips."""
SCALE_SIGMA = PITCH_SIGMA
MAX_RATIO = 10.0
"""Ratio of a known length and the pitches, either way, from which one of them is wrong."""
REFLECTED = "one view has it elsewhere and nearer: the others may show a mirror image, cover the mirror"


def scan_of(
    adjusted: Adjusted,
    strips: Sequence[StripSpec],
    lamps: Sequence[LampSpec],
    known_length: KnownLength | None,
    reflections: frozenset[int],
) -> Scan:
    """Return the scan of an adjustment; `known_length` scales it; `reflections` are numbers of strips."""
    specs: list[StripSpec | LampSpec] = [*strips, *lamps]
    state, layout = adjusted.state, adjusted.adjustment.layout
    turn, level_sigma, level_from = _level(adjusted)
    factor, scale_sigma, scale_from = _scale(adjusted, specs, known_length)
    vertices = factor * state.vertices @ turn.T
    block = np.kron(np.eye(len(vertices)), turn)
    covariance = adjusted.adjustment.covariance(state, adjusted.loss_px, adjusted.noise_px)
    covariance = factor**2 * _beside_each_other(block @ covariance @ block.T, vertices)
    vertices -= [0.0, 0.0, vertices[:, 2].min()]
    shift = vertices[0] - factor * turn @ state.vertices[0]
    found_strips: dict[str, ScannedStrip] = {}
    found_lamps: dict[str, ScannedLamp] = {}
    problems = [
        f"view {view + 1} agrees with no other: move less between photographs, and hold still"
        for view in range(len(adjusted.seen.downs))
        if view not in adjusted.views
    ]
    for number, chain in enumerate(adjusted.chains):
        part = slice(int(layout.first[number]), int(layout.first[number + 1]))
        rows = np.arange(3 * part.start, 3 * part.stop)
        own = covariance[np.ix_(rows, rows)]
        views = views_of(adjusted, chain)
        if chain >= len(strips):
            lamp = lamps[chain - len(strips)]
            sigma = _sigma(own, len(views))
            reason = doubt(adjusted, number, chain, views, sigma)
            found_lamps[lamp.name] = ScannedLamp(
                lamp.name, _vec3(vertices[part.start]), sigma, len(views), not reason, reason, own
            )
        else:
            strip = strips[chain]
            found = _strip(adjusted, number, strip, vertices[part], own)
            if chain in reflections and found.identified:
                found = replace(found, identified=False, reason=REFLECTED)
            found_strips[strip.name] = found
    missing = tuple(
        spec.name for spec in specs if spec.name not in found_strips and spec.name not in found_lamps
    )
    problems += [f"{name!r} is not seen from two places: photograph it once more" for name in missing]
    problems += swapped(found_strips, strips, factor)
    if abs(math.log(factor)) > MAX_STRETCH:
        problems.append(
            f"the known length makes all pitches {abs(factor - 1.0):.0%} "
            f"{'larger' if factor > 1 else 'smaller'} than given: measure it again, or correct the pitches"
        )
    cameras: list[Camera | None] = [None] * len(adjusted.seen.downs)
    for index, view in enumerate(adjusted.views):
        rotation = state.rotations[index] @ turn.T
        cameras[view] = Camera(rotation, factor * state.translations[index] - rotation @ shift)
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
        noise_px=adjusted.noise_px,
        missing=missing,
        problems=tuple(problems),
    )


def _level(adjusted: Adjusted) -> tuple[Array, float, str]:
    """Return the rotation into a level frame, its standard deviation per axis, rad, and its source."""
    state, layout = adjusted.state, adjusted.adjustment.layout
    sigma = adjusted.adjustment.tilt(state)
    if math.isfinite(sigma):
        return np.eye(3), sigma, "gravity"
    edges = np.concatenate(
        [np.diff(state.vertices[a:b], axis=0) for a, b in pairwise(layout.first) if b - a > 1]
    )
    lengths = np.linalg.norm(edges, axis=1)
    up = -state.rotations[:, 1].mean(axis=0)  # cameras are held upright, or nearly
    up /= np.linalg.norm(up)
    if len(edges) < 2:
        return upright(up), math.radians(15.0), "strips"
    return levelled(edges / lengths[:, None], lengths, up), STRIPS_LEVEL_SIGMA, "strips"


def _scale(
    adjusted: Adjusted, specs: Sequence[StripSpec | LampSpec], known: KnownLength | None
) -> tuple[float, float, str]:
    """Return the factor for all lengths, its relative standard deviation, and its source."""
    if known is None:
        return 1.0, SCALE_SIGMA, "pitch"
    names = [specs[chain].name for chain in adjusted.chains]
    for mark in (known.start, known.end):
        if mark.name not in names:
            raise ConfigError(f"the known length is at {mark.name!r}, which the views do not determine")
    chain = np.array([names.index(mark.name) for mark in (known.start, known.end)], dtype=np.intp)
    pixel = np.array([known.start.pixel, known.end.pixel], dtype=np.float64)
    a, b = adjusted.adjustment.places(adjusted.state, chain, pixel)[0]
    measured_m = float(np.linalg.norm(b - a))
    if not 1.0 / MAX_RATIO < known.metres / measured_m < MAX_RATIO:
        raise ConfigError(
            f"the known length of {known.metres:g} m is {measured_m:.3g} m by the pitches: measure it again, "
            "or correct the pitches"
        )
    return known.metres / measured_m, math.hypot(known.sigma_m / known.metres, 0.001), "length"


def _beside_each_other(covariance: Array, vertices: Array) -> Array:
    """Return the covariance of the vertices beside each other: of no position, heading, level and scale.

    Badly determined vertices count less for that reference (an S-transformation, weighted).
    """
    centred = vertices - vertices.mean(axis=0)
    gauge = np.zeros((len(vertices), 3, 7))
    gauge[:, :, :3] = np.eye(3)
    x, y, z = centred.T
    zero = np.zeros_like(x)
    gauge[:, :, 3:6] = np.array([[zero, z, -y], [-z, zero, x], [y, -x, zero]]).transpose(2, 0, 1)
    gauge[:, :, 6] = centred
    flat = gauge.reshape(-1, 7)
    weights = np.ones(len(vertices))
    result = covariance
    for _ in range(3):
        weighted = np.repeat(weights, 3)[:, None] * flat
        shape = np.eye(len(flat)) - flat @ np.linalg.pinv(weighted.T @ flat) @ weighted.T
        result = shape @ covariance @ shape.T
        spread = result.reshape(len(vertices), 3, len(vertices), 3)
        variance = np.einsum("viwi->vw", spread).diagonal()
        weights = 1.0 / (variance + 0.005**2)
    return np.asarray(result)


def _sigma(covariance: Array, views: int) -> float:
    """Return the largest standard deviation of a vertex; few views hardly notice their outliers."""
    blocks = [covariance[row : row + 3, row : row + 3] for row in range(0, len(covariance), 3)]
    largest = max(float(np.linalg.eigvalsh(block)[-1]) for block in blocks)
    return math.hypot(math.sqrt(max(largest, 0.0) * (1.0 + 2.0 / max(views - 1, 1))), LEAST_SIGMA_M)


def _strip(
    adjusted: Adjusted, number: int, spec: StripSpec, vertices: Array, covariance: Array
) -> ScannedStrip:
    chain = adjusted.chains[number]
    views = views_of(adjusted, chain)
    vertices, covariance = _without_straight_corners(vertices, covariance)
    length_m = float(np.linalg.norm(np.diff(vertices, axis=0), axis=1).sum())
    pitch_m = length_m / spec.count
    sigma_m = _sigma(covariance, len(views))
    reason = doubt(adjusted, number, chain, views, sigma_m)
    low, high = seen_twice(adjusted, chain)
    unseen = max(low, spec.count - 1 - high)
    if unseen > max(2.0, MAX_UNSEEN * spec.count):
        sigma_m = math.hypot(sigma_m, UNSEEN_SIGMA * unseen * pitch_m)
        if not reason:
            which = f"0 to {low - 1:.0f}" if unseen == low else f"{high + 1:.0f} to {spec.count - 1}"
            reason = f"no two views show pixels {which}: photograph that end, or correct its count"
    stretch = float(adjusted.state.stretch[number])
    if not reason and spec.pitch_m is not None and abs(stretch) > MAX_STRETCH:
        reason = (
            f"it measures {1.0 / pitch_m:.0f} pixels a metre and is said to have {1.0 / spec.pitch_m:.0f}: "
            "correct its pitch, or is it another strip?"
        )
    line = tuple(_vec3(vertex) for vertex in vertices)
    return ScannedStrip(
        spec.name, spec.count, line, sigma_m, pitch_m, len(views), not reason, reason, covariance
    )


def _without_straight_corners(vertices: Array, covariance: Array) -> tuple[Array, Array]:
    """Return a chain without corners at which it goes on straight."""
    keep = [0]
    for index in range(1, len(vertices) - 1):
        before, after = vertices[index] - vertices[keep[-1]], vertices[index + 1] - vertices[index]
        cosine = float(before @ after / np.linalg.norm(before) / np.linalg.norm(after))
        if math.acos(min(1.0, max(-1.0, cosine))) > STRAIGHT_RAD:
            keep.append(index)
    keep.append(len(vertices) - 1)
    rows = (3 * np.array(keep)[:, None] + np.arange(3)).ravel()
    return vertices[keep], covariance[np.ix_(rows, rows)]


def _vec3(values: Array) -> Vec3:
    return (float(values[0]), float(values[1]), float(values[2]))
