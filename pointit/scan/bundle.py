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
        turned = np.einsum("nij,nj->ni", self.rotations[views], points)
        camera = turned + self.translations[views]
        return _pinhole(self.log_focal, self.distortion, camera), camera[:, 2]

    def moved(self, step: Array) -> "BundleState":
        """Return the state after a step of the unknowns: lens, poses, ends."""
        first_end = 2 + 6 * len(self.rotations)
        poses = step[2:first_end].reshape(-1, 6)
        ends = step[first_end:].reshape(-1, 2, 3)
        rotation = Rotation.from_rotvec(poses[:, :3])
        turns = np.asarray(rotation.as_matrix(), dtype=np.float64)
        focal_step = float(np.clip(step[0], -0.2, 0.2))
        distortion_step = float(np.clip(step[1], -0.1, 0.1))
        return BundleState(
            log_focal=self.log_focal + focal_step,
            distortion=self.distortion + distortion_step,
            rotations=turns @ self.rotations,
            translations=self.translations + poses[:, 3:],
            ends=self.ends + ends,
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
        images, _ = state.image(self.view, self._points(state))
        return images - self.uv

    def stretch(self, state: BundleState) -> Array:
        """Return the logarithm of each piece's length beside the expected one."""
        first, last = state.ends.transpose(1, 0, 2)
        length = np.maximum(np.linalg.norm(last - first, axis=1), 1e-6)
        return np.asarray(np.log(length) - self.log_length)

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
                step = cho_solve(cho_factor(damped), -gradient)
                trial = state.moved(step)
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
        normal, _ = self._normal(state, loss_px, sigma_px)
        eye = np.eye(len(normal))
        inverse = cho_solve(cho_factor(normal + _ANYWHERE * eye), eye)
        end_part = slice(-state.ends.size, None)
        return np.asarray(inverse[end_part, end_part])

    def _points(self, state: BundleState) -> Array:
        first, last = state.ends[self.piece].transpose(1, 0, 2)
        from_first = self.share[:, None] * (last - first)
        return np.asarray(first + from_first)

    def _cost(self, state: BundleState, loss_px: float, sigma_px: float) -> float:
        errors = self.errors(state)
        square = np.sum(errors**2, axis=1) / loss_px**2
        loss = (loss_px / sigma_px) ** 2 * np.log1p(square).sum()
        prior, _ = self._prior(state)
        return float(loss + prior @ prior)

    def _normal(self, state: BundleState, loss_px: float, sigma_px: float) -> tuple[Array, Array]:
        """Return the weighted normal matrix, and the gradient, of sightings and priors."""
        # Images, and their derivatives by the point in the camera's frame and by the distortion
        points = self._points(state)
        rotations = state.rotations[self.view]
        turned = np.einsum("nij,nj->ni", rotations, points)
        camera = turned + state.translations[self.view]
        images = _pinhole(state.log_focal, state.distortion, camera)
        by_axis: list[Array] = []
        for axis in np.eye(3):
            stepped = _pinhole(state.log_focal, state.distortion, camera + _STEP * axis)
            by_axis.append((stepped - images) / _STEP)
        by_camera = np.stack(by_axis, axis=2)
        distorted = _pinhole(state.log_focal, state.distortion + _STEP, camera)
        by_distortion = (distorted - images) / _STEP

        # The derivatives by the unknowns: lens, turn and shift of the view, both ends of the piece
        by_point = by_camera @ rotations
        share = self.share[:, None, None]
        by_lens = np.stack([images, by_distortion], axis=2)
        by_turn = np.cross(turned[:, None], by_camera)
        by_first = by_point * (1.0 - share)
        by_last = by_point * share
        values = np.concatenate([by_lens, by_turn, by_camera, by_first, by_last], axis=2)

        # The numbers of these unknowns
        six = np.arange(6)
        first_end = 2 + 6 * len(self.down)
        lens_columns = np.broadcast_to([0, 1], (len(points), 2))
        pose_columns = 2 + 6 * self.view[:, None] + six
        end_columns = first_end + 6 * self.piece[:, None] + six
        columns = np.concatenate([lens_columns, pose_columns, end_columns], axis=1)

        # Cauchy weights. Each sighting has two rows, u and v, with the same columns.
        errors = images - self.uv
        square = np.sum(errors**2, axis=1) / loss_px**2
        weights = 1.0 / np.sqrt(1.0 + square) / sigma_px
        data: Array = (values * weights[:, None, None]).ravel()
        indices: Indices = np.repeat(columns, 2, axis=0).ravel()
        width = int(columns.shape[1])
        row_starts: Indices = np.arange(0, len(data) + 1, width, dtype=np.intp)

        residuals, rows = self._prior(state)
        shape = (2 * len(points), rows.shape[1])
        jacobian = csr_array((data, indices, row_starts), shape=shape)
        sighted = (jacobian.T @ jacobian).toarray()
        normal = np.asarray(sighted + rows.T @ rows, dtype=np.float64)
        weighted_errors = (errors * weights[:, None]).ravel()
        gradient = jacobian.T @ weighted_errors + rows.T @ residuals
        return normal, np.asarray(gradient, dtype=np.float64)

    def _prior(self, state: BundleState) -> tuple[Array, Array]:
        """Return the residuals of the priors, and their Jacobian."""
        views = len(self.down)
        pieces = len(state.ends)
        known = np.flatnonzero(np.isfinite(self.down[:, 0]))

        # Rows: lens, lengths, gravity, corners. Columns: lens, poses, ends.
        first_gravity = 2 + pieces
        first_corner = first_gravity + 3 * len(known)
        first_end = 2 + 6 * views
        row_count = first_corner + 3 * len(self.corners)
        column_count = first_end + 6 * pieces
        rows = np.zeros((row_count, column_count))
        rows[0, 0] = 1.0 / FOCAL_SIGMA
        rows[1, 1] = 1.0 / DISTORTION_SIGMA
        focal = (state.log_focal - self.log_focal) / FOCAL_SIGMA
        distortion = state.distortion / DISTORTION_SIGMA

        # Lengths, under a robust loss: a strip may have another pitch.
        stretch = self.stretch(state) / self.length_sigma
        first, last = state.ends.transpose(1, 0, 2)
        edges = last - first
        squares = np.maximum(np.sum(edges**2, axis=1), 1e-12)
        scaled_stretch = stretch / 3.0
        slope = 1.0 / np.sqrt(1.0 + scaled_stretch**2) / self.length_sigma
        factors = slope / squares
        by_last = edges * factors[:, None]
        numbers = np.arange(pieces)[:, None]
        end_columns = first_end + 6 * numbers + np.arange(6)
        by_ends = np.concatenate([-by_last, by_last], axis=1)
        rows[2 + numbers, end_columns] = by_ends
        lengths = 3.0 * np.arcsinh(scaled_stretch)

        # Gravity, whose derivative by a turn is its cross product
        down = state.rotations[known] @ DOWN
        x, y, z = down.T / GRAVITY_SIGMA
        gravity_rows = first_gravity + 3 * np.arange(len(known))
        turn_columns = 2 + 6 * known
        for row, column, value in ((0, 1, z), (0, 2, -y), (1, 0, -z), (1, 2, x), (2, 0, y), (2, 1, -x)):
            rows[gravity_rows + row, turn_columns + column] = value
        gravity = (down - self.down[known]) / GRAVITY_SIGMA

        # Corners, without a gap across their bend: the place of a corner along the strip is free.
        edge_lengths = np.linalg.norm(edges, axis=1, keepdims=True)
        directions = edges / np.maximum(edge_lengths, 1e-6)
        gaps: list[Array] = []
        for number, piece in enumerate(self.corners):
            bend = directions[piece] - directions[piece + 1]
            square = max(float(bend @ bend), 1e-2)
            along_bend = np.outer(bend, bend) / square
            across = (np.eye(3) - along_bend) / CORNER_SIGMA_M
            row = first_corner + 3 * number
            own_rows = slice(row, row + 3)
            last_end = first_end + 6 * piece + 3
            next_end = last_end + 3
            rows[own_rows, last_end:next_end] = across
            rows[own_rows, next_end : next_end + 3] = -across
            gap_m = last[piece] - first[piece + 1]
            gaps.append(across @ gap_m)
        residuals = np.concatenate([[focal, distortion], lengths, gravity.ravel(), *gaps])
        return residuals, rows


def vertex_blocks(covariance: Array) -> list[Array]:
    """Return the covariances of the single vertices, 3 x 3 each, of one of all, 3 v x 3 v."""
    blocks: list[Array] = []
    for row in range(0, len(covariance), 3):
        part = slice(row, row + 3)
        blocks.append(covariance[part, part])
    return blocks


def vec3(values: Array) -> Vec3:
    """Return three numbers as a vector."""
    x, y, z = values
    return (float(x), float(y), float(z))


def _pinhole(log_focal: float, distortion: float, camera: Array) -> Array:
    """Return the pixels (n x 2, from the image's centre) of points in the camera's frame (n x 3)."""
    depth = np.maximum(camera[:, 2:], NEAREST_M)
    image = camera[:, :2] / depth
    flat = np.clip(image, -5.0, 5.0)
    square = np.minimum(np.sum(flat**2, axis=1, keepdims=True), 2.0)
    distorted = 1.0 + distortion * square
    return np.asarray(np.exp(log_focal) * flat * distorted)
