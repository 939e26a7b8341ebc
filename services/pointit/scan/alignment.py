"""Poses of views by the strips they share: rigid motions between sets of points (Kabsch), by consensus."""

from itertools import combinations

import numpy as np

from pointit.scan.adjustment import DOWN, Array

MAX_PAIRS = 300
COARSE = 0.05
"""Tolerance of a first pose, as a share of the image's width: depth from one photograph is coarse."""
GRAVITY_ARM_M = 0.5
"""Gravity counts as a point at this distance."""


def _nearest(matrix: Array) -> Array:
    """Return the rotations that are nearest to `matrix`, h x 3 x 3."""
    left, _, right = np.linalg.svd(matrix)
    sign = np.sign(np.linalg.det(left @ right))
    left = left.copy()
    left[:, :, 2] *= sign[:, None]
    return left @ right


def best_pose(
    room: Array, camera: Array, images: Array, focal_px: float, width_px: float, down: Array | None
) -> tuple[Array, Array, Array] | None:
    """Return the rotation and translation that most lines agree with, and which lines do.

    Args:
        room: three points of each line in the room, m, n x 3 x 3.
        camera: the same points in the camera's frame, m, coarse along the line of sight.
        images: their images from the centre, image pixels, n x 3 x 2.
        focal_px, width_px: focal length and width of the image.
        down: direction of gravity in the camera's frame, if that and the room's level are known.
    """
    count = len(room)
    sets = list(combinations(range(count), 2))
    if down is not None:
        sets += [(each, each) for each in range(count)]
    if not sets:
        return None
    if len(sets) > MAX_PAIRS:
        sets = [sets[k] for k in np.linspace(0, len(sets) - 1, MAX_PAIRS).astype(int)]
    members = np.zeros((len(sets), count))
    for row, pair in enumerate(sets):
        members[row, list(pair)] = 1.0
    rotations, translations = _fit(room, camera, members, down)
    hits, scores = _score(rotations, translations, room, images, focal_px, width_px)
    best = int(np.argmax(scores))
    if hits[best].sum() > 2:
        rotations, translations = _fit(room, camera, hits[best][None].astype(float), down)
        more, score = _score(rotations, translations, room, images, focal_px, width_px)
        if score[0] >= scores[best]:
            return rotations[0], translations[0], more[0]
        rotations, translations = _fit(room, camera, members, down)
    return rotations[best], translations[best], hits[best]


def _fit(room: Array, camera: Array, members: Array, down: Array | None) -> tuple[Array, Array]:
    """Return poses from the lines that are `members` (h x n) of each hypothesis."""
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


def _score(
    rotations: Array, translations: Array, room: Array, images: Array, focal_px: float, width_px: float
) -> tuple[Array, Array]:
    """Return which lines agree with each pose, h x n, and the sum of their agreement, h."""
    points = np.einsum("hij,nkj->hnki", rotations, room) + translations[:, None, None]
    depth = points[..., 2:]
    flat = focal_px * points[..., :2] / np.maximum(depth, 0.05)
    error = np.linalg.norm(flat - images, axis=3).mean(axis=2)
    error = np.where(np.min(depth[..., 0], axis=2) > 0.05, error, np.inf)
    tolerance = COARSE * width_px
    return error < tolerance, np.clip(1.0 - error / tolerance, 0.0, None).sum(axis=1)


def levelled(directions: Array, lengths: Array, up: Array) -> Array:
    """Return the rotation into a level room in which most strips are level or upright.

    Args:
        directions, lengths: of straight pieces, n x 3 (unit) and n.
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
