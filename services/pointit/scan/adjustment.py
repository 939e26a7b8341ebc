"""Bundle adjustment: lens, poses of the views, strips as chains of straight pieces, lamps as points.

Strips are chains of vertices in the room; pixel n lies between the two vertices whose knots (pixel numbers)
enclose it. A lamp is a chain of one vertex. Minimizes the reprojection errors under a robust loss (Cauchy),
with priors on the focal length, the distortion, each strip's pitch and each view's gravity. The normal
equations of the analytic Jacobian are dense and small: a few hundred unknowns.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

DOWN: Array = np.array([0.0, 0.0, -1.0])
"""Direction of gravity in the room."""
FOCAL_SIGMA = 0.25
"""Standard deviation of the logarithm of the focal length around its start."""
DISTORTION_SIGMA = 0.1
PITCH_SIGMA = 0.01
"""Relative standard deviation of a strip's pitch from the one it is sold with."""
ANY_PITCH_SIGMA = 1.0
"""The same of a strip whose pitch is unknown."""
PIECE_SIGMA = 0.003
"""Relative standard deviation of one piece's pitch from the strip's."""
GRAVITY_SIGMA = 0.026
"""Standard deviation of a phone's gravity, rad per axis."""
NEAREST_M = 0.05
_FAR_APART = 1e6
_LOOSE = 1e-6
"""Information added to each unknown, which makes position and heading of the room determinate."""
_ANYWHERE = 0.1
"""The same of the covariance, of which only what is independent of position and heading is used."""


@dataclass(frozen=True)
class Layout:
    """Sightings, and prior knowledge about views and chains.

    Attributes:
        view, chain: numbers of the view and of the chain of each sighting, n.
        pixel, uv: pixel numbers, n, and images from the centre, image pixels, n x 2.
        first: index of the first vertex of each chain, and the number of all vertices, chains + 1.
        log_pitch, pitch_sigma: of each chain, of its pitch in m. 0 for lamps.
        down: directions of gravity in the cameras' frames, views x 3. NaN if unknown.
        log_focal: expected logarithm of the focal length in image pixels.
    """

    view: Indices
    chain: Indices
    pixel: Array
    uv: Array
    first: Indices
    log_pitch: Array
    pitch_sigma: Array
    down: Array
    log_focal: float


@dataclass(frozen=True)
class State:
    """Unknowns. A point X of the room is at rotation X + translation in a view's camera frame.

    Attributes:
        log_focal, distortion: of the lens; distortion is k1 of normalized image coordinates.
        rotations, translations: views x 3 x 3, and views x 3, m.
        vertices, knots: vertices x 3, m, and their places on the chain, pixel numbers.
        stretch: logarithm of each chain's pitch beside the expected one.
    """

    log_focal: float
    distortion: float
    rotations: Array
    translations: Array
    vertices: Array
    knots: Array
    stretch: Array


@dataclass(frozen=True)
class _Columns:
    """Indices of unknowns. -1: not an unknown."""

    poses: int
    vertices: int
    knots: Indices
    stretch: Indices
    count: int


def skew(vectors: Array) -> Array:
    """Return the matrices of the cross products with `vectors` (n x 3), n x 3 x 3."""
    matrix = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    matrix[:, 0, 1], matrix[:, 0, 2], matrix[:, 1, 2] = -z, y, -x
    return matrix - matrix.transpose(0, 2, 1)


def turned(rotations: Array, by: Array) -> Array:
    """Return `rotations` (n x 3 x 3), each then rotated by a vector of `by` (n x 3, rad)."""
    angle = np.linalg.norm(by, axis=1)[:, None, None]
    axis = skew(by / np.maximum(angle[:, 0], 1e-12))
    return np.asarray((np.eye(3) + np.sin(angle) * axis + (1.0 - np.cos(angle)) * axis @ axis) @ rotations)


class Adjustment:
    """The equations of one layout."""

    def __init__(self, layout: Layout) -> None:
        """Create for `layout`."""
        self.layout = layout
        first = layout.first
        sizes = np.diff(first)
        self._chain_of_vertex = np.repeat(np.arange(len(sizes)), sizes)
        self._piece_starts: Indices = np.delete(np.arange(int(first[-1])), first[1:] - 1)
        views = len(layout.down)
        inner = np.ones(first[-1], dtype=bool)
        inner[first[:-1]] = inner[first[1:] - 1] = False
        vertices = 2 + 6 * views
        knots = vertices + 3 * int(first[-1])
        knot_columns = np.where(inner, knots + np.cumsum(inner) - 1, -1)
        stretch = knots + int(inner.sum())
        strips = sizes > 1
        stretch_columns = np.where(strips, stretch + np.cumsum(strips) - 1, -1)
        self._columns = _Columns(2, vertices, knot_columns, stretch_columns, stretch + int(strips.sum()))

    def places(self, state: State, chain: Indices, pixel: Array) -> tuple[Array, Indices, Indices, Array]:
        """Return points of the room, the vertices before and after each, and the share of the latter."""
        first = self.layout.first
        keys = self._chain_of_vertex * _FAR_APART + state.knots
        before = np.searchsorted(keys, chain * _FAR_APART + pixel, side="right") - 1
        before = np.clip(before, first[chain], np.maximum(first[chain + 1] - 2, first[chain]))
        after = np.minimum(before + 1, first[chain + 1] - 1)
        span = np.where(after > before, state.knots[after] - state.knots[before], 1.0)
        share = np.where(after > before, (pixel - state.knots[before]) / span, 0.0)
        points = state.vertices[before] + share[:, None] * (state.vertices[after] - state.vertices[before])
        return points, before, after, share

    def images(self, state: State, view: Indices, chain: Indices, pixel: Array) -> tuple[Array, Array]:
        """Return the images of `pixel` of chains in views, n x 2, and their depths, m."""
        points = self.places(state, chain, pixel)[0]
        return project(state, view, points)

    def errors(self, state: State) -> Array:
        """Return the reprojection error of each sighting, n x 2, image pixels."""
        layout = self.layout
        return self.images(state, layout.view, layout.chain, layout.pixel)[0] - layout.uv

    def solve(self, state: State, iterations: int, loss_px: float, sigma_px: float = 1.0) -> State:
        """Return the state after at most `iterations` of Levenberg-Marquardt; `loss_px` scales the loss."""
        damping = 1e-3
        cost, jacobian, residuals = self._system(state, loss_px, sigma_px)
        for _ in range(iterations):
            normal, gradient = (jacobian.T @ jacobian).toarray(), jacobian.T @ residuals
            for _ in range(6):
                scaled = normal + np.diag(damping * normal.diagonal() + _LOOSE)
                step = cho_solve(cho_factor(scaled), -gradient)
                trial = self._moved(state, step)
                trial_cost = self._cost(trial, loss_px, sigma_px)
                if trial_cost < cost:
                    break
                damping *= 8.0
            else:
                return state
            is_done = cost - trial_cost < 1e-5 * cost
            state, damping = trial, max(damping / 5.0, 1e-7)
            if is_done:
                break
            cost, jacobian, residuals = self._system(state, loss_px, sigma_px)
        return state

    def covariance(self, state: State, loss_px: float, sigma_px: float) -> Array:
        """Return the covariance of all vertices, 3 v x 3 v, m², position and heading of the room free."""
        jacobian = self._system(state, loss_px, sigma_px)[1]
        normal = (jacobian.T @ jacobian).toarray()
        inverse = cho_solve(cho_factor(normal + _ANYWHERE * np.eye(len(normal))), np.eye(len(normal)))
        begin = self._columns.vertices
        end = begin + 3 * len(state.vertices)
        return np.asarray(inverse[begin:end, begin:end])

    def tilt(self, state: State) -> float:
        """Return the standard deviation of the room's level by the views' gravity, rad. inf without."""
        down = self.layout.down
        known = np.isfinite(down[:, 0])
        if not known.any():
            return np.inf
        sunk: Array = np.einsum("vij,vi->vj", state.rotations[known], down[known])[:, :2]
        rms = float(np.sqrt(np.mean(sunk**2)))
        return max(rms, GRAVITY_SIGMA / 2.0) / float(np.sqrt(known.sum()))

    def _moved(self, state: State, step: Array) -> State:
        columns, views = self._columns, len(self.layout.down)
        poses = step[columns.poses : columns.poses + 6 * views].reshape(views, 6)
        end = columns.vertices + state.vertices.size
        padded = np.append(step, 0.0)  # -1 is not an unknown
        knots = state.knots + np.clip(padded[columns.knots], -2.0, 2.0)
        for low, high in pairwise(self.layout.first):
            if high - low > 2:  # pieces stay longer than a pixel
                knots[low + 1 : high - 1] = np.clip(
                    np.maximum.accumulate(knots[low + 1 : high - 1]), knots[low] + 1.0, knots[high - 1] - 1.0
                )
        return State(
            state.log_focal + float(np.clip(step[0], -0.2, 0.2)),
            state.distortion + float(np.clip(step[1], -0.1, 0.1)),
            turned(state.rotations, poses[:, :3]),
            state.translations + poses[:, 3:],
            state.vertices + step[columns.vertices : end].reshape(-1, 3),
            knots,
            state.stretch + padded[columns.stretch],
        )

    def _cost(self, state: State, loss_px: float, sigma_px: float) -> float:
        square = np.sum(self.errors(state) ** 2, axis=1) / loss_px**2
        prior = self._priors(state)[0]
        return float((loss_px / sigma_px) ** 2 * np.log1p(square).sum() + prior @ prior)

    def _system(self, state: State, loss_px: float, sigma_px: float) -> tuple[float, csr_array, Array]:
        """Return the cost, and weighted Jacobian and residuals of sightings and priors."""
        layout, columns = self.layout, self._columns
        points, before, after, share = self.places(state, layout.chain, layout.pixel)
        count = len(points)
        rotations = state.rotations[layout.view]
        seen = np.einsum("nij,nj->ni", rotations, points)
        camera = seen + state.translations[layout.view]
        images, by_camera, by_lens = _projection(state, camera)
        errors = images - layout.uv
        square = np.sum(errors**2, axis=1) / loss_px**2
        weights = 1.0 / np.sqrt(1.0 + square) / sigma_px
        by_point = by_camera @ rotations
        along = np.einsum("nij,nj->ni", by_point, state.vertices[after] - state.vertices[before])
        span = np.where(after > before, state.knots[after] - state.knots[before], np.inf)
        values = np.concatenate(
            [
                by_lens,
                -by_camera @ skew(seen),
                by_camera,
                by_point * (1.0 - share)[:, None, None],
                by_point * share[:, None, None],
                (along * (-(1.0 - share) / span)[:, None])[..., None],
                (along * (-share / span)[:, None])[..., None],
            ],
            axis=2,
        )
        three = np.arange(3)
        pose = columns.poses + 6 * layout.view
        indices = np.concatenate(
            [
                np.broadcast_to([0, 1], (count, 2)),
                pose[:, None] + np.arange(6),
                columns.vertices + 3 * before[:, None] + three,
                columns.vertices + 3 * after[:, None] + three,
                columns.knots[before][:, None],
                columns.knots[after][:, None],
            ],
            axis=1,
        )
        prior, prior_rows, prior_columns, prior_values = self._priors(state)
        values *= weights[:, None, None]
        width = indices.shape[1]
        rows = np.repeat(np.arange(2 * count), width)
        all_columns = np.repeat(indices, 2, axis=0).ravel()
        data = values.ravel()
        keep = all_columns >= 0
        jacobian = csr_array(
            (
                np.concatenate([data[keep], prior_values]),
                (
                    np.concatenate([rows[keep], 2 * count + prior_rows]),
                    np.concatenate([all_columns[keep], prior_columns]),
                ),
            ),
            shape=(2 * count + len(prior), columns.count),
        )
        cost = float((loss_px / sigma_px) ** 2 * np.log1p(square).sum() + prior @ prior)
        return cost, jacobian, np.concatenate([(errors * weights[:, None]).ravel(), prior])

    def _priors(self, state: State) -> tuple[Array, Indices, Indices, Array]:
        """Return residuals of the priors, and the rows, columns and values of their Jacobian."""
        layout, columns = self.layout, self._columns
        parts: list[tuple[Array, Indices, Array]] = [
            (
                np.array(
                    [(state.log_focal - layout.log_focal) / FOCAL_SIGMA, state.distortion / DISTORTION_SIGMA]
                ),
                np.array([[0], [1]]),
                np.array([[1.0 / FOCAL_SIGMA], [1.0 / DISTORTION_SIGMA]]),
            )
        ]
        starts = self._piece_starts
        chain = self._chain_of_vertex[starts]
        edge = state.vertices[starts + 1] - state.vertices[starts]
        length = np.maximum(np.linalg.norm(edge, axis=1), 1e-6)
        span = state.knots[starts + 1] - state.knots[starts]
        unit = edge / length[:, None] ** 2
        three = np.arange(3)
        parts.append(
            (
                (np.log(length / span) - layout.log_pitch[chain] - state.stretch[chain]) / PIECE_SIGMA,
                np.column_stack(
                    [
                        columns.vertices + 3 * starts[:, None] + three,
                        columns.vertices + 3 * (starts[:, None] + 1) + three,
                        columns.knots[starts],
                        columns.knots[starts + 1],
                        columns.stretch[chain],
                    ]
                ),
                np.column_stack([-unit, unit, 1.0 / span, -1.0 / span, -np.ones(len(span))]) / PIECE_SIGMA,
            )
        )
        strips = np.flatnonzero(columns.stretch >= 0)
        off = state.stretch[strips] / layout.pitch_sigma[strips]
        softness = np.sqrt(1.0 + (off / 3.0) ** 2)  # a strip of another pitch than it is said to have
        parts.append(
            (
                3.0 * np.arcsinh(off / 3.0),
                columns.stretch[strips][:, None],
                (1.0 / softness / layout.pitch_sigma[strips])[:, None],
            )
        )
        known = np.flatnonzero(np.isfinite(layout.down[:, 0]))
        sunk = state.rotations[known] @ DOWN
        parts.append(
            (
                ((sunk - layout.down[known]) / GRAVITY_SIGMA).ravel(),
                np.repeat(columns.poses + 6 * known[:, None] + three, 3, axis=0),
                (-skew(sunk) / GRAVITY_SIGMA).reshape(-1, 3),
            )
        )
        return _joined(parts)


def _joined(parts: Sequence[tuple[Array, Indices, Array]]) -> tuple[Array, Indices, Indices, Array]:
    rows: list[Indices] = []
    begin = 0
    for residuals, columns, _ in parts:
        rows.append(np.repeat(np.arange(begin, begin + len(residuals)), columns.shape[1]))
        begin += len(residuals)
    all_columns = np.concatenate([columns.ravel() for _, columns, _ in parts]).astype(np.intp)
    keep = all_columns >= 0
    return (
        np.concatenate([residuals for residuals, _, _ in parts]),
        np.concatenate(rows)[keep],
        all_columns[keep],
        np.concatenate([values.ravel() for _, _, values in parts])[keep],
    )


def project(state: State, view: Indices, points: Array) -> tuple[Array, Array]:
    """Return images of `points` (n x 3) in views (n), n x 2 from the centre, and their depths, m."""
    camera = np.einsum("nij,nj->ni", state.rotations[view], points) + state.translations[view]
    depth = np.maximum(camera[:, 2:], NEAREST_M)
    flat = np.clip(camera[:, :2] / depth, -5.0, 5.0)
    square = np.minimum(np.sum(flat**2, axis=1, keepdims=True), 2.0)
    return np.exp(state.log_focal) * flat * (1.0 + state.distortion * square), camera[:, 2]


def _projection(state: State, camera: Array) -> tuple[Array, Array, Array]:
    """Return images n x 2, and their derivatives by the camera's coordinates, n x 2 x 3, and by the lens."""
    depth = np.maximum(camera[:, 2:], NEAREST_M)
    flat = np.clip(camera[:, :2] / depth, -5.0, 5.0)
    square = np.minimum(np.sum(flat**2, axis=1, keepdims=True), 2.0)
    focal = float(np.exp(state.log_focal))
    factor = 1.0 + state.distortion * square
    images = focal * flat * factor
    by_flat = focal * (
        factor[..., None] * np.eye(2) + 2.0 * state.distortion * flat[:, :, None] * flat[:, None, :]
    )
    flat_by_camera = (
        np.concatenate([np.broadcast_to(np.eye(2), (len(camera), 2, 2)), -flat[..., None]], axis=2)
        / depth[..., None]
    )
    by_lens = np.stack([images, focal * square * flat], axis=2)
    return images, by_flat @ flat_by_camera, by_lens
