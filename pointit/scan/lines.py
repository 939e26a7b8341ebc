"""Straight pieces of strips in single photographs: the number of a pixel to its place in the image.

Along a straight strip, p + n d in the camera's frame, the image of pixel n is (a + n b) up to scale, with
a = K p and b = K d: six numbers without a scale, from three pixels. The pitch gives |d| and so the scale.
Wrong numbers, reflections and the rest of a bent strip are outliers (random sample consensus).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pointit.geometry.array_types import Array, Mask

TOLERANCE_PX = 3.0
BOW = 0.015
"""Tolerance for the distortion of the lens, as a share of the line's extent in the image."""
MIN_VIEWS = 4
"""Minimum number of pixels of a line: three determine it, one confirms it."""
TRIALS = 60
STRAIGHT_SHARE = 0.75
"""Share of a strip's pixels that lie on one line if it is straight; 10 % of all numbers may be wrong."""
MAX_PIECES = 5
MAX_SPLITS = 16
"""Maximum number of places that are tried for one corner."""


@dataclass(frozen=True)
class ImageLine:
    """The image of a straight piece: pixel n is at (a + n b), homogeneous, pixels from the centre.

    Attributes:
        a, b: 3 each.
        pixels: numbers of the pixels that lie on it, k.
        uv: their images, k x 2, from the image's centre.
    """

    a: Array
    b: Array
    pixels: Array
    uv: Array

    def at(self, pixels: Array) -> Array:
        """Return the images of `pixels` (k), k x 2."""
        points = self.a + pixels[:, None] * self.b
        return points[:, :2] / points[:, 2:]

    @property
    def extent_px(self) -> float:
        """Return the length in the image."""
        return float(np.linalg.norm(np.ptp(self.uv, axis=0)))

    def in_camera(self, focal_px: float, pitch_m: float, pixels: Array) -> Array:
        """Return the places of `pixels` (k) in the camera's frame, k x 3, m."""
        focal = np.array([focal_px, focal_px, 1.0])
        points = (self.a + pixels[:, None] * self.b) / focal
        step = self.b / focal
        scale = pitch_m / np.linalg.norm(step)
        return np.asarray(points * scale)


def fit_lines(pixels: Array, uv: Array, rng: np.random.Generator) -> list[ImageLine]:
    """Return the line that most of `pixels` (k, at `uv`, k x 2) lie on, then a second one, if there is one.

    The second is a reflection, or the rest of a bent strip.
    """
    lines: list[ImageLine] = []
    for _ in range(2):
        on_line = _consensus(pixels, uv, rng)
        if on_line is None:
            break
        line = _refined(pixels[on_line], uv[on_line])
        if line is None:
            break
        lines.append(line)
        pixels = pixels[~on_line]
        uv = uv[~on_line]
    return lines


def _consensus(pixels: Array, uv: Array, rng: np.random.Generator) -> Mask | None:
    """Return the largest set of pixels that lie on one line, or None if there are too few."""
    if _count_pixels(pixels) < MIN_VIEWS:
        return None

    # Trials, each with three different pixels
    shuffled = np.argsort(rng.random((TRIALS, len(pixels))), axis=1)
    picks = shuffled[:, :3]
    numbers = np.sort(pixels[picks], axis=1)
    is_different = np.all(np.diff(numbers, axis=1) > 0, axis=1)
    picks = picks[is_different]
    if not len(picks):
        return None

    # Along the chord of the first and last of the three: s = (f n + g) / (h n + 1)
    order = np.argsort(pixels[picks], axis=1)
    picks = np.take_along_axis(picks, order, axis=1)
    first = uv[picks[:, 0]]
    last = uv[picks[:, 2]]
    chord = last - first
    length = np.linalg.norm(chord, axis=1)
    usable = length > 2.0 * TOLERANCE_PX
    picks = picks[usable]
    first = first[usable]
    chord = chord[usable]
    length = length[usable]
    if not len(picks):
        return None
    along = chord / length[:, None]
    from_first = uv[picks] - first[:, None]
    s = np.einsum("tkx,tx->tk", from_first, along)
    share = pixels / max(float(pixels.max()), 1.0)
    n = share[picks]
    system = np.stack([n, np.ones_like(n), -n * s], axis=2)
    system += np.eye(3) * 1e-12
    right_sides = s[..., None]
    solution = np.asarray(np.linalg.solve(system, right_sides), dtype=np.float64)
    f, g, h = solution.transpose(1, 0, 2)  # trials x 1 each

    # The images of all pixels on the line of each trial
    depth = h * share + 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (f * share + g) / depth
        from_first = reach[..., None] * along[:, None]
        images = first[:, None] + from_first
        error = np.linalg.norm(images - uv, axis=2)

    # The trial with the most hits; of equal ones, that with the least errors
    whole_extent = float(np.linalg.norm(np.ptp(uv, axis=0)))
    extent = np.minimum(length, whole_extent)
    ends = [int(np.argmin(pixels)), int(np.argmax(pixels))]
    in_front = np.all(depth[:, ends] > 0.02, axis=1)
    tolerance = TOLERANCE_PX + BOW * extent
    hits = (error < tolerance[:, None]) & in_front[:, None]
    error_sum = error.clip(max=10.0).sum(axis=1)
    counts = hits.sum(axis=1) - error_sum / (1e3 * len(pixels))
    best = hits[int(np.argmax(counts))]
    return best if _count_pixels(pixels[best]) >= MIN_VIEWS else None


def _refined(pixels: Array, uv: Array) -> ImageLine | None:
    """Return the line of least squares through `pixels`, or None if it runs through the camera's plane."""
    # Coordinates about 0 and of size 1, so that the equations are well conditioned.
    middle = uv.mean(axis=0)
    scale = max(float(uv.std()), 1e-6)
    n0 = float(pixels.mean())
    n_scale = max(float(pixels.std()), 1e-6)
    u = (uv - middle) / scale
    n = (pixels - n0) / n_scale
    weights = np.ones(len(n))
    solution = np.zeros(6)
    depth = np.zeros(len(n))
    for _ in range(3):  # equations of the image, not of the homogeneous coordinates
        rows = np.zeros((2 * len(n), 6))
        for axis in (0, 1):
            part = rows[axis::2]
            part[:, axis] = weights
            part[:, 3 + axis] = weights * n
            part[:, 2] = -weights * u[:, axis]
            part[:, 5] = -weights * n * u[:, axis]
        _, _, axes = np.linalg.svd(rows, full_matrices=False)
        solution = axes[-1]
        depth = solution[2] + n * solution[5]
        weights = 1.0 / np.maximum(np.abs(depth), 1e-9)
    if not (np.all(depth > 0) or np.all(depth < 0)):
        return None

    # Back into image pixels and pixel numbers.
    sign = np.sign(depth[0])
    a = solution[:3] * sign
    b = solution[3:] * sign
    x, y = middle
    back = np.array([[scale, 0, x], [0, scale, y], [0, 0, 1.0]])
    a = back @ (a - b * n0 / n_scale)
    b = back @ b / n_scale
    return ImageLine(a, b, pixels, uv)


def corners(views: Sequence[tuple[Array, Array]], count: int, rng: np.random.Generator) -> list[float]:
    """Return the pixel numbers at which a strip of `count` pixels bends, seen in `views` (pixels and images).

    A number between two pixels that were seen, to be refined by the adjustment.
    """
    knots = [-0.5, count - 0.5]
    searched: set[float] = set()
    while len(knots) <= MAX_PIECES:
        for low, high in pairwise(knots):
            if low in searched:
                continue
            parts = [_between(view, low, high) for view in views]
            split = _split(parts, rng)
            if split is not None:
                knots = sorted([*knots, split])
                break
            searched.add(low)
        else:
            break
    return knots[1:-1]


def _between(view: tuple[Array, Array], low: float, high: float) -> tuple[Array, Array]:
    pixels, uv = view
    part = (pixels > low) & (pixels < high)
    return pixels[part], uv[part]


def _split(views: Sequence[tuple[Array, Array]], rng: np.random.Generator) -> float | None:
    """Return the place where a corner explains the most additional pixels, or None if it is straight."""
    views = [view for view in views if _count_pixels(view[0]) >= 2 * MIN_VIEWS]
    seen = sum(_count_pixels(pixels) for pixels, _ in views)
    straight = sum(_covered(view, rng) for view in views)
    if straight >= STRAIGHT_SHARE * seen:
        return None
    all_pixels = [pixels for pixels, _ in views]
    numbers = np.unique(np.concatenate(all_pixels))
    middles = (numbers[:-1] + numbers[1:]) / 2.0
    middles = middles[MIN_VIEWS - 1 : 1 - MIN_VIEWS]
    if len(middles) > MAX_SPLITS:
        steps = np.linspace(0, len(middles) - 1, MAX_SPLITS).astype(int)
        middles = middles[steps]
    scores: list[int] = []
    for place in middles:
        covered = 0
        for view in views:
            covered += _covered(_between(view, -1.0, place), rng)
            covered += _covered(_between(view, place, np.inf), rng)
        scores.append(covered)

    # A corner explains clearly more than a straight strip.
    if not scores:
        return None
    best_score = max(scores)
    if best_score < straight + max(3, 0.12 * seen):
        return None
    is_best = np.array(scores) >= best_score - 0.5
    return float(np.mean(middles[is_best]))


def _count_pixels(pixels: Array) -> int:
    """Return the number of different pixels."""
    return len(np.unique(pixels))


def _covered(view: tuple[Array, Array], rng: np.random.Generator) -> int:
    """Return the number of different pixels on the best line."""
    pixels, uv = view
    on_line = _consensus(pixels, uv, rng)
    if on_line is None:
        return 0
    return _count_pixels(pixels[on_line])
