"""Poses of views by the strips they share: rigid motions between sets of points (Kabsch), by consensus."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from scipy.spatial.transform import Rotation

from pointit.scan.bundle import DOWN, GRAVITY_SIGMA, Array

MAX_PAIRS = 300
COARSE = 0.05
"""Tolerance of a first pose, as a share of the image's width: depth from one photograph is coarse."""
ORBIT_RAD = tuple(np.radians([-90.0, -60.0, -40.0, -20.0, 20.0, 40.0, 60.0, 90.0]))
"""Angles about the lines, upright, at which further poses are searched."""
DISTINCT_M = 0.15
"""Distance of poses that differ."""
MAX_POSES = 3
GRAVITY_ARM_M = 0.5
"""Gravity counts as a point at this distance."""


def _nearest(matrix: Array) -> Array:
    """Return the rotations that are nearest to `matrix`, h x 3 x 3."""
    left, _, right = np.linalg.svd(matrix)
    sign = np.sign(np.linalg.det(left @ right))
    left = left.copy()
    left[:, :, 2] *= sign[:, None]
    return np.asarray(left @ right)


@dataclass(frozen=True)
class Shared:
    """Lines that the room and a view share.

    Attributes:
        room: three points of each line in the room, m, n x 3 x 3.
        camera: the same points in the camera's frame, m, coarse along the line of sight.
        images: their images from the centre, image pixels, n x 3 x 2.
        focal_px: focal length.
        width_px: longer side of the image.
        down: direction of gravity in the camera's frame, if that and the room's level are known.
    """

    room: Array
    camera: Array
    images: Array
    focal_px: float
    width_px: float
    down: Array | None


def candidate_poses(shared: Shared) -> list[tuple[Array, Array]]:
    """Return the rotation and translation of poses that explain the images of lines, the best first.

    More than one if the images fit several poses, for example of a short strip seen obliquely, from the left
    or from the right.
    """
    room, down = shared.room, shared.down
    count = len(room)
    sets: list[tuple[int, int]] = list(combinations(range(count), 2))
    if down is not None:
        sets += [(each, each) for each in range(count)]
    if not sets:
        return []
    if len(sets) > MAX_PAIRS:
        sets = sets[:: -(-len(sets) // MAX_PAIRS)]
    members = np.zeros((len(sets), count))
    for row, pair in enumerate(sets):
        members[row, list(pair)] = 1.0
    rotations, translations = _fit(shared, members)
    middle = room[:, 1].mean(axis=0)
    best = int(np.argmin(_costs(shared, rotations, translations)))
    for angle in ORBIT_RAD:  # the same view from elsewhere around the lines
        turn = _about_z(angle)
        rotations = np.concatenate([rotations, (rotations[best] @ turn.T)[None]])
        shift = translations[best] + rotations[best] @ middle - rotations[-1] @ middle
        translations = np.concatenate([translations, shift[None]])
    rotations, translations = _refined(shared, rotations, translations)
    costs = _costs(shared, rotations, translations)
    found: list[int] = []
    places = -np.einsum("hji,hj->hi", rotations, translations)
    for index in np.argsort(costs):
        is_new = all(np.linalg.norm(places[index] - places[other]) > DISTINCT_M for other in found)
        if costs[index] < len(room) and is_new:
            found.append(int(index))
    return [(rotations[index], translations[index]) for index in found[:MAX_POSES]]


def _about_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _refined(shared: Shared, rotations: Array, translations: Array) -> tuple[Array, Array]:
    """Return poses after some steps of Levenberg-Marquardt, all at once, with robust weights."""
    down, focal_px = shared.down, shared.focal_px
    points, targets = shared.room.reshape(-1, 3), shared.images.reshape(-1, 2)
    scale = 0.2 * COARSE * shared.width_px
    for _ in range(12):
        seen = np.asarray(np.einsum("hij,kj->hki", rotations, points), dtype=np.float64)
        camera = seen + translations[:, None]
        depth = np.maximum(camera[..., 2:], 0.1)
        flat = camera[..., :2] / depth
        errors = focal_px * flat - targets
        weights = 1.0 / np.sqrt(1.0 + np.sum(errors**2, axis=2, keepdims=True) / scale**2)
        by_camera = (
            np.concatenate([np.broadcast_to(np.eye(2), (*flat.shape, 2)), -flat[..., None]], axis=3)
            * (focal_px * weights / depth)[..., None]
        )
        jacobian = np.concatenate([np.cross(seen[:, :, None], by_camera), by_camera], axis=3)
        jacobian = jacobian.reshape(len(rotations), -1, 6)
        residuals = (errors * weights).reshape(len(rotations), -1)
        normal = jacobian.transpose(0, 2, 1) @ jacobian
        gradient = np.einsum("hri,hr->hi", jacobian, residuals)
        if down is not None:
            sunk = rotations @ DOWN
            tilts = np.cross(sunk[:, None], np.eye(3)) / GRAVITY_SIGMA
            normal[:, :3, :3] += tilts.transpose(0, 2, 1) @ tilts
            gradient[:, :3] += np.einsum("hij,hi->hj", tilts, (sunk - down) / GRAVITY_SIGMA)
        normal += np.eye(6) * (1e-3 * np.einsum("hii->hi", normal)[:, None] + 1e-6)
        step = -np.asarray(np.linalg.solve(normal, gradient[..., None]), dtype=np.float64)[..., 0]
        step *= np.minimum(1.0, 0.3 / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-9))
        turns = np.asarray(Rotation.from_rotvec(step[:, :3]).as_matrix(), dtype=np.float64)
        rotations, translations = turns @ rotations, translations + step[:, 3:]
    return rotations, translations


def _costs(shared: Shared, rotations: Array, translations: Array) -> Array:
    """Return for each pose the sum over lines of their errors, 1 at most each."""
    points = np.einsum("hij,nkj->hnki", rotations, shared.room) + translations[:, None, None]
    depth = points[..., 2:]
    flat = shared.focal_px * points[..., :2] / np.maximum(depth, 0.05)
    error = np.linalg.norm(flat - shared.images, axis=3).mean(axis=2)
    error = np.where(np.min(depth[..., 0], axis=2) > 0.05, error, np.inf)
    return np.asarray(np.minimum(error / (COARSE * shared.width_px), 1.0).sum(axis=1))


def _fit(shared: Shared, members: Array) -> tuple[Array, Array]:
    """Return poses from the lines that are `members` (h x n) of each hypothesis."""
    room, camera, down = shared.room, shared.camera, shared.down
    near = 1.0 / np.linalg.norm(camera[:, 1], axis=1) ** 2  # depth errs by the square of the distance
    weights = members * near
    weights /= weights.sum(axis=1, keepdims=True)
    room_mean = np.einsum("hn,nki->hi", weights, room) / 3.0
    camera_mean = np.einsum("hn,nki->hi", weights, camera) / 3.0
    # sum of w (c - c0)(r - r0)' without the h x n x 3 x 3 x 3 array of differences
    products = np.einsum("nki,nkj->nij", camera, room)
    matrix = np.einsum("hn,nij->hij", weights, products) / 3.0 - camera_mean[:, :, None] * room_mean[:, None]
    if down is not None:
        matrix = matrix + GRAVITY_ARM_M**2 * np.outer(down, DOWN)
    rotations = _nearest(matrix)
    return rotations, camera_mean - np.einsum("hij,hj->hi", rotations, room_mean)


def levelled(directions: Array, lengths: Array, up: Array) -> Array:
    """Return the rotation into a level room in which most strips are level or upright.

    Args:
        directions: unit directions of straight pieces, n x 3.
        lengths: their lengths, m, n.
        up: rough direction of up, from the way in which the cameras were held, unit.
    """
    candidates = [up, *directions, *(np.cross(a, b) for a, b in combinations(directions, 2))]
    vectors = np.array([c / np.linalg.norm(c) for c in candidates if np.linalg.norm(c) > 0.1])
    vectors *= np.where(vectors @ up < 0, -1.0, 1.0)[:, None]
    vectors = vectors[vectors @ up > np.cos(np.radians(50.0))]
    rise = np.abs(np.einsum("ci,ni->cn", vectors, directions))
    angle = np.minimum(np.arcsin(np.clip(rise, 0, 1)), np.arccos(np.clip(rise, 0, 1)))
    scores = (lengths / (1.0 + (angle / np.radians(2.0)) ** 2)).sum(axis=1) + 1e-3 * (vectors @ up)
    return upright(vectors[int(np.argmax(scores))])


def upright(up: Array) -> Array:
    """Return the rotation with the least turn that moves the unit vector `up` to +z."""
    axis, cosine = np.cross(up, [0.0, 0.0, 1.0]), float(up[2])
    if cosine < -0.999999:
        return np.diag([1.0, -1.0, -1.0])
    x, y, z = axis
    matrix = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + matrix + matrix @ matrix / (1.0 + cosine))
