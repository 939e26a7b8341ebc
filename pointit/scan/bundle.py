"""Bundle adjustment: lens, poses of the views, and straight pieces of strips in the room.

A piece is the segment between two points, its ends, at two pixel numbers. A strip round a corner is several
pieces. A lamp is a piece of which the first end counts only. Minimizes the reprojection errors under a robust
loss (Cauchy) by Levenberg-Marquardt, with priors on the focal length, the distortion, the pieces' lengths and
the views' gravity. The Jacobian is sparse, its normal equations are dense and small: a few hundred unknowns.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from pointit.geometry.array_types import Array, Indices
from pointit.geometry.vector import Vec3

DOWN: Array = np.array([0.0, 0.0, -1.0])
"""Direction of gravity in the room."""
FOCAL_SIGMA = 0.25
"""Standard deviation of the logarithm of the focal length around its start."""
DISTORTION_SIGMA = 0.1
GRAVITY_SIGMA = 0.026
"""Standard deviation of a phone's gravity, rad per axis."""
CORNER_SIGMA_M = 0.003
"""Standard deviation of the gap between two pieces at a corner."""
NEAREST_M = 0.05
_LOOSE = 1e-6
"""Information added to each unknown, which makes position and heading of the room determinate."""
_ANYWHERE = 0.1
"""The same of the covariance, of which only what is independent of position and heading is used."""
_STEP = 1e-6
"""Step of numeric derivatives of the projection."""


@dataclass(frozen=True)
class BundleState:
    """Unknowns. A point X of the room is at rotation X + translation in a view's camera frame.

    Attributes:
        log_focal, distortion: of the lens; distortion is k1 of normalized image coordinates.
        rotations, translations: views x 3 x 3, and views x 3, m.
        ends: of the pieces, pieces x 2 x 3, m.
    """

    log_focal: float
    distortion: float
    rotations: Array
    translations: Array
    ends: Array

    def image(self, views: Indices, points: Array) -> tuple[Array, Array]:
        """Return images of `points` (n x 3) in `views` (n), n x 2 from the centre, and their depths, m."""
        camera = np.einsum("nij,nj->ni", self.rotations[views], points) + self.translations[views]
        return _pinhole(self.log_focal, self.distortion, camera), camera[:, 2]

    def moved(self, step: Array) -> "BundleState":
        """Return the state after a step of the unknowns: lens, poses, ends."""
        poses, ends = np.split(step[2:], [6 * len(self.rotations)])
        poses = poses.reshape(-1, 6)
        turns = np.asarray(Rotation.from_rotvec(poses[:, :3]).as_matrix(), dtype=np.float64)
        return BundleState(
            self.log_focal + float(np.clip(step[0], -0.2, 0.2)),
            self.distortion + float(np.clip(step[1], -0.1, 0.1)),
            turns @ self.rotations,
            self.translations + poses[:, 3:],
            self.ends + ends.reshape(-1, 2, 3),
        )


@dataclass(frozen=True)
class BundleProblem:
    """Sightings, and prior knowledge about views and pieces.

    Attributes:
        view, piece: numbers of the view and of the piece of each sighting, n.
        share: its position between the piece's ends, n. 0 is the first end.
        uv: its image from the centre, image pixels, n x 2.
        log_length, length_sigma: expected logarithm of the length of each piece, and standard deviation.
        down: directions of gravity in the cameras' frames, views x 3. NaN if unknown.
        log_focal: expected logarithm of the focal length in image pixels.
        corners: pieces of which the second end meets the first end of the next piece.
    """

    view: Indices
    piece: Indices
    share: Array
    uv: Array
    log_length: Array
    length_sigma: Array
    down: Array
    log_focal: float
    corners: Sequence[int] = ()

    def errors(self, state: BundleState) -> Array:
        """Return the reprojection error of each sighting, n x 2, image pixels."""
        return state.image(self.view, self._points(state))[0] - self.uv

    def stretch(self, state: BundleState) -> Array:
        """Return the logarithm of each piece's length beside the expected one."""
        length = np.linalg.norm(state.ends[:, 1] - state.ends[:, 0], axis=1)
        return np.asarray(np.log(np.maximum(length, 1e-6)) - self.log_length)

    def solve(
        self, state: BundleState, iterations: int, loss_px: float, sigma_px: float = 1.0
    ) -> BundleState:
        """Return the state after at most `iterations` of Levenberg-Marquardt; `loss_px` scales the loss."""
        damping = 1e-3
        cost = self._cost(state, loss_px, sigma_px)
        for _ in range(iterations):
            normal, gradient = self._normal(state, loss_px, sigma_px)
            for _ in range(6):
                damped = normal + np.diag(damping * normal.diagonal() + _LOOSE)
                trial = state.moved(cho_solve(cho_factor(damped), -gradient))
                trial_cost = self._cost(trial, loss_px, sigma_px)
                if trial_cost < cost:
                    break
                damping *= 8.0
            else:
                return state
            is_done = cost - trial_cost < 1e-5 * cost
            state = trial
            cost = trial_cost
            damping = max(damping / 5.0, 1e-7)
            if is_done:
                break
        return state

    def covariance(self, state: BundleState, loss_px: float, sigma_px: float) -> Array:
        """Return the covariance of all ends, 6 p x 6 p, m², position and heading of the room free."""
        normal = self._normal(state, loss_px, sigma_px)[0]
        inverse = cho_solve(cho_factor(normal + _ANYWHERE * np.eye(len(normal))), np.eye(len(normal)))
        return np.asarray(inverse[-state.ends.size :, -state.ends.size :])

    def _points(self, state: BundleState) -> Array:
        first, last = state.ends[self.piece].transpose(1, 0, 2)
        return np.asarray(first + self.share[:, None] * (last - first))

    def _cost(self, state: BundleState, loss_px: float, sigma_px: float) -> float:
        square = np.sum(self.errors(state) ** 2, axis=1) / loss_px**2
        prior = self._prior(state)[0]
        return float((loss_px / sigma_px) ** 2 * np.log1p(square).sum() + prior @ prior)

    def _normal(self, state: BundleState, loss_px: float, sigma_px: float) -> tuple[Array, Array]:
        """Return the weighted normal matrix, and the gradient, of sightings and priors."""
        points = self._points(state)
        rotations = state.rotations[self.view]
        turned = np.einsum("nij,nj->ni", rotations, points)
        camera = turned + state.translations[self.view]
        images = _pinhole(state.log_focal, state.distortion, camera)
        by_camera = np.stack(
            [
                (_pinhole(state.log_focal, state.distortion, camera + _STEP * axis) - images) / _STEP
                for axis in np.eye(3)
            ],
            axis=2,
        )
        by_distortion = (_pinhole(state.log_focal, state.distortion + _STEP, camera) - images) / _STEP
        by_point = by_camera @ rotations
        share = self.share[:, None, None]
        values = np.concatenate(
            [
                np.stack([images, by_distortion], axis=2),
                np.cross(turned[:, None], by_camera),
                by_camera,
                by_point * (1.0 - share),
                by_point * share,
            ],
            axis=2,
        )
        six = np.arange(6)
        columns = np.concatenate(
            [
                np.broadcast_to([0, 1], (len(points), 2)),
                2 + 6 * self.view[:, None] + six,
                2 + 6 * len(self.down) + 6 * self.piece[:, None] + six,
            ],
            axis=1,
        )
        errors = images - self.uv
        weights = 1.0 / np.sqrt(1.0 + np.sum(errors**2, axis=1) / loss_px**2) / sigma_px
        residuals, rows = self._prior(state)
        data: Array = (values * weights[:, None, None]).ravel()
        indices: Indices = np.repeat(columns, 2, axis=0).ravel()
        width = int(columns.shape[1])
        starts: Indices = np.arange(0, len(data) + 1, width, dtype=np.intp)
        jacobian = csr_array((data, indices, starts), shape=(2 * len(points), rows.shape[1]))
        normal = np.asarray((jacobian.T @ jacobian).toarray() + rows.T @ rows, dtype=np.float64)
        gradient = jacobian.T @ (errors * weights[:, None]).ravel() + rows.T @ residuals
        return normal, np.asarray(gradient, dtype=np.float64)

    def _prior(self, state: BundleState) -> tuple[Array, Array]:
        """Return the residuals of the priors, and their Jacobian."""
        views = len(self.down)
        pieces = len(state.ends)
        known = np.flatnonzero(np.isfinite(self.down[:, 0]))
        rows = np.zeros((2 + pieces + 3 * len(known) + 3 * len(self.corners), 2 + 6 * views + 6 * pieces))
        rows[0, 0] = 1.0 / FOCAL_SIGMA
        rows[1, 1] = 1.0 / DISTORTION_SIGMA
        off = self.stretch(state) / self.length_sigma
        edge = state.ends[:, 1] - state.ends[:, 0]
        slope = 1.0 / np.sqrt(1.0 + (off / 3.0) ** 2) / self.length_sigma  # a strip may have another pitch
        by_end = edge * (slope / np.maximum(np.sum(edge**2, axis=1), 1e-12))[:, None]
        each = np.arange(pieces)[:, None]
        rows[2 + each, 2 + 6 * (views + each) + np.arange(6)] = np.concatenate([-by_end, by_end], axis=1)
        sunk = state.rotations[known] @ DOWN
        x, y, z = sunk.T / GRAVITY_SIGMA
        for row, column, value in ((0, 1, z), (0, 2, -y), (1, 0, -z), (1, 2, x), (2, 0, y), (2, 1, -x)):
            rows[2 + pieces + row + 3 * np.arange(len(known)), 2 + column + 6 * known] = value
        directions = edge / np.maximum(np.linalg.norm(edge, axis=1, keepdims=True), 1e-6)
        gaps: list[Array] = []
        for number, piece in enumerate(self.corners):  # the place of the corner along the strip is free
            bend = directions[piece] - directions[piece + 1]
            across = (np.eye(3) - np.outer(bend, bend) / max(float(bend @ bend), 1e-2)) / CORNER_SIGMA_M
            row = len(rows) - 3 * (len(self.corners) - number)
            begin = 2 + 6 * views + 6 * piece
            rows[row : row + 3, begin + 3 : begin + 6] = across
            rows[row : row + 3, begin + 6 : begin + 9] = -across
            gaps.append(across @ (state.ends[piece, 1] - state.ends[piece + 1, 0]))
        residuals = np.concatenate(
            [
                [(state.log_focal - self.log_focal) / FOCAL_SIGMA, state.distortion / DISTORTION_SIGMA],
                3.0 * np.arcsinh(off / 3.0),
                ((sunk - self.down[known]) / GRAVITY_SIGMA).ravel(),
                *gaps,
            ]
        )
        return residuals, rows


def vec3(values: Array) -> Vec3:
    """Return three numbers as a vector."""
    return (float(values[0]), float(values[1]), float(values[2]))


def _pinhole(log_focal: float, distortion: float, camera: Array) -> Array:
    """Return the pixels (n x 2, from the image's centre) of points in the camera's frame (n x 3)."""
    flat = np.clip(camera[:, :2] / np.maximum(camera[:, 2:], NEAREST_M), -5.0, 5.0)
    square = np.minimum(np.sum(flat**2, axis=1, keepdims=True), 2.0)
    return np.asarray(np.exp(log_focal) * flat * (1.0 + distortion * square))
